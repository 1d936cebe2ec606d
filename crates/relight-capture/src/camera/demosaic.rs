//! From a raw mosaic to an sRGB image.

use relight_scene::Image;

/// Which colour filters lie over the first two pixels of the first two rows.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum BayerPattern {
    /// Red green, green blue.
    Rggb,
    /// Blue green, green red.
    Bggr,
    /// Green red, blue green.
    Grbg,
    /// Green blue, red green.
    Gbrg,
}

impl BayerPattern {
    /// Column and row of a red pixel, each 0 or 1.
    fn red(self) -> [usize; 2] {
        match self {
            BayerPattern::Rggb => [0, 0],
            BayerPattern::Bggr => [1, 1],
            BayerPattern::Grbg => [1, 0],
            BayerPattern::Gbrg => [0, 1],
        }
    }
}

/// How raw frames become images: the same for all of a session.
#[derive(Clone, Debug, PartialEq)]
pub struct Development {
    /// Gains of red, green and blue that make grey grey.
    pub white_balance: [f32; 3],
    /// What the sensor reports without light, 0 to 255.
    pub black_level: f32,
}

impl Default for Development {
    fn default() -> Self {
        Self { white_balance: [1.0; 3], black_level: 0.0 }
    }
}

/// The linear filters of Malvar, He and Cutler, "High-quality linear interpolation for demosaicing of Bayer-patterned
/// color images" (2004), figure 2, times 16. Each is the 5x5 neighbourhood of a pixel.
type Filter = [[i32; 5]; 5];

/// Green at a red or blue pixel.
const GREEN: Filter =
    [[0, 0, -2, 0, 0], [0, 0, 4, 0, 0], [-2, 4, 8, 4, -2], [0, 0, 4, 0, 0], [0, 0, -2, 0, 0]];
/// Red at a green pixel with red to its left and right; blue likewise.
const ALONG_ROW: Filter =
    [[0, 0, 1, 0, 0], [0, -2, 0, -2, 0], [-2, 8, 10, 8, -2], [0, -2, 0, -2, 0], [0, 0, 1, 0, 0]];
/// Red at a green pixel with red above and below; blue likewise.
const ALONG_COLUMN: Filter =
    [[0, 0, -2, 0, 0], [0, -2, 8, -2, 0], [1, 0, 10, 0, 1], [0, -2, 8, -2, 0], [0, 0, -2, 0, 0]];
/// Red at a blue pixel; blue at a red one.
const ACROSS: Filter =
    [[0, 0, -3, 0, 0], [0, 4, 0, 4, 0], [-3, 0, 12, 0, -3], [0, 4, 0, 4, 0], [0, 0, -3, 0, 0]];

impl Development {
    /// Fills in the colours that the mosaic hides, balances them, and encodes them as sRGB.
    pub(super) fn develop(&self, width: u32, height: u32, pattern: BayerPattern, raw: &[u8]) -> Image {
        let (w, h) = (width as usize, height as usize);
        let red = pattern.red();
        let mut data = Vec::with_capacity(3 * raw.len());
        for y in 0..h {
            for x in 0..w {
                let filtered = |filter: &Filter| {
                    let mut sum = 0;
                    for (dy, row) in filter.iter().enumerate() {
                        for (dx, &tap) in row.iter().enumerate() {
                            // Mirrored about the outermost pixels, which keeps each filter's colour.
                            let [px, py] = [mirrored(x + dx, w), mirrored(y + dy, h)];
                            sum += tap * i32::from(raw[py * w + px]);
                        }
                    }
                    sum as f32 / 16.0
                };
                let here = f32::from(raw[y * w + x]);
                let rgb = match (x % 2 == red[0], y % 2 == red[1]) {
                    (true, true) => [here, filtered(&GREEN), filtered(&ACROSS)],
                    (false, false) => [filtered(&ACROSS), filtered(&GREEN), here],
                    (false, true) => [filtered(&ALONG_ROW), here, filtered(&ALONG_COLUMN)],
                    (true, false) => [filtered(&ALONG_COLUMN), here, filtered(&ALONG_ROW)],
                };
                let scale = 255.0 - self.black_level;
                data.extend(
                    (0..3).map(|c| srgb((rgb[c] - self.black_level) / scale * self.white_balance[c])),
                );
            }
        }
        Image { width, height, data }
    }
}

/// Index two before `shifted`, mirrored into `0..n`.
fn mirrored(shifted: usize, n: usize) -> usize {
    let last = n as isize - 1;
    let mut index = shifted as isize - 2;
    if index < 0 {
        index = -index;
    }
    if index > last {
        index = 2 * last - index;
    }
    index.clamp(0, last) as usize
}

/// 8-bit sRGB of a linear value, clipped (IEC 61966-2-1).
fn srgb(linear: f32) -> u8 {
    let x = linear.clamp(0.0, 1.0);
    let encoded = if x <= 0.003_130_8 { 12.92 * x } else { 1.055 * x.powf(1.0 / 2.4) - 0.055 };
    (encoded * 255.0).round() as u8
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// What the filters let through of a linear picture.
    fn mosaic(
        pattern: BayerPattern,
        (w, h): (usize, usize),
        colour: impl Fn(usize, usize) -> [u8; 3],
    ) -> Vec<u8> {
        let red = pattern.red();
        let at = |x: usize, y: usize| match (x % 2 == red[0], y % 2 == red[1]) {
            (true, true) => colour(x, y)[0],
            (false, false) => colour(x, y)[2],
            _ => colour(x, y)[1],
        };
        (0..h).flat_map(|y| (0..w).map(move |x| (x, y))).map(|(x, y)| at(x, y)).collect()
    }

    fn pattern() -> impl Strategy<Value = BayerPattern> {
        use BayerPattern::{Bggr, Gbrg, Grbg, Rggb};
        prop_oneof![Just(Rggb), Just(Bggr), Just(Grbg), Just(Gbrg)]
    }

    proptest! {
        #[test]
        fn one_colour_comes_back(pattern in pattern(), colour in any::<[u8; 3]>(), w in 3usize..12, h in 3usize..12) {
            let raw = mosaic(pattern, (w, h), |_, _| colour);
            let image = Development::default().develop(w as u32, h as u32, pattern, &raw);
            let expected = colour.map(|c| srgb(f32::from(c) / 255.0));
            prop_assert!(image.data.chunks(3).all(|pixel| pixel == expected), "{:?} {:?}", image.data, expected);
        }

        /// The filters are exact on planes, of which each channel has its own slope here, if all slopes agree.
        #[test]
        fn slopes_come_back(pattern in pattern(), sx in 0usize..8, sy in 0usize..8, base in any::<[bool; 3]>()) {
            let colour = |x: usize, y: usize| base.map(|b| (20 + 40 * usize::from(b) + sx * x + sy * y) as u8);
            let raw = mosaic(pattern, (12, 12), colour);
            let image = Development::default().develop(12, 12, pattern, &raw);
            for y in 2..10 {
                for x in 2..10 {
                    let expected = colour(x, y).map(|c| srgb(f32::from(c) / 255.0));
                    prop_assert_eq!(&image.data[3 * (12 * y + x)..][..3], &expected);
                }
            }
        }
    }

    #[test]
    fn black_is_taken_away_and_white_is_balanced() {
        let development = Development { white_balance: [2.0, 1.0, 0.5], black_level: 15.0 };
        let raw = mosaic(BayerPattern::Grbg, (6, 6), |_, _| [75, 135, 255]);
        let image = development.develop(6, 6, BayerPattern::Grbg, &raw);
        assert!(image.data.iter().all(|&c| c == srgb(0.5)), "{:?}", image.data);
    }

    #[test]
    fn tiny_mosaics_are_harmless() {
        for (w, h) in [(1, 1), (2, 1), (1, 2), (2, 2)] {
            let image = Development::default().develop(w, h, BayerPattern::Rggb, &vec![9; (w * h) as usize]);
            assert_eq!(image.data.len(), (3 * w * h) as usize);
        }
    }
}
