//! Rays looked along from front to back: a few samples at a time, until nothing behind them would show.
//!
//! Where shading is deferred, all that the samples leave behind are sums: features, depth, and how much light still
//! passes; and the features of the last sample, where the ray gets there. So a ray that has met a surface needs no more samples
//! (early ray termination, Levoy 1990).
//! Nor are any placed behind what may be one: a ray that gets through looks on from there
//! ([`SampleBatch::look_on`]).
//!
//! Of the geometry network's last layer a sample needs its density alone. Embeddings are linear in the hidden activations before it, so those are
//! summed, and multiplied once a ray.

use std::ops::Range;

use fearless_simd::{Level, Simd, dispatch, f32x16, prelude::*};
use relight_field::engine::Rays;
use relight_field::sampling::Sampling;

use crate::aligned::Aligned;
use crate::dense::{COLUMN_ALIGN, padded};
use crate::exponential::exponentials;
use crate::hash_grid::{TiledPositions, set_position};
use crate::march::along;
use crate::samples::{Marcher, SampleBatch};
use crate::tile::Workspace;

/// A ray of which no more than this passes is at its end, in pictures: what little there is, its last sample takes (as in instant-ngp).
const LITTLE: f32 = 0.01;
/// Samples of a ray that are evaluated together.
const TOGETHER: usize = 4;
/// Rays whose samples make a tile: whole vectors of rays.
pub const TILE_RAYS: usize = 48;
/// Vectors of rays in a tile.
const VECTORS: usize = TILE_RAYS / COLUMN_ALIGN;
const _: () = assert!(TILE_RAYS.is_multiple_of(COLUMN_ALIGN) && TOGETHER == 4);

/// What a block of rays has met so far; memory that is reused from block to block.
#[derive(Default)]
pub struct FrontToBack {
    /// The rays that get to their last sample.
    pub faces: Vec<usize>,
    /// `[rays]`: sum of the distances of samples inside the box, each times its weight, metres.
    pub depths: Vec<f32>,
    /// `[rays]`: light that passes all samples but the last, so far; none where a ray has met its end.
    pub transmittance: Vec<f32>,
    /// `[features + hidden_width][padded rays]`: sums of `h` and of `geo`'s last hidden activations, each times the weight of its
    /// sample.
    sums: Aligned,
    /// `[faces][features + hidden_width]`: the same at the faces.
    of_faces: Vec<f32>,
    /// `[features + hidden_width][padded faces]`: the same again.
    face_rows: Aligned,
    /// `[point_features][padded rays]`: sums of `h` and `e`.
    features: Aligned,
    /// `[point_features][padded faces]`: `h` and `e` at the faces.
    face_features: Aligned,
    /// Rays that are not at their end.
    going: Vec<usize>,
    /// `[tile][3][columns]`: positions of the samples at hand.
    positions: Vec<f32>,
    /// `[tile][features][columns]`: their features.
    encoded: Aligned,
    /// `[columns]`: their weights.
    weights: Vec<f32>,
}

impl FrontToBack {
    /// Looks along all rays, which `batch` has let enter the box.
    pub fn look(&mut self, marcher: &Marcher<'_>, rays: &Rays, sampling: Sampling, batch: &mut SampleBatch) {
        let n = rays.origins.len();
        let rows = marcher.networks.features + marcher.networks.hidden_width();
        self.sums.resize(rows * padded(n));
        self.sums.fill(0.0);
        for (numbers, value) in [(&mut self.depths, 0.0), (&mut self.transmittance, 1.0)] {
            numbers.clear();
            numbers.resize(n, value);
        }
        self.faces.clear();
        self.of_faces.clear();
        self.going.clear();
        self.going.extend(0..n);
        while !self.going.is_empty() {
            batch.look_on(marcher, rays, sampling, &self.going);
            for first in (0..batch.samples).step_by(TOGETHER) {
                let samples = first..(first + TOGETHER).min(batch.samples);
                self.encode(marcher, rays, batch, samples.clone());
                self.accumulate(marcher, n, batch, samples);
                self.going.retain(|&ray| self.transmittance[ray] > 0.0);
            }
            self.going.retain(|&ray| !batch.leaves(ray));
        }
        let wide = padded(self.faces.len());
        self.face_rows.resize(rows * wide);
        self.face_rows.fill(0.0);
        for (face, numbers) in self.of_faces.chunks_exact(rows).enumerate() {
            let places = self.face_rows[face..].iter_mut().step_by(wide);
            places.zip(numbers).for_each(|(place, &number)| *place = number);
        }
        embed(marcher, &self.sums, padded(n), &mut self.features);
        embed(marcher, &self.face_rows, wide, &mut self.face_features);
    }

    /// For `h` and then `e`, number by number: its sum over each ray, inside the box and times the weights of samples, and what it
    /// is at each face.
    pub fn feature_rows(&self) -> impl Iterator<Item = (&[f32], &[f32])> {
        let [rays, faces] = [self.transmittance.len(), self.faces.len()].map(|n| padded(n.max(1)));
        let of_faces = self.face_features.chunks_exact(faces).chain(std::iter::repeat(&[][..]));
        self.features.chunks_exact(rays).zip(of_faces)
    }

    /// Looks up the features of some samples of all rays that go on. Sample `s` of the tile's ray `r` is column
    /// `s * TILE_RAYS + r`: neighbouring columns are neighbouring rays equally far along, which often share a cell of the hash
    /// grid.
    fn encode(&mut self, marcher: &Marcher<'_>, rays: &Rays, batch: &SampleBatch, samples: Range<usize>) {
        let columns = TILE_RAYS * samples.len();
        let tiles = self.going.len().div_ceil(TILE_RAYS);
        self.positions.clear();
        self.positions.resize(tiles * 3 * columns, 0.5);
        self.encoded.resize(tiles * marcher.networks.features * columns);
        let tiles = self.positions.chunks_exact_mut(3 * columns).zip(self.going.chunks(TILE_RAYS));
        for (positions, going) in tiles {
            for (r, &ray) in going.iter().enumerate() {
                for (s, &t) in batch.t[batch.columns_of(ray)][samples.clone()].iter().enumerate() {
                    let unit = marcher.cube.map(along(rays.origins[ray], rays.directions[ray], t));
                    set_position(positions, s * TILE_RAYS + r, unit);
                }
            }
        }
        let positions = TiledPositions { data: &self.positions, columns };
        marcher.grid.encode(marcher.simd, positions, &mut self.encoded);
    }

    /// Adds what those samples show.
    fn accumulate(&mut self, marcher: &Marcher<'_>, n: usize, batch: &SampleBatch, samples: Range<usize>) {
        let networks = marcher.networks;
        let columns = TILE_RAYS * samples.len();
        let is_last = samples.end == batch.samples;
        marcher.workspaces.with(Workspace::default, |workspace| {
            let tiles = self.encoded.chunks_exact(networks.features * columns);
            for (encoded, going) in tiles.zip(self.going.chunks(TILE_RAYS)) {
                workspace.densities(marcher.simd, networks, encoded, columns);
                self.weights.clear();
                self.weights.resize(columns, 0.0);
                for (r, &ray) in going.iter().enumerate() {
                    let lengths = &batch.lengths[batch.columns_of(ray)][samples.clone()];
                    for (s, length) in lengths.iter().enumerate() {
                        let column = s * TILE_RAYS + r;
                        self.weights[column] = -workspace.density[column] * length;
                    }
                }
                exponentials(marcher.simd, &mut self.weights);
                for (r, &ray) in going.iter().enumerate() {
                    let places = &batch.t[batch.columns_of(ray)][samples.clone()];
                    for (s, (sample, t)) in samples.clone().zip(places).enumerate() {
                        let (weight, before) =
                            (&mut self.weights[s * TILE_RAYS + r], self.transmittance[ray]);
                        let mut after = before * *weight;
                        if sample + 1 == batch.samples && batch.leaves(ray) {
                            // It stands for all that lies beyond.
                            after = before;
                        } else if after <= LITTLE {
                            // The ray is at its end, and this sample takes the rest.
                            after = 0.0;
                        }
                        *weight = before - after;
                        self.depths[ray] += *weight * t;
                        self.transmittance[ray] = after;
                    }
                }
                let rows = || {
                    encoded.chunks_exact(columns).chain(workspace.hidden_activations().chunks_exact(columns))
                };
                if is_last {
                    for (r, &ray) in going.iter().enumerate() {
                        if self.transmittance[ray] > 0.0 && batch.leaves(ray) {
                            self.faces.push(ray);
                            self.of_faces.extend(rows().map(|row| row[columns - TILE_RAYS + r]));
                        }
                    }
                }
                let sums = rows().zip(self.sums.chunks_exact_mut(padded(n)));
                let (simd, weights) = (marcher.simd, &self.weights[..]);
                match samples.len() {
                    1 => add_up::<1>(simd, sums, weights, going),
                    2 => add_up::<2>(simd, sums, weights, going),
                    3 => add_up::<3>(simd, sums, weights, going),
                    _ => add_up::<TOGETHER>(simd, sums, weights, going),
                }
            }
        });
    }
}

/// From `rows`, `h` and `geo`'s last hidden activations, to `features`, `h` and `e`: both of `columns` numbers a row.
fn embed(marcher: &Marcher<'_>, rows: &[f32], columns: usize, features: &mut Aligned) {
    let (h, hidden) = rows.split_at(marcher.networks.features * columns);
    features.resize(marcher.networks.point_features() * columns);
    let (first, embeddings) = features.split_at_mut(h.len());
    first.copy_from_slice(h);
    marcher.networks.embeddings(marcher.simd, hidden, columns, embeddings);
}

/// Adds the weighted sums over `N` samples of each row of a tile to those of its rays, `going`, in the row beside it.
fn add_up<'a, const N: usize>(
    simd: Level,
    rows: impl Iterator<Item = (&'a [f32], &'a mut [f32])>,
    weights: &[f32],
    going: &[usize],
) {
    // Most rays go on with those beside them, whose sums are vectors.
    let (first, last) = (going[0], going[going.len() - 1]);
    let neighbours = (last - first < going.len()).then(|| first..last + 1);
    dispatch!(simd, simd => simd.vectorize(
        #[inline(always)]
        || {
            // Held in registers, where there are as many.
            let vector = |numbers: &[f32], sample: usize, v: usize| {
                f32x16::from_slice(simd, &numbers[sample * TILE_RAYS + v * COLUMN_ALIGN..][..COLUMN_ALIGN])
            };
            let weights: [[_; VECTORS]; N] =
                std::array::from_fn(|sample| std::array::from_fn(|v| vector(weights, sample, v)));
            for (row, sums) in rows {
                let mut terms = [0.0; TILE_RAYS];
                for (v, terms) in terms.chunks_exact_mut(COLUMN_ALIGN).enumerate() {
                    let mut sum = f32x16::splat(simd, 0.0);
                    for (sample, weights) in weights.iter().enumerate() {
                        sum = vector(row, sample, v).mul_add(weights[v], sum);
                    }
                    sum.store_slice(terms);
                }
                match &neighbours {
                    Some(rays) => sums[rays.clone()].iter_mut().zip(terms).for_each(|(sum, term)| *sum += term),
                    None => going.iter().zip(terms).for_each(|(&ray, term)| sums[ray] += term),
                }
            }
        },
    ));
}
