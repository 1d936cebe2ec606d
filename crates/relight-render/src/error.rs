//! Why there is no picture.

use std::path::{Path, PathBuf};

use relight_field::engine::EngineError;
use relight_scene::SceneError;

use crate::maps::Map;

/// Why a picture, a path or a film cannot be had.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum RenderError {
    /// The engine failed.
    #[error(transparent)]
    Engine(#[from] EngineError),
    /// An image could not be written.
    #[error(transparent)]
    Scene(#[from] SceneError),
    /// The caller's progress function asked to stop.
    #[error("stopped before the picture was whole")]
    Cancelled,
    /// A picture of no pixels, or of more than fit.
    #[error(
        "a picture of {width}x{height} pixels cannot be drawn: choose 1 to 16384 pixels a side and at most 64 megapixels"
    )]
    Size {
        /// Width asked for, pixels.
        width: u32,
        /// Height asked for, pixels.
        height: u32,
    },
    /// The picture does not hold the map.
    #[error(
        "this picture has no {0} map: only models with a visibility network have one (v5 is such a model)"
    )]
    NoMap(Map),
    /// There is no map of that name.
    #[error("there is no map {0:?}: the maps are final, visibility, reflectance, depth and opacity")]
    UnknownMap(String),
    /// A file name that says no known format.
    #[error("{}: the name must end in .png or .exr", .0.display())]
    Extension(PathBuf),
    /// A file could not be read or written.
    #[error("{}: {source}. Check the path, its permissions and the space left on the disk", path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// What the system said.
        source: std::io::Error,
    },
    /// A file is not what it should be.
    #[error("{}: {problem}", path.display())]
    File {
        /// The file.
        path: PathBuf,
        /// What is wrong, and how to mend it.
        problem: String,
    },
    /// A camera, light or path that cannot be made.
    #[error("{0}")]
    Placement(String),
    /// A film that cannot be made.
    #[error("{}: {problem}", path.display())]
    Film {
        /// The film.
        path: PathBuf,
        /// What is wrong.
        problem: String,
    },
}

impl RenderError {
    /// Wraps an I/O error with the file it is about.
    pub(crate) fn io(path: &Path) -> impl FnOnce(std::io::Error) -> Self {
        let path = path.to_owned();
        move |source| Self::Io { path, source }
    }

    /// A fault of a file's content.
    pub(crate) fn file(path: &Path, problem: impl Into<String>) -> Self {
        Self::File { path: path.to_owned(), problem: problem.into() }
    }

    /// A failure of the encoder or the container.
    pub(crate) fn film(path: &Path, problem: impl ToString) -> Self {
        Self::Film { path: path.to_owned(), problem: problem.to_string() }
    }
}
