//! The entries of all levels, and one step of their optimiser.

use std::iter::repeat_n;

use fearless_simd::Level;
use rayon::prelude::*;
use relight_field::parameters::{GridConfig, Level as GridLevel};

use super::level_gradient::LevelGradient;
use super::{CORNERS, TileGradients};
use crate::adam::{Adam, UPDATE_OPERATIONS};
use crate::huge_pages;
use crate::pool::Pool;
use crate::stages::{Clock, Costs, Stage};

/// Adam's state of one entry.
#[derive(Clone, Copy)]
pub struct EntryMoments<const F: usize> {
    pub m: [f32; F],
    pub v: [f32; F],
    pub updates: u32,
}

/// Entries of `F` features each, with their optimiser.
pub struct Table<const F: usize> {
    pub(super) levels: Vec<GridLevel>,
    table: Vec<[f32; F]>,
    /// Empty until the first step: drawing needs none.
    moments: Vec<EntryMoments<F>>,
    /// Gradient accumulators of one level, one for each thread at work; all zero between levels.
    scratch: Pool<LevelGradient<F>>,
    largest: usize,
}

impl<const F: usize> EntryMoments<F> {
    const ZERO: Self = Self { m: [0.0; F], v: [0.0; F], updates: 0 };
}

impl<const F: usize> Table<F> {
    /// Operations of a corner: its weight, and what it adds to features or gets from them; the fractions that all
    /// corners share in part.
    pub(super) const OPERATIONS: f64 = 2.75 + 2.0 * F as f64;
    /// Bytes of an entry, its moments and its gradient, read and written.
    const ENTRY_BYTES: usize = 2 * (2 * size_of::<[f32; F]>() + size_of::<EntryMoments<F>>());

    pub(super) fn new(config: &GridConfig, table: &[f32]) -> Self {
        let levels = config.level_table();
        let table = huge_pages::collect(table.as_chunks().0.iter().copied());
        let largest = levels.iter().map(|l| l.entries).max().unwrap_or(0);
        Self { levels, moments: Vec::new(), table, scratch: Pool::default(), largest }
    }

    pub(super) fn entries(&self) -> Vec<f32> {
        self.table.as_flattened().to_vec()
    }

    /// The entries of level `l`.
    pub(super) fn level(&self, l: usize) -> &[[f32; F]] {
        let level = &self.levels[l];
        &self.table[level.offset..level.offset + level.entries]
    }

    pub(super) fn outputs(&self) -> usize {
        F * self.levels.len()
    }

    pub(super) fn moments(&self) -> (Vec<f32>, Vec<f32>, Vec<u32>) {
        if self.moments.is_empty() {
            let n = self.table.len();
            return (vec![0.0; F * n], vec![0.0; F * n], vec![0; n]);
        }
        let m = self.moments.iter().flat_map(|e| e.m).collect();
        let v = self.moments.iter().flat_map(|e| e.v).collect();
        (m, v, self.moments.iter().map(|e| e.updates).collect())
    }

    pub(super) fn set_moments(&mut self, m: &[f32], v: &[f32], updates: &[u32]) -> bool {
        let n = self.table.len();
        if m.len() != F * n || v.len() != F * n || updates.len() != n {
            return false;
        }
        let pairs = m.as_chunks::<F>().0.iter().zip(v.as_chunks::<F>().0).zip(updates);
        self.moments = huge_pages::collect(pairs.map(|((&m, &v), &updates)| EntryMoments { m, v, updates }));
        true
    }

    pub(super) fn step(&mut self, simd: Level, tiles: &[TileGradients<'_>], rate: f32, adam: &Adam) -> Costs {
        let largest = self.largest;
        if self.moments.is_empty() {
            self.moments = huge_pages::collect(repeat_n(EntryMoments::ZERO, self.table.len()));
        }
        let mut tasks = Vec::with_capacity(self.levels.len());
        let (mut table, mut moments) = (&mut self.table[..], &mut self.moments[..]);
        for (l, level) in self.levels.iter().enumerate() {
            let (t, rest_t) = table.split_at_mut(level.entries);
            let (m, rest_m) = moments.split_at_mut(level.entries);
            (table, moments) = (rest_t, rest_m);
            tasks.push((l, level, t, m));
        }
        // The finest levels take longest, so they start first.
        tasks.reverse();
        let pool = &self.scratch;
        let one =
            |(l, level, table, moments): (usize, &GridLevel, &mut [[f32; F]], &mut [EntryMoments<F>])| {
                pool.with(
                    || LevelGradient::new(largest),
                    |gradient| {
                        let mut clock = Clock::default();
                        let samples = gradient.scatter(simd, (l, level), tiles);
                        clock.lap(Stage::Scatter, 0);
                        let touched = gradient.update(simd, table, moments, rate, adam);
                        clock.lap(Stage::OptimiseGrid, F * UPDATE_OPERATIONS * touched);
                        let mut costs = *clock.costs();
                        let updates = (CORNERS * samples) as f64;
                        costs.of(Stage::Scatter).updates = updates;
                        costs.of(Stage::Scatter).operations = Self::OPERATIONS * updates;
                        costs.of(Stage::OptimiseGrid).bytes = (touched * Self::ENTRY_BYTES) as f64;
                        costs
                    },
                )
            };
        tasks.into_par_iter().with_max_len(1).map(one).reduce(Costs::default, Costs::plus)
    }
}
