//! Looking features up.
//!
//! The outer loop runs over levels and all samples inside it, so that one level's table at a time lives in cache. What
//! a group of samples will want is asked of memory while the group before it is worked on, and the corners of a cell are read
//! once for all samples of a group that lie in it.

use fearless_simd::{Level, Simd, dispatch, f32x16, prelude::*};
use relight_field::engine::StageCost;

use super::corners::{ALL, Corners, GROUP};
use super::table::Table;
use super::{CORNERS, TiledPositions};

/// Bytes of a table that is not asked of memory ahead when samples are encoded.
const NEAR: usize = 1 << 18;
/// Changes of cell from one sample of a group to the next, up to which each cell's corners are read once for all samples in it.
const FEW: u32 = 8;

impl<const F: usize> Table<F> {
    pub(super) fn encode(&self, simd: Level, positions: TiledPositions<'_>, features: &mut [f32]) {
        dispatch!(simd, simd => self.encode_simd(simd, positions, features));
    }

    #[inline(always)]
    fn encode_simd<S: Simd>(&self, simd: S, positions: TiledPositions<'_>, features: &mut [f32]) {
        simd.vectorize(
            #[inline(always)]
            || {
                let TiledPositions { data, columns } = positions;
                let (tiles, groups) = (data.len() / (3 * columns), columns / GROUP);
                let count = self.levels.len() * tiles * groups;
                if count == 0 {
                    return;
                }
                let place = |i: usize| (i / (tiles * groups), i / groups % tiles, i % groups * GROUP);
                let (mut here, mut next) = (&mut Corners::default(), &mut Corners::default());
                self.group(simd, positions, place(0), next);
                for i in 0..count {
                    std::mem::swap(&mut here, &mut next);
                    self.group(simd, positions, place((i + 1).min(count - 1)), next);
                    let (l, tile, c) = place(i);
                    let table = self.level(l);
                    let rows = &mut features[(tile * self.outputs() + F * l) * columns..][..F * columns];
                    // Neighbouring pixels often are in few cells, and so are samples of a ray that meets a surface.
                    if here.changes.count_ones() <= FEW {
                        let mut left = ALL;
                        while left != 0 {
                            let first = left.trailing_zeros() as usize;
                            let alike = here.alike(simd, first);
                            left &= !alike.to_bitmask() as u32;
                            let mut sums = [f32x16::splat(simd, 0.0); F];
                            for corner in 0..CORNERS {
                                let entry = table[here.index[corner][first] as usize];
                                let weight = f32x16::from_slice(simd, &here.weight[corner]);
                                for (sum, value) in sums.iter_mut().zip(entry) {
                                    *sum = f32x16::splat(simd, value).mul_add(weight, *sum);
                                }
                            }
                            for (row, sum) in rows.chunks_exact_mut(columns).zip(sums) {
                                let row = &mut row[c..c + GROUP];
                                alike.select(sum, f32x16::from_slice(simd, row)).store_slice(row);
                            }
                        }
                        continue;
                    }
                    let mut sums = [[0.0f32; F]; GROUP];
                    for (i, sum) in sums.iter_mut().enumerate() {
                        for corner in 0..CORNERS {
                            let entry = table[here.index[corner][i] as usize];
                            let weight = here.weight[corner][i];
                            for (sum, value) in sum.iter_mut().zip(entry) {
                                *sum = value.mul_add(weight, *sum);
                            }
                        }
                    }
                    for (f, row) in rows.chunks_exact_mut(columns).enumerate() {
                        for (value, sum) in row[c..c + GROUP].iter_mut().zip(&sums) {
                            *value = sum[f];
                        }
                    }
                }
            },
        );
    }

    /// Finds the corners at level `l` around the group of samples of a tile that begins at column `c`, and asks memory for them.
    #[inline(always)]
    fn group<S: Simd>(
        &self,
        simd: S,
        positions: TiledPositions<'_>,
        (l, tile, c): (usize, usize, usize),
        corners: &mut Corners,
    ) {
        let columns = positions.columns;
        let tile = &positions.data[tile * 3 * columns..(tile + 1) * 3 * columns];
        corners.surround(simd, &self.levels[l], tile, columns, c);
        let table = self.level(l);
        // Smaller tables come from a near cache, sooner than asking pays.
        if size_of_val(table) > NEAR {
            corners.ask(table, |_| true);
        }
    }

    pub(super) fn encode_cost(&self, samples: usize) -> StageCost {
        let lookups = (samples * self.levels.len() * CORNERS) as f64;
        StageCost { operations: Self::OPERATIONS * lookups, lookups, ..StageCost::default() }
    }
}
