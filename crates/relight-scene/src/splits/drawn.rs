//! Splits of captures that have no published ones, drawn from a fixed seed.

use std::collections::{HashMap, HashSet};

use super::{HeldOut, Splits, by_held_out};
use crate::random::Random;
use crate::scene::Scene;

/// Fixed: the same capture has the same splits wherever it is opened.
const SEED: u64 = 2023;

/// ReNe's shares: 3 of 50 cameras for the test and as many for validation, 3 of 40 lights.
const CAMERAS: f64 = 3.0 / 50.0;
const LIGHTS: f64 = 3.0 / 40.0;
/// Lights under which a validation camera is looked at, and frames drawn where no camera can be spared.
const VAL_LIGHTS: usize = 3;
const VAL_FRAMES: usize = 9;
/// Fewer cameras than this and none is held out for validation alone; fewer lights and none is held out.
const FEW: usize = 5;

/// Numbers drawn one after another.
struct Draws(Random);

impl Draws {
    fn new() -> Draws {
        Draws(Random::from_state(SEED))
    }

    /// Takes `count` of the items out, at random.
    fn take(&mut self, items: &mut Vec<usize>, count: usize) -> Vec<usize> {
        let count = count.min(items.len());
        let taken = (0..count as u64)
            .map(|n| items.swap_remove((self.0.u64_at(n) % items.len() as u64) as usize))
            .collect();
        self.0 = self.0.after(count as u64);
        taken
    }
}

/// A share of a count, at least one.
fn share(count: usize, share: f64) -> usize {
    ((count as f64 * share).round() as usize).max(1)
}

/// Draws a capture's splits. Where cameras meet lights in a grid, whole cameras and lights are held out as in ReNe:
/// `hard` stays empty with fewer than 5 lights, and with one camera there is no test at all. Where each light is used
/// once there are no lights to hold out: a share of the frames is the test, `hard` since training has not seen their lights.
pub(super) fn draw(scene: &Scene) -> Splits {
    let mut random = Draws::new();
    let is_grid = scene.frames.len() > scene.lights.len();
    let mut cameras: Vec<usize> = (0..scene.cameras.len()).collect();
    let mut lights: Vec<usize> = (0..scene.lights.len()).collect();
    let test_cameras = if cameras.len() > 1 {
        let count = share(cameras.len(), CAMERAS);
        random.take(&mut cameras, count)
    } else {
        Vec::new()
    };
    let test_lights = if is_grid && lights.len() >= FEW {
        let count = share(lights.len(), LIGHTS);
        random.take(&mut lights, count)
    } else {
        Vec::new()
    };
    let val_cameras = if is_grid && cameras.len() + test_cameras.len() >= FEW {
        let count = test_cameras.len();
        random.take(&mut cameras, count)
    } else {
        Vec::new()
    };
    let test_lights: HashSet<usize> = test_lights.into_iter().collect();
    let mut val = HashMap::new();
    for camera in val_cameras {
        let frames = scene.frames.iter().filter(|f| f.camera == camera && !test_lights.contains(&f.light));
        let mut under: Vec<usize> = frames.map(|frame| frame.light).collect();
        val.insert(camera, random.take(&mut under, VAL_LIGHTS).into_iter().collect());
    }
    let held_out = HeldOut { test_cameras: test_cameras.into_iter().collect(), test_lights, val };
    with_validation(by_held_out(scene, &held_out)).told_by_light(scene)
}

/// Where there are no validation frames, takes a few out of the training ones.
pub(super) fn with_validation(mut splits: Splits) -> Splits {
    if splits.val.is_empty() && splits.train.len() > 1 {
        let count = VAL_FRAMES.min(share(splits.train.len(), CAMERAS));
        splits.val = Draws::new().take(&mut splits.train, count);
        splits.val.sort_unstable();
        splits.train.sort_unstable();
    }
    splits
}
