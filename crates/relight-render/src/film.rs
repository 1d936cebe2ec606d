//! A film: frames that become a video or a folder of images.

use std::num::NonZeroU32;
use std::path::{Path, PathBuf};

use relight_scene::Image;

use crate::error::RenderError;
use crate::files::extension;
use crate::video::Video;

/// Takes frames, one by one.
pub struct Film(Form);

enum Form {
    Video(Box<Video>),
    Folder { path: PathBuf, frames: usize },
}

impl Film {
    /// A film at `path`: an MP4 (H.264) if the name ends in `.mp4`, and otherwise a folder, made if need be, of
    /// `00000.png`, `00001.png` and so on. `frames` frames are expected, at `frame_rate` frames a second; fewer or more
    /// do no harm.
    ///
    /// # Errors
    /// [`RenderError::Io`] if file or folder cannot be made, [`RenderError::Film`] if the encoder fails or the name has
    /// the ending of some other file.
    pub fn create(path: &Path, frame_rate: NonZeroU32, frames: usize) -> Result<Film, RenderError> {
        Film::check_name(path)?;
        if extension(path) == "mp4" {
            return Ok(Film(Form::Video(Box::new(Video::create(path, frame_rate, frames)?))));
        }
        std::fs::create_dir_all(path).map_err(RenderError::io(path))?;
        Ok(Film(Form::Folder { path: path.to_owned(), frames: 0 }))
    }

    /// Checks that a film can have a name, before anything is drawn.
    ///
    /// # Errors
    /// [`RenderError::Film`] if the name has the ending of some other file.
    pub fn check_name(path: &Path) -> Result<(), RenderError> {
        let ending = extension(path);
        if ending == "mp4" || ending.is_empty() || path.is_dir() {
            return Ok(());
        }
        Err(RenderError::film(path, "name a .mp4 file, or a folder for the frames"))
    }

    /// Appends a frame; all must have one size.
    ///
    /// # Errors
    /// [`RenderError::Film`] if the frame is too large or too small for video or cannot be encoded,
    /// [`RenderError::Io`] or [`RenderError::Scene`] if it cannot be written.
    pub fn push(&mut self, frame: &Image) -> Result<(), RenderError> {
        match &mut self.0 {
            Form::Video(video) => video.push(frame),
            Form::Folder { path, frames } => {
                frame.write_png(&path.join(format!("{frames:05}.png")))?;
                *frames += 1;
                Ok(())
            }
        }
    }

    /// Completes the film. A video that is dropped instead leaves nothing behind.
    ///
    /// # Errors
    /// [`RenderError::Film`] if there was no frame, [`RenderError::Io`] if the file cannot be written.
    pub fn finish(self) -> Result<(), RenderError> {
        match self.0 {
            Form::Video(video) => video.finish(),
            Form::Folder { path, frames } => {
                // Those of a longer film that was there before would be taken for this one's.
                for later in (frames..).map(|n| path.join(format!("{n:05}.png"))).take_while(|p| p.exists()) {
                    std::fs::remove_file(&later).map_err(RenderError::io(&later))?;
                }
                Ok(())
            }
        }
    }
}
