//! Frames as a sensor has them before a camera makes pictures of them, with the flaws that dark and flat frames take away.

use relight_scene::{Camera, Intrinsics, Light};

use super::VirtualRig;
use super::random::{hash, uniform};
use super::sensor::Shot;
use crate::camera::{BayerPattern, Frame};

/// What the sensor reports without light, of 255.
const BLACK: f64 = 8.0;
/// How many pixels are hot, as a share, and how much they report beside the light, levels.
const HOT: f32 = 1e-3;
const HOT_LEVEL: f64 = 40.0;
/// Signal of an evenly lit white target in the middle of the picture.
const WHITE: f64 = 0.7;
/// The number of a view that no session has: that of a target before the lens.
const TARGET: usize = usize::MAX;
/// Which filters lie where: red, green; green, blue.
const PATTERN: BayerPattern = BayerPattern::Rggb;

impl VirtualRig {
    /// Photographs a view under each of some lights, as [`photograph`](VirtualRig::photograph) does, in raw frames: a mosaic of
    /// colours, linear in light, with a black level of 8, some hot pixels, and darker to the edges by the fourth power of the
    /// cosine that a ray makes with the lens's axis.
    pub fn raw(&self, camera: &Camera, lights: &[Light]) -> Vec<Frame> {
        let lens = &camera.intrinsics;
        let frames = self.develop(camera, lights, |radiance, pixel, shot| {
            self.level(lens, pixel, |fall_off| {
                self.sensor.signal(radiance.map(|l| l * fall_off as f32), pixel, shot)
            })
        });
        frames.into_iter().map(|data| framed(lens, data)).collect()
    }

    /// The raw frame, one of several, of nothing at all before the lens, or of an evenly lit white target.
    pub(super) fn raw_target(&self, lens: &Intrinsics, is_white: bool, number: usize) -> Frame {
        let radiance = if is_white { WHITE / self.sensor.exposure } else { 0.0 };
        let shot =
            Shot { seed: self.settings.seed, camera: TARGET, light: 2 * number + usize::from(is_white) };
        let pixels = 0..lens.width as usize * lens.height as usize;
        let level = |pixel: usize| {
            self.level(lens, pixel, |fall_off| {
                self.sensor.signal([(radiance * fall_off) as f32; 3], pixel, shot)
            })
        };
        framed(lens, pixels.map(level).collect())
    }

    /// What a pixel reports, whose signal is asked for with the share of light that comes through the lens there.
    fn level(&self, lens: &Intrinsics, pixel: usize, signal: impl Fn(f64) -> [f64; 3]) -> u8 {
        let (x, y) = (pixel % lens.width as usize, pixel / lens.width as usize);
        let (u, v) = ((x as f64 - lens.cx) / lens.fx, (y as f64 - lens.cy) / lens.fy);
        let squared_cosine = 1.0 / (1.0 + u * u + v * v);
        let channel = x % 2 + y % 2;
        let hot = if uniform(hash(&[0x48_4F_54, pixel as u64])) < HOT { HOT_LEVEL } else { 0.0 };
        let level = BLACK + hot + (255.0 - BLACK) * signal(squared_cosine * squared_cosine)[channel];
        level.round().clamp(0.0, 255.0) as u8
    }
}

fn framed(lens: &Intrinsics, data: Vec<u8>) -> Frame {
    Frame::Raw { width: lens.width, height: lens.height, pattern: PATTERN, data }
}
