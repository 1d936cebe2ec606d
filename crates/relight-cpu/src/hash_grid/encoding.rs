//! Looking features up.
//!
//! The outer loop runs over levels and all samples inside it, so that one level's table at a time lives in cache. What
//! a group of samples will want is asked of memory while the group before it is worked on, and the corners of a cell are read
//! once for all samples of a group that lie in it.

use fearless_simd::{Level, Simd, dispatch, f32x16, prelude::*};
use relight_field::engine::StageCost;

use super::corners::{ALL, Corners, GROUP};
use super::{CORNERS, Entry, HashGrid, OPERATIONS, TiledPositions};

/// Bytes of a table that is not asked of memory ahead when samples are encoded.
const NEAR: usize = 1 << 18;
/// Changes of cell from one sample of a group to the next, up to which each cell's corners are read once for all samples in it.
const FEW: u32 = 8;

impl HashGrid {
    /// Encodes all tiles: `features` is `[tile][2 * levels][columns]`.
    pub fn encode(&self, simd: Level, positions: TiledPositions<'_>, features: &mut [f32]) {
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
                    let table = self.table_of(l);
                    let rows = &mut features[(tile * self.outputs() + 2 * l) * columns..][..2 * columns];
                    let (row0, row1) = rows.split_at_mut(columns);
                    let (row0, row1) = (&mut row0[c..c + GROUP], &mut row1[c..c + GROUP]);
                    // Neighbouring pixels often are in few cells, and so are samples of a ray that meets a surface.
                    if here.changes.count_ones() <= FEW {
                        let mut left = ALL;
                        while left != 0 {
                            let first = left.trailing_zeros() as usize;
                            let alike = here.alike(simd, first);
                            left &= !alike.to_bitmask() as u32;
                            let mut sum = [f32x16::splat(simd, 0.0); 2];
                            for corner in 0..CORNERS {
                                let entry = table[here.index[corner][first] as usize];
                                let weight = f32x16::from_slice(simd, &here.weight[corner]);
                                sum[0] = f32x16::splat(simd, entry[0]).mul_add(weight, sum[0]);
                                sum[1] = f32x16::splat(simd, entry[1]).mul_add(weight, sum[1]);
                            }
                            for (row, sum) in [&mut *row0, &mut *row1].into_iter().zip(sum) {
                                alike.select(sum, f32x16::from_slice(simd, row)).store_slice(row);
                            }
                        }
                        continue;
                    }
                    for i in 0..GROUP {
                        let mut sum = [0.0; 2];
                        for corner in 0..CORNERS {
                            let entry = table[here.index[corner][i] as usize];
                            let weight = here.weight[corner][i];
                            sum[0] = entry[0].mul_add(weight, sum[0]);
                            sum[1] = entry[1].mul_add(weight, sum[1]);
                        }
                        row0[i] = sum[0];
                        row1[i] = sum[1];
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
        let table = self.table_of(l);
        // Smaller tables come from a near cache, sooner than asking pays.
        if size_of_val(table) > NEAR {
            corners.ask(table, |_| true);
        }
    }

    /// The entries of level `l`.
    fn table_of(&self, l: usize) -> &[Entry] {
        let level = &self.levels[l];
        &self.table[level.offset..level.offset + level.entries]
    }

    /// What encoding so many samples takes, but for the time.
    pub fn encode_cost(&self, samples: usize) -> StageCost {
        let lookups = (samples * self.levels.len() * CORNERS) as f64;
        StageCost { operations: OPERATIONS * lookups, lookups, ..StageCost::default() }
    }
}
