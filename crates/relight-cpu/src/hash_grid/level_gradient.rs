//! The gradient of one level's table: gathered from samples, then followed by Adam.

use std::iter::repeat_n;

use fearless_simd::{Level, Simd, dispatch};
use relight_field::parameters::Level as GridLevel;

use super::corners::{Corners, GROUP};
use super::table::EntryMoments;
use super::{CORNERS, TileGradients};
use crate::adam::Adam;
use crate::huge_pages;
use crate::prefetch::ask;

/// Entries that are asked of memory before their turn to be updated.
const UPDATES_AHEAD: usize = 16;

/// Gradient of one level, and which entries have some; all zero between levels.
pub struct LevelGradient<const F: usize> {
    gradient: Vec<[f32; F]>,
    /// A bit for each entry.
    touched: Vec<u64>,
    /// The entries whose bits are set, ascending.
    list: Vec<u32>,
}

impl<const F: usize> LevelGradient<F> {
    /// Zero gradient of up to `entries` entries.
    pub fn new(entries: usize) -> Self {
        let touched = vec![0; entries.div_ceil(64)];
        let gradient = huge_pages::collect(repeat_n([0.0; F], entries));
        Self { gradient, touched, list: Vec::new() }
    }

    /// Adds what the samples of all tiles say of level `l`. Returns how many samples had any gradient.
    pub fn scatter(
        &mut self,
        simd: Level,
        (l, level): (usize, &GridLevel),
        tiles: &[TileGradients<'_>],
    ) -> usize {
        let one = |&TileGradients { positions, gradients, columns }: &TileGradients<'_>| {
            let rows = &gradients[F * l * columns..(F * l + F) * columns];
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
                let rows: [&[f32]; F] = std::array::from_fn(|f| &rows[f * columns..(f + 1) * columns]);
                let learns = |c: usize| rows.iter().any(|row| row[c] != 0.0);
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
                        let values = rows.map(|row| row[c + i]);
                        for corner in 0..CORNERS {
                            let index = here.index[corner][i] as usize;
                            let weight = here.weight[corner][i];
                            let entry = &mut gradient[index];
                            for (sum, value) in entry.iter_mut().zip(values) {
                                *sum = value.mul_add(weight, *sum);
                            }
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
        simd: Level,
        table: &mut [[f32; F]],
        moments: &mut [EntryMoments<F>],
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
        dispatch!(simd, simd => simd.vectorize(
            #[inline(always)]
            || {
                for (i, &index) in self.list.iter().enumerate() {
                    if let Some(&later) = self.list.get(i + UPDATES_AHEAD) {
                        ask(moments, later as usize);
                        ask(table, later as usize);
                    }
                    let index = index as usize;
                    let g = std::mem::replace(&mut self.gradient[index], [0.0; F]);
                    let (entry, state) = (&mut table[index], &mut moments[index]);
                    state.updates = state.updates.saturating_add(1);
                    let c = adam.corrections(state.updates);
                    for f in 0..F {
                        adam.update(&mut entry[f], [&mut state.m[f], &mut state.v[f]], g[f], rate, c);
                    }
                }
            }
        ));
        self.list.len()
    }
}
