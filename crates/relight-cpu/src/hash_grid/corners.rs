//! The corners of the cells that samples lie in.

use fearless_simd::{Simd, f32x16, mask32x16, prelude::*, u32x16};
use relight_field::parameters::Level as GridLevel;

use super::CORNERS;
use crate::prefetch::ask;

/// Samples whose corners are worked out together.
pub const GROUP: usize = 16;

/// A bit for each of them.
pub const ALL: u32 = (1 << GROUP) - 1;

/// Primes of the spatial hash (Mueller et al. 2022, equation 4); the first is 1.
const PRIMES: [u32; 2] = [2_654_435_761, 805_459_861];

/// Entry indices and trilinear weights of the eight corners of a group of samples. A kilobyte, not to be copied about.
#[derive(Default)]
pub struct Corners {
    pub index: [[u32; GROUP]; CORNERS],
    pub weight: [[f32; GROUP]; CORNERS],
    /// A bit for each sample whose first entry is another than that of the sample before; the first has one too.
    pub changes: u32,
}

impl Corners {
    /// Becomes the corners around samples `c..c + GROUP` of a tile, whose positions are `[3][columns]`. Samples outside the
    /// cube are moved to its surface.
    #[inline(always)]
    pub fn surround<S: Simd>(
        &mut self,
        simd: S,
        level: &GridLevel,
        positions: &[f32],
        columns: usize,
        c: usize,
    ) {
        let side = level.resolution + 1;
        let strides = if level.hashed { PRIMES } else { [side, side.wrapping_mul(side)] };
        let (xs, rest) = positions.split_at(columns);
        let (ys, zs) = rest.split_at(columns);
        // Each called by itself: through a closure, vectors would go through memory.
        let (x, wx) = neighbours(simd, level, &xs[c..c + GROUP], 1);
        let (y, wy) = neighbours(simd, level, &ys[c..c + GROUP], strides[0]);
        let (z, wz) = neighbours(simd, level, &zs[c..c + GROUP], strides[1]);
        // The number of entries of a hashed level is a power of two.
        let mask = u32x16::splat(simd, level.entries as u32 - 1);
        for corner in 0..CORNERS {
            let [i, j, k] = [corner & 1, corner >> 1 & 1, corner >> 2];
            let index = if level.hashed { (x[i] ^ y[j] ^ z[k]) & mask } else { x[i] + y[j] + z[k] };
            index.store_slice(&mut self.index[corner]);
            if corner == 0 {
                let before = index.slide::<{ GROUP - 1 }>(index);
                self.changes = (1 | !index.simd_eq(before).to_bitmask() as u32) & ALL;
            }
            (wx[i] * wy[j] * wz[k]).store_slice(&mut self.weight[corner]);
        }
    }

    /// The samples of the group that have the same entries as sample `i`, as those in one cell do.
    #[inline(always)]
    pub fn alike<S: Simd>(&self, simd: S, i: usize) -> mask32x16<S> {
        let alike =
            |index: &[u32; GROUP]| u32x16::from_slice(simd, index).simd_eq(u32x16::splat(simd, index[i]));
        let mut all = alike(&self.index[0]);
        for index in &self.index[1..] {
            all &= alike(index);
        }
        all
    }

    /// Asks memory for the entries of all corners of those samples of the group that are `wanted` and begin at another entry than the
    /// sample before: the others' were asked for with that, most of the time.
    #[inline(always)]
    pub fn ask<E>(&self, entries: &[E], wanted: impl Fn(usize) -> bool) {
        let mut left = self.changes;
        while left != 0 {
            let i = left.trailing_zeros() as usize;
            left &= left - 1;
            if wanted(i) {
                self.index.iter().for_each(|index| ask(entries, index[i] as usize));
            }
        }
    }
}

/// The two vertices that coordinates lie between: what each contributes to an entry's index, and its weight.
#[inline(always)]
fn neighbours<S: Simd>(
    simd: S,
    level: &GridLevel,
    coordinates: &[f32],
    stride: u32,
) -> ([u32x16<S>; 2], [f32x16<S>; 2]) {
    let (zero, one) = (f32x16::splat(simd, 0.0), f32x16::splat(simd, 1.0));
    let cells = f32x16::splat(simd, level.resolution as f32);
    let scaled = f32x16::from_slice(simd, coordinates).max(zero).min(one) * cells;
    // A position on the upper face belongs to the last cell.
    let cell = scaled.to_int::<u32x16<S>>().min(u32x16::splat(simd, level.resolution - 1));
    let fraction = scaled - cell.to_float::<f32x16<S>>();
    let stride = u32x16::splat(simd, stride);
    let low = cell * stride;
    ([low, low + stride], [one - fraction, fraction])
}
