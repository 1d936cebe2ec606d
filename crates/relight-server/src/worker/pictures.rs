//! Pictures for the pages of a submission: of each scene the first validation image as it was submitted, its photograph, and where
//! the two differ.
//!
//! Only of validation images, whose ground truth everyone has.

use std::fs;
use std::io;
use std::path::Path;

use relight_scene::{Image, write_whole};

use crate::benchmark::Benchmark;
use crate::disclosure::is_public;
use crate::scoring::{ScoringError, error_map};
use crate::submission::{ImageReader, Limits, Refusal, Submission};

/// What a picture shows of an image.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Picture {
    /// What was submitted.
    Submitted,
    /// The photograph.
    Truth,
    /// Where they differ.
    Error,
}

/// The name of a picture.
pub fn file_name(scene: &str, light: usize, camera: usize, picture: Picture) -> String {
    let which = match picture {
        Picture::Submitted => "",
        Picture::Truth => "_truth",
        Picture::Error => "_error",
    };
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
        let truth = image.read_truth()?;
        for (drawn, picture) in
            [(shown, Picture::Submitted), (truth, Picture::Truth), (errors, Picture::Error)]
        {
            let path = folder.join(file_name(&scene.name, image.light, image.camera, picture));
            let png = drawn.png().map_err(|error| io_at(&path)(io::Error::other(error.to_string())))?;
            write_whole(&path, |file| io::Write::write_all(file, &png)).map_err(io_at(&path))?;
        }
    }
    Ok(())
}
