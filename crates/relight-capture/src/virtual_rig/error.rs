//! What can be wrong with what a rig is asked to show.

use std::path::{Path, PathBuf};

/// Why a rig, a model or a board cannot be made.
#[derive(Debug, thiserror::Error)]
pub enum RigError {
    /// A model holds no triangle with an area.
    #[error("the model holds no triangle with an area: give it at least one mesh with faces")]
    NoTriangles,
    /// A mesh does not hold together.
    #[error("a mesh of the model is damaged: {problem}")]
    Mesh {
        /// What is wrong.
        problem: String,
    },
    /// A material, lamp, sensor or setting has a number out of range.
    #[error("{name} is {value}: it must lie within {range}")]
    OutOfRange {
        /// What the number stands for.
        name: &'static str,
        /// The number.
        value: f64,
        /// The numbers that are accepted.
        range: &'static str,
    },
    /// A picture that should become a texture has the wrong number of values.
    #[error("the texture says {width}x{height} texels but holds {held} values of {channels} channels")]
    Texture {
        /// Texels a row.
        width: usize,
        /// Rows.
        height: usize,
        /// Channels a texel.
        channels: usize,
        /// Values in all.
        held: usize,
    },
    /// There is no built-in object of that name.
    #[error("there is no built-in object {name:?}; the built-in ones are {known}")]
    UnknownObject {
        /// The name that was asked for.
        name: String,
        /// All names, with commas between.
        known: String,
    },
    /// A model file cannot be used.
    #[error("{}: {problem}{}{mend}", path.display(), if mend.is_empty() { "" } else { ". " })]
    File {
        /// The file.
        path: PathBuf,
        /// What is wrong.
        problem: String,
        /// How to mend it; may be empty.
        mend: String,
    },
    /// A texture file of a model cannot be read.
    #[error(transparent)]
    Image(#[from] relight_scene::SceneError),
}

impl RigError {
    pub(super) fn file(path: &Path, problem: impl Into<String>, mend: &str) -> Self {
        Self::File { path: path.to_owned(), problem: problem.into(), mend: mend.to_owned() }
    }

    pub(super) fn mesh(problem: impl Into<String>) -> Self {
        Self::Mesh { problem: problem.into() }
    }
}

/// Refuses a number outside `lowest..=highest`, NaN included.
pub(super) fn within(
    name: &'static str,
    value: f64,
    [lowest, highest]: [f64; 2],
    range: &'static str,
) -> Result<(), RigError> {
    if (lowest..=highest).contains(&value) {
        Ok(())
    } else {
        Err(RigError::OutOfRange { name, value, range })
    }
}
