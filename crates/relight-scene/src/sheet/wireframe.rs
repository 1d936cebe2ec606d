//! Cameras, lights and the box as lines.

use std::collections::HashSet;

use crate::bounds::scene_bounds;
use crate::drawing::{Canvas, Colour, View};
use crate::scene::Scene;
use crate::splits::Splits;
use crate::vector::{Vector, add, norm, scale, sub};

const BOX: Colour = [130; 3];
const AXES: [Colour; 3] = [[230, 60, 60], [60, 200, 60], [80, 120, 255]];
const TRAIN: Colour = [110, 160, 255];
const VAL: Colour = [80, 220, 120];
const TEST: Colour = [255, 80, 80];
const LIGHT: Colour = [255, 220, 80];
const TEST_LIGHT: Colour = [255, 140, 30];
/// Directions from which the poses are seen: aslant, and from above.
const FROM: [Vector; 2] = [[0.55, -0.7, 0.45], [0.0, 0.0, 1.0]];
/// Length of a drawn camera, as a share of the box.
const CAMERA: f64 = 0.08;
const AXIS: f64 = 0.1;
/// Width of lines, pixels.
const WIDTH: f64 = 1.5;

/// Draws the poses twice, one above the other, in squares of `side` pixels from `corner` down.
pub(super) fn draw(scene: &Scene, splits: &Splits, canvas: &mut Canvas, corner: [u32; 2], side: u32) {
    let bounds = scene_bounds(scene);
    let (lo, hi) = (bounds.lo.map(f64::from), bounds.hi.map(f64::from));
    let middle = scale(add(lo, hi), 0.5);
    let extent = norm(sub(hi, lo));
    let cameras = scene.cameras.iter().map(|camera| camera.pose.position());
    let positions = cameras.chain(scene.lights.iter().map(|light| light.pose.position()));
    let reach = positions.map(|p| norm(sub(p, middle))).fold(extent / 2.0, f64::max);
    let half = f64::from(side) / 2.0;
    for (index, from) in FROM.into_iter().enumerate() {
        let centre =
            [f64::from(corner[0]) + half, f64::from(corner[1]) + half + index as f64 * f64::from(side)];
        let view = View::new(from, middle, centre, 0.95 * half / reach);
        view.cuboid(canvas, lo, hi, WIDTH, BOX);
        for (axis, colour) in AXES.into_iter().enumerate() {
            let mut tip = [0.0; 3];
            tip[axis] = AXIS * extent;
            view.line(canvas, [0.0; 3], tip, WIDTH, colour);
        }
        draw_poses(&view, canvas, scene, splits, CAMERA * extent);
    }
}

fn draw_poses(view: &View, canvas: &mut Canvas, scene: &Scene, splits: &Splits, length: f64) {
    let cameras_of =
        |frames: &[usize]| frames.iter().map(|&frame| scene.frames[frame].camera).collect::<HashSet<_>>();
    let (train, val) = (cameras_of(&splits.train), cameras_of(&splits.val));
    let test = &cameras_of(&splits.easy) | &cameras_of(&splits.hard);
    for (index, camera) in scene.cameras.iter().enumerate() {
        let colour = match index {
            index if train.contains(&index) => TRAIN,
            index if val.contains(&index) => VAL,
            index if test.contains(&index) => TEST,
            _ => BOX,
        };
        view.camera(canvas, &camera.pose, &camera.intrinsics, length, WIDTH, colour);
    }
    let test_lights: HashSet<usize> = splits.hard.iter().map(|&frame| scene.frames[frame].light).collect();
    for (index, light) in scene.lights.iter().enumerate() {
        let colour = if test_lights.contains(&index) { TEST_LIGHT } else { LIGHT };
        canvas.disc(view.place(light.pose.position()), 3.0, colour);
    }
}
