//! Pictures for the pages of a submission: of each scene the first validation image as it was submitted, and where it errs.
//!
//! Only of validation images, whose ground truth everyone has: image and error together tell it.

use std::fs;
use std::io;
use std::path::Path;

use relight_scene::{Image, write_whole};

use crate::benchmark::Benchmark;
use crate::disclosure::is_public;
use crate::scoring::{ScoringError, error_map};
use crate::submission::{ImageReader, Limits, Refusal, Submission};

/// The name of a picture: of the submitted image, or of its errors.
pub fn file_name(scene: &str, light: usize, camera: usize, error: bool) -> String {
    let which = if error { "_error" } else { "" };
    format!("{scene}_{light:02}_{camera:02}{which}.png")
}

/// Draws the pictures of a submission into a new folder.
///
/// # Errors
/// As [`error_map`].
pub(super) fn draw(
    submission: &Submission,
    benchmark: &Benchmark,
    limits: &Limits,
    folder: &Path,
) -> Result<(), ScoringError> {
    let io_at = |path: &Path| {
        let path = path.to_owned();
        move |source: io::Error| ScoringError::Io { path, source }
    };
    fs::create_dir_all(folder).map_err(io_at(folder))?;
    let mut reader = ImageReader::default();
    let mut last = None;
    for (index, submitted) in submission.images.iter().enumerate() {
        let scene = &benchmark.scenes[submitted.scene];
        let image = &scene.images[submitted.image];
        if last == Some(submitted.scene) || !is_public(image.split) {
            continue;
        }
        last = Some(submitted.scene);
        submission
            .read(&mut reader, benchmark, limits, index)
            .map_err(io_at(&submission.zip))?
            .map_err(|problems| Refusal { problems, more: 0 })?;
        let shown = Image { width: image.width, height: image.height, data: reader.rgb.clone() };
        let errors = error_map(submission, benchmark, limits, index)?;
        for (picture, is_error) in [(shown, false), (errors, true)] {
            let path = folder.join(file_name(&scene.name, image.light, image.camera, is_error));
            let png = picture.png().map_err(|error| io_at(&path)(io::Error::other(error.to_string())))?;
            write_whole(&path, |file| io::Write::write_all(file, &png)).map_err(io_at(&path))?;
        }
    }
    Ok(())
}
