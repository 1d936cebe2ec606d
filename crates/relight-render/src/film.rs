//! A film: frames that become a video or a folder of images.

use std::num::NonZeroU32;
use std::path::Path;

use relight_scene::Image;

use crate::error::RenderError;
use crate::files::extension;
use crate::frames::Frames;
use crate::video::Video;

/// Takes frames, one by one.
pub struct Film(Form);

enum Form {
    Video(Box<Video>),
    Folder(Frames),
}

impl Film {
    /// A film at `path`: an MP4 (H.264) if the name ends in `.mp4`, and otherwise a folder, made if need be, of
    /// `00000.png`, `00001.png` and so on, with a file `film.json` that tells how many there are. `frames` frames are
    /// expected, at `frame_rate` frames a second; fewer do no harm. In a folder the frames of an earlier film are
    /// replaced, and nothing else.
    ///
    /// # Errors
    /// [`RenderError::Io`] if file or folder cannot be made, [`RenderError::Film`] if the encoder fails, the name has the
    /// ending of some other file, or the folder holds something else than a film.
    pub fn create(path: &Path, frame_rate: NonZeroU32, frames: usize) -> Result<Film, RenderError> {
        Film::check_name(path)?;
        if extension(path) == "mp4" {
            return Ok(Film(Form::Video(Box::new(Video::create(path, frame_rate, frames)?))));
        }
        Ok(Film(Form::Folder(Frames::create(path, frame_rate, frames)?)))
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
    /// [`RenderError::Film`] if the frame is too large or too small for video or cannot be encoded, or a folder has all its
    /// frames,
    /// [`RenderError::Io`] or [`RenderError::Scene`] if it cannot be written.
    pub fn push(&mut self, frame: &Image) -> Result<(), RenderError> {
        match &mut self.0 {
            Form::Video(video) => video.push(frame),
            Form::Folder(folder) => folder.push(frame),
        }
    }

    /// Completes the film. A video that is dropped instead leaves nothing behind.
    ///
    /// # Errors
    /// [`RenderError::Film`] if there was no frame, [`RenderError::Io`] if the file cannot be written.
    pub fn finish(self) -> Result<(), RenderError> {
        match self.0 {
            Form::Video(video) => video.finish(),
            Form::Folder(folder) => folder.finish(),
        }
    }
}
