//! Cameras that shoot on a software trigger.
//!
//! A session speaks to a [`Camera`] and gets [`Frame`]s, raw or developed. Exposure and white balance are fixed for a whole
//! session: photographs of one scene must be comparable with each other. A frame that did not arrive whole is
//! [`CameraError::Incomplete`], and is shot again.

mod bracket;
mod correction;
mod demosaic;
mod development;
mod folder;
#[cfg(feature = "gige")]
mod gige;
mod gige_settings;

use std::path::PathBuf;

use relight_scene::{Image, SceneError};

pub use bracket::{Exposure, merge};
pub use correction::{Average, Correction};
pub use demosaic::BayerPattern;
pub use development::{Development, LinearImage, Signals};
pub use folder::FolderCamera;
pub use gige_settings::GigeSettings;

/// Something that takes photographs when told to.
pub trait Camera {
    /// Width and height of its frames, pixels.
    fn size(&self) -> (u32, u32);

    /// Takes one photograph, and waits for it.
    ///
    /// # Errors
    /// [`CameraError::Incomplete`] if another try may go well, else what is wrong with the camera.
    fn shoot(&mut self) -> Result<Frame, CameraError>;

    /// Lets the following photographs be exposed for a multiple of the session's time. Not every camera can.
    ///
    /// # Errors
    /// If the camera cannot do that.
    fn expose(&mut self, multiple: f64) -> Result<(), CameraError> {
        if multiple == 1.0 { Ok(()) } else { Err(CameraError::fixed_exposure()) }
    }
}

/// A photograph as the camera gave it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Frame {
    /// Developed by the camera: sRGB.
    Developed(Image),
    /// One number a pixel, linear in light, behind a mosaic of colour filters.
    Raw {
        /// Pixels a row.
        width: u32,
        /// Rows.
        height: u32,
        /// Which filters lie where.
        pattern: BayerPattern,
        /// Row-major from the top left.
        data: Vec<u8>,
    },
}

impl CameraError {
    /// The camera cannot change its exposure.
    pub(crate) fn fixed_exposure() -> CameraError {
        CameraError::Failed {
            problem: "its exposure cannot be set from here".to_owned(),
            mend: "Leave out the exposure bracket, or use a camera whose exposure can be set.",
        }
    }
}

/// Why there is no photograph.
#[derive(Debug, thiserror::Error)]
pub enum CameraError {
    /// The frame did not arrive whole; the next may.
    #[error("an incomplete frame: {0}")]
    Incomplete(String),
    /// The camera cannot go on.
    #[error("the camera failed: {problem}. {mend}")]
    Failed {
        /// What is wrong.
        problem: String,
        /// What to do about it.
        mend: &'static str,
    },
    /// No photograph appeared in time.
    #[error("{}: no new photograph appeared within {seconds} s. Check that the camera's program saves to this folder.", folder.display())]
    NoPhotograph {
        /// Where it was to appear.
        folder: PathBuf,
        /// How long was waited.
        seconds: f64,
    },
    /// A photograph cannot be read.
    #[error(transparent)]
    File(#[from] SceneError),
}
