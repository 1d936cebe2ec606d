//! Cameras, lights and the box as lines.

use std::collections::HashSet;

use super::canvas::Canvas;
use crate::bounds::{Bounds, scene_bounds};
use crate::camera::Camera;
use crate::scene::Scene;
use crate::splits::Splits;
use crate::vector::{Vector, add, cross, dot, norm, scale, sub};

const BOX: [u8; 3] = [130; 3];
const AXES: [[u8; 3]; 3] = [[230, 60, 60], [60, 200, 60], [80, 120, 255]];
const TRAIN: [u8; 3] = [110, 160, 255];
const VAL: [u8; 3] = [80, 220, 120];
const TEST: [u8; 3] = [255, 80, 80];
const LIGHT: [u8; 3] = [255, 220, 80];
const TEST_LIGHT: [u8; 3] = [255, 140, 30];
/// Directions from which the poses are seen: aslant, and from above.
const FROM: [Vector; 2] = [[0.55, -0.7, 0.45], [0.0, -1e-3, 1.0]];
/// Length of a drawn camera, as a share of the box.
const CAMERA: f64 = 0.08;
const AXIS: f64 = 0.1;

/// An orthographic view onto a square of the canvas.
struct View {
    right: Vector,
    up: Vector,
    middle: Vector,
    pixels_a_metre: f64,
    centre: [f64; 2],
}

impl View {
    fn place(&self, p: Vector) -> [f64; 2] {
        let from = sub(p, self.middle);
        let (x, y) = (dot(from, self.right), dot(from, self.up));
        [self.centre[0] + x * self.pixels_a_metre, self.centre[1] - y * self.pixels_a_metre]
    }

    fn line(&self, canvas: &mut Canvas, from: Vector, to: Vector, colour: [u8; 3]) {
        canvas.line(self.place(from), self.place(to), colour);
    }
}

/// Draws the poses twice, one above the other, in squares of `side` pixels from `corner` down.
pub(super) fn draw(scene: &Scene, splits: &Splits, canvas: &mut Canvas, corner: [u32; 2], side: u32) {
    let bounds = scene_bounds(scene);
    let (lo, hi) = (bounds.lo.map(f64::from), bounds.hi.map(f64::from));
    let middle = scale(add(lo, hi), 0.5);
    let extent = norm(sub(hi, lo));
    let cameras = scene.cameras.iter().map(|camera| camera.pose.position());
    let positions = cameras.chain(scene.lights.iter().map(|light| light.pose.position()));
    let reach = positions.map(|p| norm(sub(p, middle))).fold(extent / 2.0, f64::max);
    for (index, from) in FROM.into_iter().enumerate() {
        let forward = scale(from, -1.0 / norm(from));
        let across = cross(forward, [0.0, 0.0, 1.0]);
        let right = scale(across, 1.0 / norm(across));
        let half = f64::from(side) / 2.0;
        let view = View {
            right,
            up: cross(right, forward),
            middle,
            pixels_a_metre: 0.95 * half / reach,
            centre: [
                f64::from(corner[0]) + half,
                f64::from(corner[1]) + half + index as f64 * f64::from(side),
            ],
        };
        draw_box(&view, canvas, &bounds);
        for (axis, colour) in AXES.into_iter().enumerate() {
            let mut tip = [0.0; 3];
            tip[axis] = AXIS * extent;
            view.line(canvas, [0.0; 3], tip, colour);
        }
        draw_poses(&view, canvas, scene, splits, CAMERA * extent);
    }
}

fn draw_box(view: &View, canvas: &mut Canvas, bounds: &Bounds) {
    let corner = |bits: usize| -> Vector {
        std::array::from_fn(|axis| {
            f64::from(if bits >> axis & 1 == 1 { bounds.hi[axis] } else { bounds.lo[axis] })
        })
    };
    for from in 0..8usize {
        for axis in (0..3).filter(|axis| from >> axis & 1 == 0) {
            view.line(canvas, corner(from), corner(from | 1 << axis), BOX);
        }
    }
}

fn draw_poses(view: &View, canvas: &mut Canvas, scene: &Scene, splits: &Splits, length: f64) {
    let cameras_of =
        |frames: &[usize]| frames.iter().map(|&frame| scene.frames[frame].camera).collect::<HashSet<_>>();
    let (train, val) = (cameras_of(&splits.train), cameras_of(&splits.val));
    let test = cameras_of(&splits.easy);
    for (index, camera) in scene.cameras.iter().enumerate() {
        let colour = match index {
            index if train.contains(&index) => TRAIN,
            index if val.contains(&index) => VAL,
            index if test.contains(&index) => TEST,
            _ => BOX,
        };
        draw_camera(view, canvas, camera, length, colour);
    }
    let test_lights: HashSet<usize> = splits.hard.iter().map(|&frame| scene.frames[frame].light).collect();
    for (index, light) in scene.lights.iter().enumerate() {
        let colour = if test_lights.contains(&index) { TEST_LIGHT } else { LIGHT };
        canvas.disc(view.place(light.pose.position()), 3, colour);
    }
}

/// A pyramid whose base is the image.
fn draw_camera(view: &View, canvas: &mut Canvas, camera: &Camera, length: f64, colour: [u8; 3]) {
    let lens = &camera.intrinsics;
    let (right, bottom) = (f64::from(lens.width) - 1.0, f64::from(lens.height) - 1.0);
    let corners = [(0.0, 0.0), (right, 0.0), (right, bottom), (0.0, bottom)]
        .map(|(u, v)| camera.pose.transform(scale(lens.unproject(u, v), length)));
    for (index, &corner) in corners.iter().enumerate() {
        view.line(canvas, camera.pose.position(), corner, colour);
        view.line(canvas, corner, corners[(index + 1) % 4], colour);
    }
}
