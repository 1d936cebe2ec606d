//! A film as a folder of images, and the file in it that tells which of them are the film's.

use std::fs;
use std::io::{ErrorKind, Write};
use std::num::NonZeroU32;
use std::path::{Path, PathBuf};

use relight_scene::{Image, read_text, write_whole};
use serde::{Deserialize, Serialize};

use crate::error::RenderError;
use crate::paths::MOST_FRAMES;

/// The file beside the frames, its format and version, and its longest length, bytes.
const LIST: &str = "film.json";
const FORMAT: &str = "relight-film-1";
const LONGEST_LIST: u64 = 1 << 16;

/// What the list of any version tells.
#[derive(Deserialize)]
struct Version {
    format: String,
}

/// What images of a folder are frames of a film: the first `frames` by number.
#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct List {
    format: String,
    frames: usize,
    frame_rate: NonZeroU32,
}

/// A folder that takes frames.
pub(crate) struct Frames {
    folder: PathBuf,
    frame_rate: NonZeroU32,
    /// Frames taken, and how many images are this film's to write and to remove.
    taken: usize,
    own: usize,
}

impl Frames {
    /// A folder for at most `frames` frames: a new or an empty one, or that of an earlier film, whose frames are replaced.
    pub(crate) fn create(
        folder: &Path,
        frame_rate: NonZeroU32,
        frames: usize,
    ) -> Result<Frames, RenderError> {
        if frames > MOST_FRAMES {
            let problem = format!("a film of {frames} frames cannot be: at most {MOST_FRAMES}");
            return Err(RenderError::film(folder, problem));
        }
        fs::create_dir_all(folder).map_err(RenderError::io(folder))?;
        let earlier = earlier_frames(folder)?;
        let own = earlier.max(frames);
        let film = Frames { folder: folder.to_owned(), frame_rate, taken: 0, own };
        if let Some(strange) = (earlier..own).map(|n| film.frame(n)).find(|path| path.exists()) {
            let problem = "is there already and no film's: remove it, or name another folder for the frames";
            return Err(RenderError::film(&strange, problem));
        }
        // Before the first frame, so that what a kill leaves is known as a film's.
        film.write_list(own)?;
        Ok(film)
    }

    pub(crate) fn push(&mut self, frame: &Image) -> Result<(), RenderError> {
        if self.taken == self.own {
            return Err(RenderError::film(
                &self.folder,
                format!("a film of {} frames gets no more", self.own),
            ));
        }
        frame.write_png(&self.frame(self.taken))?;
        self.taken += 1;
        Ok(())
    }

    /// Removes what an earlier, longer film has left, which would be taken for this one's.
    pub(crate) fn finish(self) -> Result<(), RenderError> {
        for path in (self.taken..self.own).map(|n| self.frame(n)) {
            match fs::remove_file(&path) {
                Err(error) if error.kind() != ErrorKind::NotFound => {
                    return Err(RenderError::io(&path)(error));
                }
                _ => {}
            }
        }
        self.write_list(self.taken)
    }

    fn frame(&self, number: usize) -> PathBuf {
        self.folder.join(format!("{number:05}.png"))
    }

    fn write_list(&self, frames: usize) -> Result<(), RenderError> {
        let path = self.folder.join(LIST);
        let list = List { format: FORMAT.to_owned(), frames, frame_rate: self.frame_rate };
        let text =
            serde_json::to_string(&list).map_err(|error| RenderError::file(&path, error.to_string()))?;
        write_whole(&path, |file| writeln!(file, "{text}")).map_err(RenderError::io(&path))
    }
}

/// How many images of a folder an earlier film has left. Refuses a folder that holds anything and no film.
fn earlier_frames(folder: &Path) -> Result<usize, RenderError> {
    let path = folder.join(LIST);
    if !path.exists() {
        let mut entries = fs::read_dir(folder).map_err(RenderError::io(folder))?;
        return if entries.next().is_none() {
            Ok(0)
        } else {
            let problem =
                format!("is not empty and holds no film ({LIST}): name another folder for the frames");
            Err(RenderError::film(folder, problem))
        };
    }
    let malformed = |error: serde_json::Error| {
        RenderError::file(&path, format!("{error}. It is no film's: name another folder for the frames"))
    };
    let text = read_text(&path, LONGEST_LIST)?;
    let Version { format } = serde_json::from_str(&text).map_err(malformed)?;
    if format != FORMAT {
        let problem = format!("format {format:?} is unknown to this version, which reads {FORMAT:?}");
        return Err(RenderError::file(&path, problem));
    }
    let list: List = serde_json::from_str(&text).map_err(malformed)?;
    if list.frames > MOST_FRAMES {
        let problem = format!(
            "tells of {} frames, and films have at most {MOST_FRAMES}. No film wrote it: name another folder for the frames",
            list.frames
        );
        return Err(RenderError::file(&path, problem));
    }
    Ok(list.frames)
}
