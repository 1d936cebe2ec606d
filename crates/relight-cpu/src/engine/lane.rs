//! One lane of a step: a few tiles of rays from end to end, by one thread and in memory of their own.
//!
//! Rays need nothing of each other until their gradients are summed, so a lane marches, encodes, looks, shades and goes
//! back without waiting for the others.

use std::ops::Range;

use relight_field::engine::{RayBatch, Rays, StepSettings};
use relight_field::random::Random;
use relight_field::sampling::EngineConfig;

use crate::experience::{Experience, Told};
use crate::march::along;
use crate::networks::Gradients;
use crate::probes::Probes;
use crate::roulette;
use crate::samples::{Jitter, Marcher, SampleBatch};
use crate::shade::CodedLight;
use crate::shadow;
use crate::stages::{Costs, Stage};
use crate::tile::{Regularisers, TileRays, Workspace};

/// Streams of the seed from here on place the samples of shadow rays.
const SHADOW_STREAM: u64 = 1 << 61;
/// Streams from here on play roulette; those below, of step after step, place the samples of rays.
const ROULETTE_STREAM: u64 = 1 << 60;

/// What all lanes of a step go by.
pub(super) struct Work<'a> {
    pub marcher: Marcher<'a>,
    pub config: EngineConfig,
    pub settings: &'a StepSettings,
    pub batch: &'a RayBatch,
    /// The batch's lights.
    pub lights: &'a [CodedLight],
    /// Those of its probes.
    pub probe_lights: &'a [CodedLight],
    pub experience: Experience,
    /// Rays a tile.
    pub tile_rays: usize,
}

impl Work<'_> {
    /// Probes that each ray is compared with.
    fn probes_a_ray(&self) -> usize {
        self.probe_lights.len() / self.batch.rays.origins.len()
    }

    fn random(&self, stream: u64) -> Random {
        Random::new(self.config.seed, stream + self.settings.step)
    }
}

/// Some neighbouring tiles of a step, and the partial sums over their rays.
pub(super) struct Lane {
    /// Its rays among those of the batch.
    range: Range<usize>,
    rays: Rays,
    pub samples: SampleBatch,
    shadows: SampleBatch,
    /// Of the features of `samples`, and laid out like them.
    pub feature_gradients: Vec<f32>,
    /// Densities at the columns of `samples`, for the density grid.
    pub densities: Vec<f32>,
    pub gradients: Gradients,
    pub sums: Sums,
    pub costs: Costs,
}

/// Sums over the rays of a lane.
#[derive(Clone, Copy, Default)]
pub(super) struct Sums {
    pub squared_error: f64,
    pub gradient: f64,
    pub depth_penalty: f64,
    pub distortion: f64,
    pub depth_spread: f64,
    /// What photographs told of probes.
    pub told: Told,
}

impl Sums {
    pub fn add(&mut self, other: &Self) {
        self.squared_error += other.squared_error;
        self.gradient += other.gradient;
        self.depth_penalty += other.depth_penalty;
        self.distortion += other.distortion;
        self.depth_spread += other.depth_spread;
        self.told.add(&other.told);
    }
}

impl Lane {
    /// An idle lane of an engine whose networks have gradients like these, which are zero.
    pub fn new(gradients: &Gradients) -> Self {
        Self {
            range: 0..0,
            rays: Rays::default(),
            samples: SampleBatch::default(),
            shadows: SampleBatch::default(),
            feature_gradients: Vec::new(),
            densities: Vec::new(),
            gradients: gradients.clone(),
            sums: Sums::default(),
            costs: Costs::default(),
        }
    }

    /// The columns of a tile that are samples.
    pub fn used(&self, tile: usize) -> usize {
        self.samples.range(&self.rays, tile).len() * self.samples.samples
    }

    /// Takes the rays of `range` forward and back.
    pub fn run(&mut self, work: &Work<'_>, range: Range<usize>) {
        (self.sums, self.costs) = (Sums::default(), Costs::default());
        self.gradients.clear();
        self.rays.origins.clear();
        self.rays.origins.extend(&work.batch.rays.origins[range.clone()]);
        self.rays.directions.clear();
        self.rays.directions.extend(&work.batch.rays.directions[range.clone()]);
        let jitter = Jitter(Some(work.random(0))).after_rays(range.start);
        self.range = range;
        self.samples.fill(&work.marcher, &self.rays, work.config.sampling, work.tile_rays, jitter);
        self.costs.of(Stage::March).add(&self.samples.marched);
        self.costs.of(Stage::Encode).add(&self.samples.encoded);
        self.feature_gradients.resize(self.samples.features.len(), 0.0);
        self.densities.resize(self.samples.t.len(), 0.0);
        work.marcher.workspaces.with(Workspace::default, |workspace| {
            workspace.clock.start();
            for tile in 0..self.samples.tiles(&self.rays) {
                self.tile(work, workspace, tile);
            }
            self.costs.add(workspace.clock.costs());
        });
    }

    fn tile(&mut self, work: &Work<'_>, workspace: &mut Workspace, tile: usize) {
        let Work { marcher, batch, settings, .. } = work;
        let (simd, networks, shading) = (marcher.simd, marcher.networks, work.config.shading);
        let (lights, probes_a_ray) = (batch.lights_per_ray, work.probes_a_ray());
        // Probes are further pairs, the last of their ray.
        let pairs = lights + probes_a_ray;
        let rays = self.samples.tile(marcher, &self.rays, tile);
        let here = self.samples.range(&self.rays, tile);
        let first = self.range.start + here.start;
        let range = first..first + here.len();
        workspace.look(simd, networks, &rays);
        let points: Vec<[f32; 3]> = (0..here.len())
            .map(|r| along(rays.origins[r], rays.directions[r], workspace.depths[r]))
            .collect();
        let probes = (probes_a_ray > 0).then(|| {
            let own = range.start * probes_a_ray..range.end * probes_a_ray;
            let jitter = Jitter(Some(work.random(SHADOW_STREAM))).after_rays(own.start);
            let lights = &work.probe_lights[own];
            let (memory, clock) = (&mut self.shadows, &mut workspace.clock);
            let shadows = shadow::trace(marcher, &points, lights, memory, jitter, clock);
            Probes { lights, shadows, experience: &work.experience }
        });
        let light = |r: usize, l: usize| match &probes {
            Some(probes) if l >= lights => &probes.lights[r * probes_a_ray + l - lights],
            _ => &work.lights[batch.light_index[(first + r) * lights + l] as usize],
        };
        workspace.shade(simd, networks, shading, &rays, pairs, light);

        let n = batch.rays.origins.len();
        let scale = 2.0 / (3 * n * lights) as f32;
        // Photographed probes count no more than others: they are there to tell what those are worth.
        let probe_weight = settings.probe_weight * work.experience.trust();
        let probe_scale = scale * probe_weight * lights as f32 / probes_a_ray.max(1) as f32;
        let mut colour_gradient = Vec::with_capacity(workspace.colours.len());
        for (r, colours) in workspace.colours.chunks_exact(pairs).enumerate() {
            let truth = &batch.colours[(first + r) * lights..(first + r + 1) * lights];
            for (colour, truth) in colours.iter().zip(truth) {
                let difference: [f32; 3] = std::array::from_fn(|c| colour[c] - truth[c]);
                self.sums.squared_error += difference.iter().map(|d| f64::from(d * d)).sum::<f64>();
                colour_gradient.push(difference.map(|d| scale * d));
            }
            let Some(probes) = &probes else { continue };
            let seen = truth.iter().enumerate().map(|(l, &colour)| (light(r, l).position, colour));
            let photographed = &batch.probe_colours[(first + r) * probes_a_ray..][..probes_a_ray];
            probes.compare(
                (r, points[r]),
                &colours[lights..],
                photographed,
                seen,
                probe_scale,
                &mut colour_gradient,
                &mut self.sums.told,
            );
        }
        let columns = rays.columns;
        self.densities[tile * columns..(tile + 1) * columns].copy_from_slice(&workspace.density);
        self.sums.depth_spread += depth_spread(workspace, &rays);
        workspace.clock.lap(Stage::Loss, 0);

        let regularisers = Regularisers {
            depths: if batch.depths.is_empty() { &[] } else { &batch.depths[range] },
            depth_weight: settings.depth_weight / n as f32,
            depth_margin: settings.depth_margin,
            distortion_weight: settings.distortion_weight / n as f32,
            edge: marcher.cube.edge,
        };
        let tile_size = networks.features * columns;
        let gradient = &mut self.feature_gradients[tile * tile_size..(tile + 1) * tile_size];
        let (penalty, distortion) = workspace.backward(
            simd,
            networks,
            shading,
            &rays,
            pairs,
            &colour_gradient,
            &regularisers,
            &mut self.gradients,
            gradient,
        );
        // Any number that is not finite makes the sum so.
        self.sums.gradient += f64::from(total(gradient));
        self.sums.depth_penalty += f64::from(penalty);
        self.sums.distortion += f64::from(distortion);
        let mut operations = 0;
        if settings.roulette > 0.0 {
            operations = 3 * gradient.len();
            let random = work.random(ROULETTE_STREAM);
            let before = first / work.tile_rays * columns;
            let (used, draw) = (here.len() * rays.samples, |c| random.uniform_at((before + c) as u64));
            roulette::thin(gradient, (columns, used), settings.roulette, draw, &mut Vec::new());
        }
        workspace.clock.lap(Stage::Roulette, operations);
    }
}

/// Sum of all numbers, of which there are a multiple of 16, in an order that vectors like.
fn total(numbers: &[f32]) -> f32 {
    let add = |sums: [f32; 16], numbers: &[f32; 16]| std::array::from_fn(|i| sums[i] + numbers[i]);
    numbers.as_chunks().0.iter().fold([0.0; 16], add).iter().sum()
}

/// Sum over rays of the standard deviation of depth under the ray's weights, metres.
fn depth_spread(workspace: &Workspace, rays: &TileRays<'_>) -> f64 {
    let k = rays.samples;
    let spans = workspace.weights.chunks_exact(k).zip(rays.t.chunks_exact(k));
    spans
        .zip(&workspace.depths)
        .map(|((w, t), depth)| {
            let variance: f32 = w.iter().zip(t).map(|(w, t)| w * (t - depth) * (t - depth)).sum();
            f64::from(variance.max(0.0).sqrt())
        })
        .sum()
}
