//! Everything that is wrong with a folder.

use std::path::Path;
use std::sync::atomic::{AtomicUsize, Ordering};

use rayon::prelude::*;
use serde::Serialize;

use crate::error::{Fault, FaultKind, Faults, Severity};
use crate::formats;
use crate::scene::Scene;
use crate::splits::Splits;

/// What a folder's check found.
#[derive(Clone, Debug, Serialize)]
pub struct Report {
    /// All faults: of files and text first, then of poses, then of images in the order of the frames.
    pub faults: Vec<Fault>,
    /// Images that were decoded whole.
    pub images: usize,
}

impl Report {
    /// Faults of one severity.
    pub fn count(&self, severity: Severity) -> usize {
        self.faults.iter().filter(|fault| fault.severity == severity).count()
    }

    /// Whether nothing makes the scene unusable; there may be warnings.
    pub fn is_usable(&self) -> bool {
        self.count(Severity::Error) == 0
    }
}

/// Lists every fault of a folder: what [`Scene::open`] would refuse it for, and all that shows only when every image is
/// decoded. Nothing is written. `progress` is told how many images are done, and of how many.
pub fn check(path: &Path, progress: &(dyn Fn(usize, usize) + Sync)) -> Report {
    let (scene, mut faults) = formats::read(path);
    let images = scene.map_or(0, |scene| check_images(&scene, progress, &mut faults));
    Report { faults: faults.0, images }
}

/// Decodes all images; returns how many could be.
fn check_images(scene: &Scene, progress: &(dyn Fn(usize, usize) + Sync), faults: &mut Faults) -> usize {
    let total = scene.frames.len();
    let done = AtomicUsize::new(0);
    let blackness: Vec<_> = (0..total)
        .into_par_iter()
        .map(|frame| {
            let is_black = scene.read_frame(frame).map(|image| image.is_black());
            progress(done.fetch_add(1, Ordering::Relaxed) + 1, total);
            is_black
        })
        .collect();
    let is_black: Vec<Option<bool>> = blackness.into_iter().map(|result| faults.keep(result)).collect();
    if let Some(splits) = faults.keep(Splits::peek(scene)) {
        faults.keep(splits.check_training(scene));
        faults.0.extend(splits.left_out(scene));
        check_black(scene, &splits, &is_black, faults);
        if splits.easy.is_empty() && splits.hard.is_empty() {
            let problem = "no view is held out for a test";
            let mend = "To score novel views, capture two or more, and hold one out in the splits.";
            faults.note(FaultKind::Split, &scene.root, problem, mend);
        }
    }
    is_black.iter().flatten().count()
}

/// Black images are as they should be in the official test, and nowhere else.
fn check_black(scene: &Scene, splits: &Splits, is_black: &[Option<bool>], faults: &mut Faults) {
    let black = |frames: &[usize]| frames.iter().filter(|&&frame| is_black[frame] == Some(true)).count();
    let tests = splits.easy.len() + splits.hard.len();
    let black_tests = black(&splits.easy) + black(&splits.hard);
    if black_tests > 0 {
        let problem = format!("{black_tests} of {tests} test images are black");
        let mend = "The official release blacks out its test images so that nobody trains on them: this is not \
                    corruption. They cannot be scored here; all else works.";
        faults.note(FaultKind::Black, &scene.root, problem, mend);
    }
    for &frame in splits.train.iter().chain(&splits.val).filter(|&&frame| is_black[frame] == Some(true)) {
        let problem = "the image is all black, but it is no test image";
        let mend = "Only test images are blacked out on purpose: fetch or capture this one again.";
        faults.error(FaultKind::Black, &scene.frames[frame].path, problem, mend);
    }
}
