//! The views of a session, one after another: what is missing is shot, and what moved is found out as soon as it can be.

use std::collections::BTreeSet;
use std::ops::ControlFlow;
use std::path::Path;

use relight_scene::{Image, ReneWriter, read_bytes, read_image};

use super::care::WhenMoved;
use super::journal::{Check, Entry, Journal, Log};
use super::photograph::Photographer;
use super::sheet::Sheet;
use super::stillness::{Change, compare};
use super::{Progress, Rig, SessionError, brightness, hdr_file, sharpness};

/// The longest image file that is checked, bytes.
const LONGEST_IMAGE: u64 = 1 << 28;
/// How often a view is shot before the session gives up that something moves.
const PASSES: u32 = 3;

/// A session under way.
pub(super) struct Shooting<'a> {
    pub rig: &'a mut dyn Rig,
    pub photographer: Photographer<'a>,
    pub out: &'a Path,
    pub writer: ReneWriter,
    pub journal: Journal,
    /// Whether views moved, if that is asked.
    pub checks: Option<Log<Check>>,
    pub sheet: Sheet,
    pub on_disk: BTreeSet<(usize, usize)>,
    /// Frames that were on disk at the start.
    pub resumed: usize,
}

/// How a pass over a view ended.
enum Pass {
    Complete,
    Stopped,
    Moved,
}

impl Shooting<'_> {
    /// Shoots what is missing of all views. Whether nobody stopped it is the answer.
    pub fn run(
        &mut self,
        progress: &mut dyn FnMut(Progress) -> ControlFlow<()>,
    ) -> Result<bool, SessionError> {
        let shots = self.photographer.shots;
        for (i, &view) in shots.view_order.iter().enumerate() {
            if !self.view(view, &shots.lights_of(i), progress)? {
                return Ok(false);
            }
        }
        // Nothing is left to be stopped.
        let _ = progress(self.progress());
        Ok(true)
    }

    fn progress(&self) -> Progress {
        let (done, shots) = (self.on_disk.len(), self.photographer.shots);
        let total = shots.view_order.len() * shots.light_order.len();
        Progress { done, resumed: self.resumed.min(done), total }
    }

    /// Shoots what is missing of a view, and all of it again if that is asked for where something moved.
    fn view(
        &mut self,
        view: usize,
        lights: &[usize],
        progress: &mut dyn FnMut(Progress) -> ControlFlow<()>,
    ) -> Result<bool, SessionError> {
        let mut passes = 1;
        loop {
            match self.pass(view, lights, progress)? {
                Pass::Complete => return Ok(true),
                Pass::Stopped => return Ok(false),
                Pass::Moved => {}
            }
            if self.photographer.care.when_moved == WhenMoved::Stop || passes == PASSES {
                return Err(SessionError::Moved(view));
            }
            passes += 1;
            self.journal.retain(|entry| entry.view != view)?;
            if let Some(checks) = &mut self.checks {
                checks.retain(|check| check.view != view)?;
            }
            self.on_disk.retain(|frame| frame.0 != view);
        }
    }

    fn pass(
        &mut self,
        view: usize,
        lights: &[usize],
        progress: &mut dyn FnMut(Progress) -> ControlFlow<()>,
    ) -> Result<Pass, SessionError> {
        let every = self.photographer.care.movement_every;
        let Some(&first) = lights.first() else { return Ok(Pass::Complete) };
        let is_begun = lights.iter().any(|&light| self.on_disk.contains(&(view, light)));
        // Whoever interrupted the session may have been at the object since.
        let mut is_due = is_begun;
        let (mut arrived, mut since) = (false, 0_u32);
        for &light in lights {
            if self.on_disk.contains(&(view, light)) {
                continue;
            }
            if progress(self.progress()).is_break() {
                return Ok(Pass::Stopped);
            }
            if is_due && self.look(view, first, false, &mut arrived)? {
                return Ok(Pass::Moved);
            }
            self.frame(view, light, &mut arrived)?;
            since += 1;
            is_due = since.is_multiple_of(every);
        }
        let has_moved = self.look(view, first, true, &mut arrived)?;
        Ok(if has_moved { Pass::Moved } else { Pass::Complete })
    }

    /// Takes a photograph and puts it on disk.
    fn frame(&mut self, view: usize, light: usize, arrived: &mut bool) -> Result<(), SessionError> {
        go(self.rig, arrived, view, light)?;
        let photograph = self.photographer.take(self.rig, view, light)?;
        if self.photographer.care.exr
            && let Some(light_of_it) = &photograph.light
        {
            hdr_file::write(&hdr_file::path(self.out, view, light), light_of_it)?;
        }
        keep(&self.writer, &mut self.journal, (view, light), &photograph.image)?;
        self.sheet.put(view, light, &photograph.image);
        self.on_disk.insert((view, light));
        self.sheet.live(self.out, self.progress())
    }

    /// Takes a view's first photograph again, if that is asked for and was not done at the view's end already. What came of it
    /// is kept at the end, and earlier only if something moved. Whether it did, and is not only to be told, is the answer.
    fn look(
        &mut self,
        view: usize,
        first: usize,
        is_end: bool,
        arrived: &mut bool,
    ) -> Result<bool, SessionError> {
        let (Some(checks), Some(entry)) = (&mut self.checks, self.journal.get(view, first)) else {
            return Ok(false);
        };
        let tells = self.photographer.care.when_moved == WhenMoved::Tell;
        if let Some(check) = checks.get(view, first) {
            // Known from a session that ended then.
            return Ok(check.moved && !tells);
        }
        go(self.rig, arrived, view, first)?;
        let again = self.photographer.take(self.rig, view, first)?.image;
        let change = compare(&reread(&self.writer, entry)?, &again);
        let (moved, Change { shift, brighter, .. }) = (change.moved(), change);
        if moved || is_end {
            checks.add(Check { view, light: first, moved, shift, brighter })?;
        }
        if moved {
            tracing::warn!("view {view}: something moved while it was shot: {change}");
        }
        Ok(moved && !tells)
    }
}

/// Brings the rig to a view, unless it is there, and to a light.
fn go(rig: &mut dyn Rig, arrived: &mut bool, view: usize, light: usize) -> Result<(), SessionError> {
    let failed = |fault| SessionError::Rig { view, light, fault };
    if !*arrived {
        rig.view(view).map_err(failed)?;
        *arrived = true;
    }
    rig.light(light).map_err(failed)
}

/// A photograph that is on disk already. A session whose images are no longer what they were is refused: somebody else
/// was at them.
pub(super) fn reread(writer: &ReneWriter, entry: &Entry) -> Result<Image, SessionError> {
    let path = writer.image_path(entry.view, entry.light);
    if crc32fast::hash(&read_bytes(&path, LONGEST_IMAGE)?) == entry.crc32 {
        return Ok(read_image(&path)?);
    }
    let (view, light) = (entry.view, entry.light);
    let problem = format!("is not what was shot. Shoot it again: --resume --reshoot {view},{light}.");
    Err(SessionError::Other { path, problem })
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
