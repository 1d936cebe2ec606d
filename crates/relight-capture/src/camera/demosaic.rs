//! Filling in the colours that a mosaic of filters hides.

use serde::{Deserialize, Serialize};

/// Which colour filters lie over the first two pixels of the first two rows.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
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
    pub(super) fn red(self) -> [usize; 2] {
        match self {
            BayerPattern::Rggb => [0, 0],
            BayerPattern::Bggr => [1, 1],
            BayerPattern::Grbg => [1, 0],
            BayerPattern::Gbrg => [0, 1],
        }
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

/// Fills in the colours that a mosaic hides: RGB, row-major, in the mosaic's unit.
pub(super) fn demosaic(width: u32, height: u32, pattern: BayerPattern, mosaic: &[f32]) -> Vec<f32> {
    let (w, h) = (width as usize, height as usize);
    let red = pattern.red();
    let mut data = Vec::with_capacity(3 * mosaic.len());
    for y in 0..h {
        for x in 0..w {
            let filtered = |filter: &Filter| {
                let mut sum = 0.0;
                for (dy, row) in filter.iter().enumerate() {
                    for (dx, &tap) in row.iter().enumerate() {
                        // Mirrored about the outermost pixels, which keeps each filter's colour.
                        let [px, py] = [mirrored(x + dx, w), mirrored(y + dy, h)];
                        sum += tap as f32 * mosaic[py * w + px];
                    }
                }
                sum / 16.0
            };
            let here = mosaic[y * w + x];
            data.extend(match (x % 2 == red[0], y % 2 == red[1]) {
                (true, true) => [here, filtered(&GREEN), filtered(&ACROSS)],
                (false, false) => [filtered(&ACROSS), filtered(&GREEN), here],
                (false, true) => [filtered(&ALONG_ROW), here, filtered(&ALONG_COLUMN)],
                (true, false) => [filtered(&ALONG_COLUMN), here, filtered(&ALONG_ROW)],
            });
        }
    }
    data
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

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// What the filters let through of a linear picture.
    fn mosaic(
        pattern: BayerPattern,
        (w, h): (usize, usize),
        colour: impl Fn(usize, usize) -> [u8; 3],
    ) -> Vec<f32> {
        let red = pattern.red();
        let at = |x: usize, y: usize| match (x % 2 == red[0], y % 2 == red[1]) {
            (true, true) => colour(x, y)[0],
            (false, false) => colour(x, y)[2],
            _ => colour(x, y)[1],
        };
        (0..h).flat_map(|y| (0..w).map(move |x| (x, y))).map(|(x, y)| f32::from(at(x, y))).collect()
    }

    fn pattern() -> impl Strategy<Value = BayerPattern> {
        use BayerPattern::{Bggr, Gbrg, Grbg, Rggb};
        prop_oneof![Just(Rggb), Just(Bggr), Just(Grbg), Just(Gbrg)]
    }

    proptest! {
        #[test]
        fn one_colour_comes_back(pattern in pattern(), colour in any::<[u8; 3]>(), w in 3usize..12, h in 3usize..12) {
            let raw = mosaic(pattern, (w, h), |_, _| colour);
            let colours = demosaic(w as u32, h as u32, pattern, &raw);
            let expected = colour.map(f32::from);
            prop_assert!(colours.chunks(3).all(|pixel| pixel == expected), "{:?} {:?}", colours, expected);
        }

        /// The filters are exact on planes, of which each channel has its own slope here, if all slopes agree.
        #[test]
        fn slopes_come_back(pattern in pattern(), sx in 0usize..8, sy in 0usize..8, base in any::<[bool; 3]>()) {
            let colour = |x: usize, y: usize| base.map(|b| (20 + 40 * usize::from(b) + sx * x + sy * y) as u8);
            let raw = mosaic(pattern, (12, 12), colour);
            let colours = demosaic(12, 12, pattern, &raw);
            for y in 2..10 {
                for x in 2..10 {
                    prop_assert_eq!(&colours[3 * (12 * y + x)..][..3], &colour(x, y).map(f32::from));
                }
            }
        }
    }

    #[test]
    fn tiny_mosaics_are_harmless() {
        for (w, h) in [(1, 1), (2, 1), (1, 2), (2, 2)] {
            let colours = demosaic(w, h, BayerPattern::Rggb, &vec![9.0; (w * h) as usize]);
            assert_eq!(colours, vec![9.0; (3 * w * h) as usize]);
        }
    }
}
