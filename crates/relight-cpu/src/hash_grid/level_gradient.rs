//! The gradient of one level's table: gathered from samples, then followed by Adam.

use fearless_simd::{Level, Simd, dispatch};
use relight_field::parameters::Level as GridLevel;

use super::corners::{Corners, GROUP};
use super::{CORNERS, Entry, EntryMoments, TileGradients};
use crate::adam::Adam;
use crate::prefetch::ask;

/// Entries that are asked of memory before their turn to be updated.
const UPDATES_AHEAD: usize = 16;

/// Gradient of one level, and which entries have some; all zero between levels.
pub struct LevelGradient {
    gradient: Vec<Entry>,
    /// A bit for each entry.
    touched: Vec<u64>,
    /// The entries whose bits are set, ascending.
    list: Vec<u32>,
}

impl LevelGradient {
    /// Zero gradient of up to `entries` entries.
    pub fn new(entries: usize) -> Self {
        let touched = vec![0; entries.div_ceil(64)];
        Self { gradient: vec![[0.0; 2]; entries], touched, list: Vec::new() }
    }

    /// Adds what the samples of all tiles say of level `l`. Returns how many samples had any gradient.
    pub fn scatter(
        &mut self,
        simd: Level,
        (l, level): (usize, &GridLevel),
        tiles: &[TileGradients<'_>],
    ) -> usize {
        let one = |&TileGradients { positions, gradients, columns }: &TileGradients<'_>| {
            let rows = &gradients[2 * l * columns..(2 * l + 2) * columns];
            dispatch!(simd, simd => self.scatter_tile(simd, level, positions, rows, columns))
        };
        tiles.iter().map(one).sum()
    }

    #[inline(always)]
    fn scatter_tile<S: Simd>(
        &mut self,
        simd: S,
        level: &GridLevel,
        positions: &[f32],
        rows: &[f32],
        columns: usize,
    ) -> usize {
        simd.vectorize(
            #[inline(always)]
            || {
                let (gradient, mut samples) = (&mut self.gradient[..level.entries], 0);
                let (row0, row1) = rows.split_at(columns);
                let learns = |c: usize| row0[c] != 0.0 || row1[c] != 0.0;
                let (mut here, mut next) = (&mut Corners::default(), &mut Corners::default());
                next.surround(simd, level, positions, columns, 0);
                next.ask(gradient, learns);
                for c in (0..columns).step_by(GROUP) {
                    std::mem::swap(&mut here, &mut next);
                    let after = (c + GROUP).min(columns - GROUP);
                    next.surround(simd, level, positions, columns, after);
                    next.ask(gradient, |i| learns(after + i));
                    for i in (0..GROUP).filter(|i| learns(c + i)) {
                        samples += 1;
                        for corner in 0..CORNERS {
                            let index = here.index[corner][i] as usize;
                            let weight = here.weight[corner][i];
                            let entry = &mut gradient[index];
                            entry[0] = row0[c + i].mul_add(weight, entry[0]);
                            entry[1] = row1[c + i].mul_add(weight, entry[1]);
                            self.touched[index / 64] |= 1 << (index % 64);
                        }
                    }
                }
                samples
            },
        )
    }

    /// Updates the touched entries in the order of their addresses, forgets the gradient, and returns how many they
    /// were.
    pub fn update(
        &mut self,
        table: &mut [Entry],
        moments: &mut [EntryMoments],
        rate: f32,
        adam: &Adam,
    ) -> usize {
        self.list.clear();
        for (word, touched) in self.touched.iter_mut().enumerate() {
            let mut bits = std::mem::take(touched);
            while bits != 0 {
                self.list.push((word * 64) as u32 + bits.trailing_zeros());
                bits &= bits - 1;
            }
        }
        for (i, &index) in self.list.iter().enumerate() {
            if let Some(&later) = self.list.get(i + UPDATES_AHEAD) {
                ask(moments, later as usize);
                ask(table, later as usize);
            }
            let index = index as usize;
            let g = std::mem::take(&mut self.gradient[index]);
            let (entry, state) = (&mut table[index], &mut moments[index]);
            state.updates = state.updates.saturating_add(1);
            let c = adam.corrections(state.updates);
            for f in 0..2 {
                adam.update(&mut entry[f], [&mut state.m[f], &mut state.v[f]], g[f], rate, c);
            }
        }
        self.list.len()
    }
}
