//! A capture session: every view under every light, journalled, resumed after a kill, ending in a scene folder.
//!
//! [`capture`] drives a [`Rig`], which is two arms and a camera, or the virtual rig. Frames go to the official ReNe layout one by one;
//! the session keeps its own files in the folder [`STATE`] inside, which is hidden: what is captured (so that a resumed
//! session is the same one) and the [`journal`](Journal) of frames that are on disk. Nothing there tells times or tries, so
//! that a session killed at any moment and resumed leaves the very bytes of one that was not.

mod error;
mod journal;
mod quality;
mod sheet;
mod state;

use std::collections::BTreeSet;
use std::io::Write;
use std::ops::ControlFlow;
use std::path::Path;

use relight_scene::{
    Image, Intrinsics, Pose, ReneWriter, Scene, Splits, read_bytes, read_image, write_whole,
};

use crate::camera::{CameraError, Development, Frame};

pub use error::{RigFault, SessionError};
pub use journal::{Entry, Journal};
pub use quality::{brightness, sharpness};
pub use sheet::SHEET;
use sheet::Sheet;
pub use state::{STATE, Subject};

/// Tries for a frame that does not arrive whole.
const TRIES: u32 = 5;
/// The longest image file that is checked, bytes.
const LONGEST_IMAGE: u64 = 1 << 28;

/// What a session drives.
pub trait Rig {
    /// Brings the camera to a view and waits until it stands still.
    ///
    /// # Errors
    /// If it does not get there.
    fn view(&mut self, view: usize) -> Result<(), RigFault>;

    /// Brings the light to its place of this number and waits until it stands still.
    ///
    /// # Errors
    /// If it does not get there.
    fn light(&mut self, light: usize) -> Result<(), RigFault>;

    /// Takes a photograph.
    ///
    /// # Errors
    /// As [`Camera::shoot`](crate::camera::Camera::shoot).
    fn shoot(&mut self) -> Result<Frame, CameraError>;
}

/// What is shot, and in which order.
#[derive(Clone, Debug)]
pub struct Shots {
    /// The lens.
    pub intrinsics: Intrinsics,
    /// Camera-to-world poses as calibrated, by view.
    pub cameras: Vec<Pose>,
    /// Light-to-world poses as registered, by light.
    pub lights: Vec<Pose>,
    /// Views, in the order in which the camera visits them.
    pub view_order: Vec<usize>,
    /// Lights, in the order in which the lamp visits them; every other view backwards, since it then stands at the end.
    pub light_order: Vec<usize>,
    /// How raw frames are developed.
    pub development: Development,
}

impl Shots {
    /// The lights in the order of visit at the `i`-th view of the order of views: to and fro.
    pub fn lights_of(&self, i: usize) -> Vec<usize> {
        let forth = self.light_order.iter().copied();
        if i.is_multiple_of(2) { forth.collect() } else { forth.rev().collect() }
    }
}

/// How far a session is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Progress {
    /// Frames on disk.
    pub done: usize,
    /// Of these, frames that were there at the start.
    pub resumed: usize,
    /// All frames.
    pub total: usize,
}

/// How a session ended.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Ending {
    /// Everything is shot, and the folder is a scene.
    Complete {
        /// Pairs of view and light whose photographs are blurred beside the others of their view.
        blurred: Vec<(usize, usize)>,
    },
    /// It was told to stop, and can be resumed.
    Stopped,
}

/// Shoots what is missing, and makes the folder a scene with its splits. `progress` is told after each frame and may stop the
/// session by [`ControlFlow::Break`]. `subject` says what stands there and how it is shot; a session is only resumed with
/// the same.
///
/// # Errors
/// [`SessionError`]; what is shot by then is kept.
pub fn capture(
    rig: &mut dyn Rig,
    shots: &Shots,
    subject: &Subject,
    out: &Path,
    resume: bool,
    progress: &mut dyn FnMut(Progress) -> ControlFlow<()>,
) -> Result<Ending, SessionError> {
    let mut journal = state::open(out, subject, shots, resume)?;
    let writer = ReneWriter::create(out, &shots.intrinsics, shots.cameras.clone(), &shots.lights)?;
    let (mut on_disk, mut sheet) = (BTreeSet::new(), Sheet::new(shots));
    for entry in journal.entries() {
        sheet.put(entry.view, entry.light, &reread(&writer, entry)?);
        on_disk.insert((entry.view, entry.light));
    }
    let total = shots.view_order.len() * shots.light_order.len();
    let resumed = on_disk.len();
    for (i, &view) in shots.view_order.iter().enumerate() {
        let lights = shots.lights_of(i).into_iter();
        let missing: Vec<usize> = lights.filter(|&light| !on_disk.contains(&(view, light))).collect();
        let mut arrived = false;
        for light in missing {
            if progress(Progress { done: on_disk.len(), resumed, total }).is_break() {
                return Ok(Ending::Stopped);
            }
            let failed = |fault| SessionError::Rig { view, light, fault };
            if !arrived {
                rig.view(view).map_err(failed)?;
                arrived = true;
            }
            rig.light(light).map_err(failed)?;
            let image = shoot(rig, shots, view, light)?;
            keep(&writer, &mut journal, (view, light), &image)?;
            sheet.put(view, light, &image);
            on_disk.insert((view, light));
        }
        if arrived {
            sheet.write(out)?;
        }
    }
    // Nothing is left to be stopped.
    let _ = progress(Progress { done: total, resumed, total });
    finish(out)?;
    sheet.write(out)?;
    Ok(Ending::Complete { blurred: blurred(shots, &journal) })
}

/// A photograph that is on disk already. A session whose images are no longer what they were is refused: somebody else
/// was at them.
fn reread(writer: &ReneWriter, entry: &Entry) -> Result<Image, SessionError> {
    let path = writer.image_path(entry.view, entry.light);
    if crc32fast::hash(&read_bytes(&path, LONGEST_IMAGE)?) == entry.crc32 {
        return Ok(read_image(&path)?);
    }
    let problem = format!(
        "is not what was shot. Remove the line of view {} and light {} from the journal, and it is shot again.",
        entry.view, entry.light
    );
    Err(SessionError::Other { path, problem })
}

/// A whole photograph of a view under a light.
fn shoot(rig: &mut dyn Rig, shots: &Shots, view: usize, light: usize) -> Result<Image, SessionError> {
    let mut tries = 1;
    loop {
        match rig.shoot().and_then(|frame| frame.develop(&shots.development)) {
            Ok(image) => return Ok(image),
            Err(last @ CameraError::Incomplete(_)) if tries == TRIES => {
                return Err(SessionError::Tries { view, light, tries, last });
            }
            Err(CameraError::Incomplete(why)) => {
                tracing::warn!("view {view} under light {light}: {why}: shot again");
                tries += 1;
            }
            Err(error) => return Err(SessionError::Rig { view, light, fault: error.into() }),
        }
    }
}

/// Puts a photograph on disk, and then into the journal.
fn keep(
    writer: &ReneWriter,
    journal: &mut Journal,
    (view, light): (usize, usize),
    image: &Image,
) -> Result<(), SessionError> {
    let png = image.png().map_err(SessionError::io(writer.image_path(view, light)))?;
    writer.write_frame(view, light, &png)?;
    let (crc32, brightness, sharpness) = (crc32fast::hash(&png), brightness(image), sharpness(image));
    journal.add(Entry { view, light, crc32, brightness, sharpness })
}

/// Writes the splits beside the frames.
fn finish(out: &Path) -> Result<(), SessionError> {
    let scene = Scene::open(out)?;
    let splits = Splits::peek(&scene)?.to_json(&scene)?;
    let path = out.join("splits.json");
    write_whole(&path, |file| file.write_all(&splits)).map_err(SessionError::io(&path))
}

/// Frames that are blurred beside the others of their view.
fn blurred(shots: &Shots, journal: &Journal) -> Vec<(usize, usize)> {
    let of_view = |view: usize| {
        let entries = journal.entries().filter(move |entry| entry.view == view);
        let frames: Vec<_> = entries.map(|e| (e.light, e.brightness, e.sharpness)).collect();
        quality::blurred(&frames).into_iter().map(move |light| (view, light))
    };
    (0..shots.cameras.len()).flat_map(of_view).collect()
}

#[cfg(test)]
mod tests;
