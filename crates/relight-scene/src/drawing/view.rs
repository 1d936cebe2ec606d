//! What lies in the world, drawn without perspective.

use super::canvas::{Canvas, Colour};
use crate::camera::Intrinsics;
use crate::pose::Pose;
use crate::vector::{Vector, add, cross, dot, norm, scale, sub, unit};

/// An orthographic view of the world onto a canvas, +Z as far up as it can be.
pub struct View {
    right: Vector,
    up: Vector,
    /// The world point that is drawn at `centre`.
    middle: Vector,
    /// Where on the canvas, pixels.
    centre: [f64; 2],
    pixels_a_metre: f64,
}

impl View {
    /// A view from the direction `from`, which draws the world point `middle` at the pixel `centre`.
    pub fn new(from: [f64; 3], middle: [f64; 3], centre: [f64; 2], pixels_a_metre: f64) -> View {
        let forward = scale(from, -1.0 / norm(from));
        // Straight from above, +Y is up.
        let right = unit(cross(forward, [0.0, 0.0, 1.0])).unwrap_or([1.0, 0.0, 0.0]);
        View { right, up: cross(right, forward), middle, centre, pixels_a_metre }
    }

    /// The view from `from` in which `points` just fit into a canvas of `size` less `margin` on each side, pixels.
    pub fn fitting(from: [f64; 3], points: &[[f64; 3]], size: [u32; 2], margin: f64) -> View {
        let size = size.map(f64::from);
        let mut view = View::new(from, [0.0; 3], [0.0; 2], 1.0);
        let mut ranges = [[f64::INFINITY, f64::NEG_INFINITY]; 2];
        for &point in points {
            for (range, place) in ranges.iter_mut().zip(view.place(point)) {
                *range = [range[0].min(place), range[1].max(place)];
            }
        }
        let fits = |axis: usize| (size[axis] - 2.0 * margin) / (ranges[axis][1] - ranges[axis][0]);
        let [x, y] = ranges.map(|[lo, hi]| (lo + hi) / 2.0);
        view.pixels_a_metre = fits(0).min(fits(1));
        view.centre = size.map(|side| side / 2.0);
        view.middle = add(scale(view.right, x), scale(view.up, -y));
        view
    }

    /// Where a world point is drawn, pixels.
    pub fn place(&self, p: [f64; 3]) -> [f64; 2] {
        let from = sub(p, self.middle);
        let (x, y) = (dot(from, self.right), dot(from, self.up));
        [self.centre[0] + x * self.pixels_a_metre, self.centre[1] - y * self.pixels_a_metre]
    }

    /// How much nearer than the view's middle a world point is to the viewer, metres.
    pub fn nearness(&self, p: [f64; 3]) -> f64 {
        dot(sub(p, self.middle), cross(self.right, self.up))
    }

    /// Pixels that a metre takes, whichever way it lies across the view.
    pub fn pixels_a_metre(&self) -> f64 {
        self.pixels_a_metre
    }

    /// A line between two world points, `width` in pixels.
    pub fn line(&self, canvas: &mut Canvas, from: [f64; 3], to: [f64; 3], width: f64, colour: Colour) {
        canvas.line(self.place(from), self.place(to), width, colour);
    }

    /// The edges of a box with the corners `lo` and `hi`.
    pub fn cuboid(&self, canvas: &mut Canvas, lo: [f64; 3], hi: [f64; 3], width: f64, colour: Colour) {
        let corner = |bits: usize| -> Vector {
            std::array::from_fn(|axis| if bits >> axis & 1 == 1 { hi[axis] } else { lo[axis] })
        };
        for from in 0..8usize {
            for axis in (0..3).filter(|axis| from >> axis & 1 == 0) {
                self.line(canvas, corner(from), corner(from | 1 << axis), width, colour);
            }
        }
    }

    /// A camera: a pyramid whose base, `length` metres ahead, is the image.
    pub fn camera(
        &self,
        canvas: &mut Canvas,
        pose: &Pose,
        lens: &Intrinsics,
        length: f64,
        width: f64,
        colour: Colour,
    ) {
        let (right, bottom) = (f64::from(lens.width) - 1.0, f64::from(lens.height) - 1.0);
        let corners = [(0.0, 0.0), (right, 0.0), (right, bottom), (0.0, bottom)]
            .map(|(u, v)| pose.transform(scale(lens.unproject(u, v), length)));
        for (index, &corner) in corners.iter().enumerate() {
            self.line(canvas, pose.position(), corner, width, colour);
            self.line(canvas, corner, corners[(index + 1) % 4], width, colour);
        }
    }
}
