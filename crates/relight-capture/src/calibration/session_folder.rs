//! A session of board photographs: what its folder holds, and how the photographs are shot.

use std::io::Write;
use std::ops::ControlFlow;
use std::path::{Path, PathBuf};

use relight_scene::write_whole;

use crate::camera::{CameraError, Development};
use crate::session::{Rig, RigFault};

/// What a person says about the board ([`BoardFile`](super::BoardFile)).
pub const BOARD: &str = "board.toml";
/// Folder of the photographs from the waypoints, `LABEL.png`.
pub const VIEWS: &str = "board";
/// Folder of photographs that help to determine the lens: the board anywhere, the camera anywhere.
pub const LENS_VIEWS: &str = "lens";
/// Folder of photographs for a re-check.
pub const RECHECK: &str = "recheck";
/// The calibration.
pub const CALIBRATION: &str = "calibration.json";

/// Tries for a frame that does not arrive whole.
const TRIES: u32 = 5;

/// The name of a photograph in its folder.
pub fn photograph_name(label: usize) -> String {
    format!("{label:05}.png")
}

/// Why a board could not be photographed.
#[derive(Debug, thiserror::Error)]
pub enum ShootError {
    /// The rig failed.
    #[error("{}: {fault}", .path.display())]
    Rig {
        /// The photograph that was to be.
        path: PathBuf,
        /// What happened.
        fault: RigFault,
    },
    /// A photograph cannot be written.
    #[error("{}: cannot be written: {error}", .path.display())]
    Write {
        /// The photograph.
        path: PathBuf,
        /// Why.
        error: std::io::Error,
    },
}

/// Photographs the board from some of a rig's views into files, under the rig's light of number 0. Files that are there
/// already are whole, and are not shot again. `progress` is told how many are there, and may stop the work; whether all are
/// there at the end is the answer.
///
/// # Errors
/// [`ShootError`]; what is shot by then is kept.
pub fn shoot_board(
    rig: &mut dyn Rig,
    views: &[(usize, PathBuf)],
    development: &Development,
    progress: &mut dyn FnMut(usize) -> ControlFlow<()>,
) -> Result<bool, ShootError> {
    for (done, (view, path)) in views.iter().enumerate() {
        if progress(done).is_break() {
            return Ok(false);
        }
        if !path.exists() {
            shoot_one(rig, *view, path, development)?;
        }
    }
    // Nothing is left to be stopped.
    let _ = progress(views.len());
    Ok(true)
}

fn shoot_one(
    rig: &mut dyn Rig,
    view: usize,
    path: &Path,
    development: &Development,
) -> Result<(), ShootError> {
    let failed = |fault| ShootError::Rig { path: path.to_owned(), fault };
    rig.view(view).map_err(failed)?;
    rig.light(0).map_err(failed)?;
    let mut tries = 1;
    let image = loop {
        match rig.shoot().and_then(|frame| frame.develop(development)) {
            Ok(image) => break image,
            Err(CameraError::Incomplete(why)) if tries < TRIES => {
                tracing::warn!("{}: {why}: shot again", path.display());
                tries += 1;
            }
            Err(error) => return Err(failed(error.into())),
        }
    };
    let write = || write_whole(path, |file| file.write_all(&image.png()?));
    write().map_err(|error| ShootError::Write { path: path.to_owned(), error })
}
