//! A capture session: every view under every light, journalled, resumed after a kill, ending in a scene folder.
//!
//! [`capture`] drives a [`Rig`], which is two arms and a camera, or the virtual rig. Frames go to the official ReNe layout one by one;
//! the session keeps its own files in the folder [`STATE`] inside, which is hidden: what is captured (so that a resumed
//! session is the same one) and the [`journal`](Journal) of frames that are on disk. Nothing there tells times or tries, so
//! that a session killed at any moment and resumed leaves the very bytes of one that was not.

mod care;
mod error;
mod hdr_file;
mod journal;
mod light_gain;
mod photograph;
mod quality;
mod references;
mod reshoot;
mod sheet;
mod shooting;
mod state;
mod stillness;

use std::collections::BTreeSet;
use std::io::Write;
use std::ops::ControlFlow;
use std::path::{Path, PathBuf};

use relight_scene::{Intrinsics, Pose, ReneWriter, Scene, Splits, write_whole};

use crate::camera::{CameraError, Development, Frame};

pub use care::{Care, WhenMoved};
pub use error::{RigFault, SessionError};
pub use journal::{Check, Entry, Journal, Line, Log};
use photograph::Photographer;
pub use quality::{brightness, sharpness};
pub use references::{CAMERA, Target};
pub use reshoot::{Reshoot, forget};
pub use sheet::SHEET;
use sheet::Sheet;
use shooting::Shooting;
pub use state::{STATE, Subject};
pub use stillness::{Change, compare};

/// Which views were checked for movement, in the folder [`STATE`].
const CHECKS: &str = "checks.jsonl";

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

    /// Lets the following photographs be exposed for a multiple of the session's time.
    ///
    /// # Errors
    /// As [`Camera::expose`](crate::camera::Camera::expose).
    fn expose(&mut self, multiple: f64) -> Result<(), CameraError> {
        if multiple == 1.0 { Ok(()) } else { Err(CameraError::fixed_exposure()) }
    }

    /// Holds something before the camera, or has somebody hold it there, and waits until that is done.
    ///
    /// # Errors
    /// If it cannot be done.
    fn show(&mut self, target: Target) -> Result<(), RigFault> {
        match target {
            Target::Scene => Ok(()),
            Target::Dark | Target::Flat | Target::Card(_) => Err(RigFault::NoTarget),
        }
    }
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
        /// Pairs of view and light during whose view the object or the camera moved, see [`forget`].
        moved: Vec<(usize, usize)>,
    },
    /// It was told to stop, and can be resumed.
    Stopped,
}

/// Shoots what is missing, and makes the folder a scene with its splits. `progress` is told after each frame and may stop the
/// session by [`ControlFlow::Break`]. `subject` says what stands there and how it is shot; a session is only resumed with
/// the same. Nothing is done around the photographs.
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
    capture_with(rig, shots, &Care::default(), subject, out, resume, progress)
}

/// As [`capture`], with dark and flat frames, exposure brackets and checks as `care` asks for.
///
/// # Errors
/// [`SessionError`]; what is shot by then is kept.
pub fn capture_with(
    rig: &mut dyn Rig,
    shots: &Shots,
    care: &Care,
    subject: &Subject,
    out: &Path,
    resume: bool,
    progress: &mut dyn FnMut(Progress) -> ControlFlow<()>,
) -> Result<Ending, SessionError> {
    care.check(shots.lights.len())?;
    let journal = state::open(out, subject, shots, care, resume)?;
    let checks = if care.movement { Some(open_checks(out)?) } else { None };
    let writer = ReneWriter::create(out, &shots.intrinsics, shots.cameras.clone(), &shots.lights)?;
    let (mut on_disk, mut sheet) = (BTreeSet::new(), Sheet::new(shots));
    for entry in journal.entries() {
        sheet.put(entry.view, entry.light, &shooting::reread(&writer, entry)?);
        on_disk.insert((entry.view, entry.light));
    }
    let correction = references::correction(rig, shots, care, subject, out)?;
    let mut photographer = Photographer { shots, care, correction, gains: Vec::new() };
    photographer.gains = light_gain::light_gains(rig, &photographer, subject, out)?;
    let resumed = on_disk.len();
    let mut shooting = Shooting { rig, photographer, out, writer, journal, checks, sheet, on_disk, resumed };
    if !shooting.run(progress)? {
        return Ok(Ending::Stopped);
    }
    finish(out)?;
    let Shooting { sheet, journal, checks, .. } = shooting;
    sheet.write(out)?;
    let moved = checks.iter().flat_map(|checks| frames_of_moved(checks, &journal)).collect();
    Ok(Ending::Complete { blurred: blurred(shots, &journal), moved })
}

fn checks_of(out: &Path) -> PathBuf {
    out.join(STATE).join(CHECKS)
}

fn open_checks(out: &Path) -> Result<Log<Check>, SessionError> {
    Log::open(&checks_of(out))
}

/// All frames of views during which something moved.
fn frames_of_moved(checks: &Log<Check>, journal: &Journal) -> impl Iterator<Item = (usize, usize)> {
    let moved: BTreeSet<usize> =
        checks.entries().filter(|check| check.moved).map(|check| check.view).collect();
    journal.entries().map(Line::key).filter(move |(view, _)| moved.contains(view))
}

/// Writes the splits beside the frames.
fn finish(out: &Path) -> Result<(), SessionError> {
    let scene = Scene::open(out)?;
    let splits = Splits::peek(&scene)?.to_json(&scene)?;
    let path = out.join("splits.json");
    write_whole(&path, |file| file.write_all(&splits)).map_err(SessionError::io(&path))
}

/// Frames that are blurred beside the others of their view, and all of views that are blurred beside other views.
fn blurred(shots: &Shots, journal: &Journal) -> Vec<(usize, usize)> {
    let views: Vec<Vec<_>> = (0..shots.cameras.len())
        .map(|view| {
            let entries = journal.entries().filter(move |entry| entry.view == view);
            entries.map(|e| (e.light, e.brightness, e.sharpness)).collect()
        })
        .collect();
    quality::blurred(&views)
}

#[cfg(test)]
mod tests;
