//! Pinhole cameras with OpenCV's lens distortion.

use crate::distortion::{LENGTHS, distort, undistort};
use crate::pose::Pose;

/// The longest side of an image that is accepted.
pub(crate) const LONGEST_SIDE: u32 = 16_384;

/// How a camera maps directions to pixels. Pixel centres lie at integers.
#[derive(Clone, Debug, PartialEq)]
pub struct Intrinsics {
    /// Image width, pixels.
    pub width: u32,
    /// Image height, pixels.
    pub height: u32,
    /// Focal length along x, pixels.
    pub fx: f64,
    /// Focal length along y, pixels.
    pub fy: f64,
    /// Principal point, x, pixels.
    pub cx: f64,
    /// Principal point, y, pixels.
    pub cy: f64,
    /// Distortion coefficients in OpenCV's order: none, 4, 5, 8, 12 or 14 of them.
    pub distortion: Vec<f64>,
}

/// A camera of a scene: one viewpoint.
#[derive(Clone, Debug, PartialEq)]
pub struct Camera {
    /// The view's number in the folder (ReNe's view index: 13 for `00013_image.png`).
    pub label: usize,
    /// How it maps directions to pixels.
    pub intrinsics: Intrinsics,
    /// Camera-to-world; +X right, +Y down, +Z forward.
    pub pose: Pose,
}

impl Intrinsics {
    /// What is wrong with these numbers, if anything.
    pub(crate) fn fault(&self) -> Option<String> {
        let Intrinsics { width, height, fx, fy, cx, cy, distortion } = self;
        if !(1..=LONGEST_SIDE).contains(width) || !(1..=LONGEST_SIDE).contains(height) {
            return Some(format!(
                "the image size {width}x{height} is not within 1..{LONGEST_SIDE} pixels a side"
            ));
        }
        if !LENGTHS.contains(&distortion.len()) {
            let length = distortion.len();
            return Some(format!("{length} distortion coefficients: OpenCV knows 4, 5, 8, 12 or 14"));
        }
        if ![fx, fy, cx, cy].into_iter().chain(distortion).all(|v| v.is_finite()) {
            return Some("a number of the lens model is not finite".to_owned());
        }
        let longest = f64::from(LONGEST_SIDE);
        if !(1e-3..=1e3 * longest).contains(fx) || !(1e-3..=1e3 * longest).contains(fy) {
            return Some(format!("the focal length {fx} x {fy} pixels cannot be"));
        }
        if cx.abs() > 10.0 * longest || cy.abs() > 10.0 * longest {
            return Some(format!("the principal point {cx}, {cy} is far outside any image"));
        }
        None
    }

    /// The direction that pixel `(u, v)` sees, in the camera's frame, scaled to z = 1, lens distortion removed.
    pub fn unproject(&self, u: f64, v: f64) -> [f64; 3] {
        let distorted = [(u - self.cx) / self.fx, (v - self.cy) / self.fy];
        let [x, y] = if self.is_undistorted() { distorted } else { undistort(&self.distortion, distorted) };
        [x, y, 1.0]
    }

    /// The pixel at which a point of the camera's frame appears; `None` behind the camera. The pixel may lie outside
    /// the image.
    pub fn project(&self, p: [f64; 3]) -> Option<[f64; 2]> {
        if p[2] <= 0.0 {
            return None;
        }
        let pinhole = [p[0] / p[2], p[1] / p[2]];
        let [x, y] = if self.is_undistorted() { pinhole } else { distort(&self.distortion, pinhole) };
        Some([x * self.fx + self.cx, y * self.fy + self.cy])
    }

    /// The same lens over an image of another size: the picture's edges, half a pixel outside the outermost centres,
    /// stay where they are.
    pub fn resized(&self, width: u32, height: u32) -> Intrinsics {
        let sx = f64::from(width) / f64::from(self.width);
        let sy = f64::from(height) / f64::from(self.height);
        Intrinsics {
            width,
            height,
            fx: self.fx * sx,
            fy: self.fy * sy,
            cx: (self.cx + 0.5) * sx - 0.5,
            cy: (self.cy + 0.5) * sy - 0.5,
            distortion: self.distortion.clone(),
        }
    }

    /// Whether another lens is this one but for rounding.
    pub(crate) fn is_nearly(&self, other: &Intrinsics) -> bool {
        let numbers = |lens: &Intrinsics| {
            [lens.fx, lens.fy, lens.cx, lens.cy].into_iter().chain(lens.distortion.clone())
        };
        let is_near = |(a, b): (f64, f64)| (a - b).abs() <= 1e-6 * a.abs().max(1.0);
        (self.width, self.height, self.distortion.len())
            == (other.width, other.height, other.distortion.len())
            && numbers(self).zip(numbers(other)).all(is_near)
    }

    /// All numbers, bit by bit.
    pub(crate) fn bits(&self) -> Vec<u64> {
        let Intrinsics { width, height, fx, fy, cx, cy, distortion } = self;
        let numbers = [fx, fy, cx, cy].into_iter().chain(distortion).map(|number| number.to_bits());
        [u64::from(*width), u64::from(*height)].into_iter().chain(numbers).collect()
    }

    /// How far, in pixels, a round trip through the lens misses at the image's corners: large where the distortion
    /// model folds inside the image.
    pub(crate) fn round_trip_error(&self) -> f64 {
        let (right, bottom) = (f64::from(self.width) - 1.0, f64::from(self.height) - 1.0);
        let corners = [(0.0, 0.0), (right, 0.0), (0.0, bottom), (right, bottom)];
        let miss = |(u, v): (f64, f64)| match self.project(self.unproject(u, v)) {
            Some([x, y]) => (x - u).hypot(y - v),
            None => f64::INFINITY,
        };
        corners.into_iter().map(miss).fold(0.0, |worst, miss| if miss <= worst { worst } else { miss })
    }

    fn is_undistorted(&self) -> bool {
        self.distortion.iter().all(|&c| c == 0.0)
    }
}
