//! Where the pixels of training views look.
//!
//! Undoing a lens takes long, so the directions of all its pixels are worked out once and kept, as far as memory for
//! them goes: a rig has one lens, but a folder may name another one for every image. Beyond it directions are worked
//! out anew for each pixel that is drawn.

use rayon::prelude::*;
use relight_scene::Intrinsics;

/// Memory for tables of directions, bytes: some twenty lenses of 1440x1080.
pub const TABLES: usize = 1 << 28;

/// A lens and the directions of its pixels.
struct Lens {
    intrinsics: Intrinsics,
    /// Pixels a row.
    width: usize,
    /// What [`looks`] says of every pixel, row-major; empty where there was no memory left.
    table: Vec<[f32; 2]>,
}

/// The directions of the pixels of some lenses.
pub struct Directions {
    lenses: Vec<Lens>,
    /// Bytes left for tables.
    left: usize,
}

impl Directions {
    /// Of no lens so far, with so many bytes for tables.
    pub fn within(bytes: usize) -> Self {
        Self { lenses: Vec::new(), left: bytes }
    }

    /// The number of a lens, which is added unless it is there.
    pub fn number(&mut self, intrinsics: &Intrinsics) -> usize {
        if let Some(known) = self.lenses.iter().position(|lens| lens.intrinsics == *intrinsics) {
            return known;
        }
        let (width, height) = (intrinsics.width.max(1) as usize, intrinsics.height as usize);
        let bytes = width * height * size_of::<[f32; 2]>();
        let table = if bytes <= self.left {
            self.left -= bytes;
            (0..width * height).into_par_iter().map(|i| looks(intrinsics, i % width, i / width)).collect()
        } else {
            Vec::new()
        };
        self.lenses.push(Lens { intrinsics: intrinsics.clone(), width, table });
        self.lenses.len() - 1
    }

    /// Pixels in a row of a lens, by its number.
    pub fn width(&self, lens: usize) -> usize {
        self.lenses[lens].width
    }

    /// `[x, y]` of the camera-frame direction `(x, y, 1)` of a pixel, row-major, of a lens by its number; distortion
    /// removed.
    pub fn of(&self, lens: usize, pixel: usize) -> [f32; 2] {
        let Lens { intrinsics, width, table } = &self.lenses[lens];
        table.get(pixel).copied().unwrap_or_else(|| looks(intrinsics, pixel % width, pixel / width))
    }
}

fn looks(lens: &Intrinsics, x: usize, y: usize) -> [f32; 2] {
    let [x, y, _] = lens.unproject(x as f64, y as f64);
    [x as f32, y as f32]
}

#[cfg(test)]
mod tests {
    use super::*;

    fn lens(fx: f64) -> Intrinsics {
        let distortion = vec![-0.2, 0.05, 0.001, -0.002, 0.01];
        Intrinsics { width: 9, height: 7, fx, fy: 11.0, cx: 4.2, cy: 2.9, distortion }
    }

    #[test]
    fn directions_are_the_same_with_and_without_a_table() {
        let lenses: Vec<Intrinsics> = (0..5).map(|i| lens(10.0 + f64::from(i))).collect();
        // Room for two and a half.
        let of_one = 9 * 7 * 8;
        let mut few = Directions::within(2 * of_one + of_one / 2);
        let mut all = Directions::within(usize::MAX);
        for directions in [&mut few, &mut all] {
            let numbers: Vec<usize> =
                lenses.iter().chain(&lenses).map(|lens| directions.number(lens)).collect();
            assert_eq!(numbers, [0, 1, 2, 3, 4, 0, 1, 2, 3, 4]);
        }
        let tables = |d: &Directions| d.lenses.iter().map(|lens| lens.table.len()).collect::<Vec<_>>();
        assert_eq!((tables(&few), tables(&all)), (vec![63, 63, 0, 0, 0], vec![63; 5]));
        for (number, lens) in lenses.iter().enumerate() {
            for pixel in 0..63 {
                let [x, y, _] = lens.unproject((pixel % 9) as f64, (pixel / 9) as f64);
                assert_eq!(few.of(number, pixel), [x as f32, y as f32]);
                assert_eq!(few.of(number, pixel), all.of(number, pixel));
            }
        }
    }
}
