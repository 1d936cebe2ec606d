//! Whether two photographs of one view under one light show the same thing from the same place.

use nalgebra::{Matrix3, Vector3};
use relight_scene::Image;

/// A shift of less is none, pixels.
const SHIFT: f64 = 0.1;
/// ... nor is one of less than so many of its standard errors.
const SHIFT_ERRORS: f64 = 6.0;
/// Side of the blocks in which differences are averaged, pixels.
const BLOCK: usize = 8;
/// A mean difference of a block of less is none, levels.
const DIFFERENCE: f64 = 2.0;
/// ... nor is one of less than so many of its standard errors: noise of bright and dark places differs up to threefold.
const DIFFERENCE_ERRORS: f64 = 12.0;
/// Two photographs in a row whose brightness differs by more than this share: the lamp is not at rest.
const FLICKER: f64 = 0.02;
/// Standard deviation of the difference of two numbers that were rounded, levels.
const ROUNDING: f64 = 0.41;

/// How two photographs differ.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Change {
    /// How far the second is shifted to the right and down against the first, pixels.
    pub shift: [f64; 2],
    /// Whether that is more than noise.
    pub shifted: bool,
    /// Blocks of 8 pixels a side that differ by more than noise once shift and brightness are taken out.
    pub blocks: usize,
    /// By how much the second is brighter, as a share.
    pub brighter: f64,
}

impl Change {
    /// Whether something moved.
    pub fn moved(&self) -> bool {
        self.shifted || self.blocks > 0
    }

    /// Whether the light differs more than two photographs in a row may.
    pub fn flickered(&self) -> bool {
        self.brighter.abs() > FLICKER
    }
}

impl std::fmt::Display for Change {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let [x, y] = self.shift;
        if self.shifted {
            return write!(f, "the picture is shifted by {:.2} pixels ({x:+.2}, {y:+.2})", x.hypot(y));
        }
        if self.blocks > 0 {
            return write!(f, "{} places of 8x8 pixels differ", self.blocks);
        }
        write!(f, "the brightness differs by {:.1} %", 100.0 * self.brighter)
    }
}

/// Compares two photographs of the same size. One shift of the whole picture and one change of brightness are found by least
/// squares on the gradients (Lucas and Kanade 1981); what they leave is compared with noise, whose size is the median of
/// what is left.
pub fn compare(before: &Image, after: &Image) -> Change {
    let (w, h) = (before.width as usize, before.height as usize);
    let green = |image: &Image, x: usize, y: usize| f64::from(image.data[3 * (y * w + x) + 1]);
    let mean = |x: usize, y: usize| (green(before, x, y) + green(after, x, y)) / 2.0;
    let mut pixels = Vec::with_capacity(w * h);
    for y in 0..h {
        for x in 0..w {
            let slope = |lo: f64, hi: f64, distance: usize| (hi - lo) / distance.max(1) as f64;
            let (left, right) = (x.saturating_sub(1), (x + 1).min(w - 1));
            let (top, bottom) = (y.saturating_sub(1), (y + 1).min(h - 1));
            let along_x = slope(mean(left, y), mean(right, y), right - left);
            let along_y = slope(mean(x, top), mean(x, bottom), bottom - top);
            // A picture that is shifted by s is darker by its slope times s.
            pixels.push((
                Vector3::new(-along_x, -along_y, mean(x, y)),
                green(after, x, y) - green(before, x, y),
            ));
        }
    }
    // Hardly more than nothing on the diagonal: a picture without slopes tells of brightness, and of no shift.
    let (mut normal, mut right) = (Matrix3::identity() * 1e-3, Vector3::zeros());
    for (slopes, difference) in &pixels {
        normal += slopes * slopes.transpose();
        right += slopes * *difference;
    }
    let inverse = normal.try_inverse().unwrap_or_default();
    let found = inverse * right;
    let left: Vec<f64> = pixels.iter().map(|(slopes, difference)| difference - slopes.dot(&found)).collect();
    let noise = ROUNDING.max(1.4826 * median(left.iter().map(|value| value.abs()).collect()));
    let errors = [0, 1].map(|axis| noise * inverse[(axis, axis)].max(0.0).sqrt());
    let shift = [found[0], found[1]];
    let shifted = shift[0].hypot(shift[1]) > SHIFT.max(SHIFT_ERRORS * errors[0].hypot(errors[1]));
    let mut blocks = 0;
    for top in (0..h).step_by(BLOCK) {
        for begin in (0..w).step_by(BLOCK) {
            let (bottom, end) = ((top + BLOCK).min(h), (begin + BLOCK).min(w));
            let sum: f64 = (top..bottom).flat_map(|y| &left[y * w + begin..y * w + end]).sum();
            let count = ((bottom - top) * (end - begin)) as f64;
            if (sum / count).abs() > DIFFERENCE.max(DIFFERENCE_ERRORS * noise / count.sqrt()) {
                blocks += 1;
            }
        }
    }
    Change { shift, shifted, blocks, brighter: found[2] }
}

fn median(mut values: Vec<f64>) -> f64 {
    let middle = values.len() / 2;
    if values.is_empty() { 0.0 } else { *values.select_nth_unstable_by(middle, f64::total_cmp).1 }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const SIZE: (usize, usize) = (96, 64);

    /// Waves seen from a place, a disc that may lie elsewhere, a brightness, and noise that differs from one seed to another.
    fn picture(shift: [f64; 2], disc: f64, bright: f64, noise: f64, seed: u64) -> Image {
        let (w, h) = SIZE;
        let mut state = seed;
        let mut random = || {
            // Twelve uniform numbers make a normal one; splitmix64.
            (0..12)
                .map(|_| {
                    state = state.wrapping_add(0x9e37_79b9_7f4a_7c15);
                    let z = (state ^ (state >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
                    let z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
                    ((z ^ (z >> 31)) >> 11) as f64 / (1u64 << 53) as f64
                })
                .sum::<f64>()
                - 6.0
        };
        let mut data = Vec::new();
        for y in 0..h {
            for x in 0..w {
                let (u, v) = (x as f64 - shift[0], y as f64 - shift[1]);
                let waves = 110.0 + 50.0 * (0.35 * u + 0.1 * v).sin() * (0.3 * v).cos();
                let inside = (u - 50.0 - disc).hypot(v - 30.0) < 9.0;
                let value = bright * if inside { 200.0 } else { waves } + noise * random();
                data.extend([value.round().clamp(0.0, 255.0) as u8; 3]);
            }
        }
        Image { width: w as u32, height: h as u32, data }
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(24))]

        /// Noise and a lamp that drifts are no movement.
        #[test]
        fn noise_is_no_movement(noise in 0.0f64..8.0, bright in 0.95f64..1.05, seed in any::<u64>()) {
            let change = compare(&picture([0.0; 2], 0.0, 1.0, noise, seed), &picture([0.0; 2], 0.0, bright, noise, !seed));
            prop_assert!(!change.moved(), "{change:?}");
            prop_assert!((change.brighter - (bright - 1.0)).abs() < 0.01, "{change:?}");
        }

        /// A camera that moved by a quarter of a pixel is caught, and by how much is told.
        #[test]
        fn a_shift_is_found(angle in 0.0f64..std::f64::consts::TAU, length in 0.25f64..0.6, noise in 0.0f64..4.0, seed in any::<u64>()) {
            let shift = [length * angle.cos(), length * angle.sin()];
            let change = compare(&picture([0.0; 2], 0.0, 1.0, noise, seed), &picture(shift, 0.0, 1.0, noise, !seed));
            prop_assert!(change.shifted, "{change:?}");
            let off = (change.shift[0] - shift[0]).hypot(change.shift[1] - shift[1]);
            prop_assert!(off < 0.12, "{change:?} for {shift:?}");
        }

        /// So is a part that moved while the rest stood still.
        #[test]
        fn a_moved_part_is_found(by in 2.0f64..8.0, noise in 0.0f64..4.0, seed in any::<u64>()) {
            let change = compare(&picture([0.0; 2], 0.0, 1.0, noise, seed), &picture([0.0; 2], by, 1.0, noise, !seed));
            prop_assert!(change.moved(), "{change:?}");
        }
    }

    #[test]
    fn tiny_and_even_pictures_are_harmless() {
        for (width, height) in [(1, 1), (2, 1), (5, 3)] {
            let even = Image { width, height, data: vec![80; 3 * (width * height) as usize] };
            assert!(!compare(&even, &even).moved());
            let black = Image { data: vec![0; even.data.len()], ..even.clone() };
            assert!(!compare(&black, &black).moved());
            // What shows nothing but its brightness cannot move.
            let brighter = compare(&black, &even);
            assert!(
                !brighter.moved() && brighter.flickered() && (brighter.brighter - 2.0).abs() < 0.1,
                "{brighter:?}"
            );
        }
    }
}
