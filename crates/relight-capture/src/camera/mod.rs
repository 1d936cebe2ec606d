//! Cameras that shoot on a software trigger.
//!
//! A session speaks to a [`Camera`] and gets [`Frame`]s, raw or developed. Exposure and white balance are fixed for a whole
//! session: photographs of one scene must be comparable with each other. A frame that did not arrive whole is
//! [`CameraError::Incomplete`], and is shot again.

mod demosaic;
mod folder;

use std::path::PathBuf;

use relight_scene::{Image, SceneError};

pub use demosaic::{BayerPattern, Development};
pub use folder::FolderCamera;

/// Something that takes photographs when told to.
pub trait Camera {
    /// Width and height of its frames, pixels.
    fn size(&self) -> (u32, u32);

    /// Takes one photograph, and waits for it.
    ///
    /// # Errors
    /// [`CameraError::Incomplete`] if another try may go well, else what is wrong with the camera.
    fn shoot(&mut self) -> Result<Frame, CameraError>;
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

impl Frame {
    /// The frame as an sRGB image; raw ones are developed once, here.
    ///
    /// # Errors
    /// [`CameraError::Incomplete`] if the data are not of the stated size.
    pub fn develop(self, development: &Development) -> Result<Image, CameraError> {
        match self {
            Frame::Developed(image) => {
                let (stated, held) = (3 * u64::from(image.width) * u64::from(image.height), image.data.len());
                complete(stated, held)?;
                Ok(image)
            }
            Frame::Raw { width, height, pattern, data } => {
                complete(u64::from(width) * u64::from(height), data.len())?;
                Ok(development.develop(width, height, pattern, &data))
            }
        }
    }
}

/// Whether all bytes of a frame are there.
fn complete(stated: u64, held: usize) -> Result<(), CameraError> {
    if stated == held as u64 {
        return Ok(());
    }
    Err(CameraError::Incomplete(format!("{held} of its {stated} bytes arrived")))
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
