//! One step of training: forward and backward over all tiles, then the optimisers.

use std::time::Instant;

use rayon::prelude::*;
use relight_field::architecture::LightInput;
use relight_field::engine::{EngineError, RayBatch, Rays, StageCost, StepSettings, StepStats};
use relight_field::random::Random;
use relight_field::sampling::{Sampling, Shading};

use super::CpuEngine;
use crate::adam::UPDATE_OPERATIONS;
use crate::experience::Seen;
use crate::march::along;
use crate::networks::Gradients;
use crate::probes::Probes;
use crate::roulette;
use crate::samples::Jitter;
use crate::shade::CodedLight;
use crate::stages::{Costs, Stage};
use crate::tile::{Regularisers, TileRays, Workspace};

/// Steps between two decays of the density grid.
const DENSITY_DECAY: u64 = 32;
/// Columns that a tile aims at: few enough for its activations to stay in the second-level cache, enough to fill
/// the registers.
const TILE_COLUMNS: usize = 192;
/// Cells of the density grid that are asked of memory before their turn to be raised.
const CELLS_AHEAD: usize = 16;
/// Streams of the seed from here on place the samples of shadow rays.
const SHADOW_STREAM: u64 = 1 << 61;
/// Streams from here on play roulette; those below, of step after step, place the samples of rays.
const ROULETTE_STREAM: u64 = 1 << 60;
/// Partial sums of the network gradients. Their number, and so every sum, is the same for any number of threads.
const LANES: usize = 32;

/// One partial sum of a step.
pub(super) struct Lane {
    gradients: Gradients,
    sums: Sums,
    costs: Costs,
}

impl Lane {
    /// Those of an engine whose networks have gradients like these, which are zero.
    pub(super) fn all(gradients: &Gradients) -> Vec<Self> {
        let lane = || Self { gradients: gradients.clone(), sums: Sums::default(), costs: Costs::default() };
        (0..LANES).map(|_| lane()).collect()
    }

    fn clear(&mut self) {
        self.gradients.clear();
        self.sums = Sums::default();
        self.costs = Costs::default();
    }
}

/// Sums over the rays of a lane.
#[derive(Clone, Copy, Default)]
struct Sums {
    squared_error: f64,
    gradient: f64,
    depth_penalty: f64,
    distortion: f64,
    depth_spread: f64,
    /// See [`Experience::shadow`](crate::experience::Experience::shadow).
    shadow: Seen,
    /// See [`Experience::imagined`](crate::experience::Experience::imagined).
    imagined: Seen,
}

impl Sums {
    fn add(&mut self, other: &Self) {
        self.squared_error += other.squared_error;
        self.gradient += other.gradient;
        self.depth_penalty += other.depth_penalty;
        self.distortion += other.distortion;
        self.depth_spread += other.depth_spread;
        self.shadow.add(other.shadow);
        self.imagined.add(other.imagined);
    }
}

impl CpuEngine {
    /// Takes one step, see [`Engine::train_step`](relight_field::engine::Engine::train_step).
    pub(super) fn step(
        &mut self,
        batch: &RayBatch,
        settings: &StepSettings,
    ) -> Result<StepStats, EngineError> {
        check(batch, settings.step)?;
        let (n, lights) = (batch.rays.origins.len(), batch.lights_per_ray);
        let total = self.config.sampling.samples();
        let jitter = Jitter(Some(Random::new(self.config.seed, settings.step)));
        let mut samples = std::mem::take(&mut self.batch);
        let pairs = lights + self.probes_a_ray(batch, settings);
        let tile_rays = self.tile_rays(total, pairs);
        samples.fill(&self.marcher(), &batch.rays, self.config.sampling, tile_rays, jitter);
        self.costs.of(Stage::March).add(&samples.marched);
        self.costs.of(Stage::Encode).add(&samples.encoded);
        self.batch = samples;
        let probes = self.probes(batch, settings);
        self.tiles(batch, settings, probes.as_ref());

        let summing = Instant::now();
        let mut sums = Sums::default();
        let lanes = &mut self.lanes[..self.lanes_used];
        let (first, rest) = lanes.split_at_mut(1);
        let rest: Vec<&Gradients> = rest.iter().map(|lane| &lane.gradients).collect();
        first[0].gradients.add(&rest);
        lanes.iter().for_each(|lane| sums.add(&lane.sums));
        let non_finite = |what: &str| EngineError::NonFinite { step: settings.step, what: what.into() };
        let stats = StepStats {
            loss: sums.squared_error / (3 * n * lights) as f64,
            rays: n,
            pixels: n * lights,
            samples: n * total,
            depth_spread: sums.depth_spread / n as f64,
        };
        for (value, what) in [
            (stats.loss, "the colour loss"),
            (sums.depth_penalty, "the depth penalty"),
            (sums.distortion, "the distortion loss"),
            (sums.gradient, "the gradient of the hash grid"),
        ] {
            if !value.is_finite() {
                return Err(non_finite(what));
            }
        }
        for (gradient, name) in self.lanes[0].gradients.parts().into_iter().zip(["geo", "rgb", "vis"]) {
            if gradient.iter().any(|g| !g.is_finite()) {
                return Err(non_finite(&format!("the gradient of the network {name}")));
            }
        }
        let mut optimising = summing.elapsed();
        if matches!(self.config.sampling, Sampling::Guided { .. }) {
            let observing = Instant::now();
            self.observe(&batch.rays, settings.step);
            self.costs.of(Stage::Occupancy).add(&StageCost {
                seconds: observing.elapsed().as_secs_f64(),
                updates: stats.samples as f64,
                ..StageCost::default()
            });
        }
        if probes.is_some() {
            self.experience.shadow.observe(sums.shadow);
            self.experience.imagined.observe(sums.imagined);
            self.experience.observe_field(stats.loss);
        }
        let (rate, stepping) = (settings.learning_rate, Instant::now());
        self.networks.step(self.simd, &self.lanes[0].gradients, &mut self.moments, rate, &self.adam);
        optimising += stepping.elapsed();
        let weights: usize = self.moments.iter().map(|moments| moments.m.len()).sum();
        self.costs.of(Stage::OptimiseNetworks).add(&StageCost {
            seconds: optimising.as_secs_f64(),
            operations: ((self.lanes_used - 1 + UPDATE_OPERATIONS) * weights) as f64,
            bytes: (size_of::<f32>() * (self.lanes_used + 7) * weights) as f64,
            ..StageCost::default()
        });
        let positions = self.batch.positions();
        let costs = self.grid.step(self.simd, positions, &self.feature_gradients, rate, &self.adam);
        self.costs.add(&costs);
        Ok(stats)
    }

    /// Rays a tile, so that neither samples nor pairs are many more than [`TILE_COLUMNS`].
    fn tile_rays(&self, samples: usize, lights: usize) -> usize {
        let columns = match self.config.shading {
            Shading::Deferred => samples.max(lights),
            Shading::PerSample => samples.max(samples * lights / 2),
        };
        (TILE_COLUMNS / columns).max(1)
    }

    /// The probes of a batch, where they count.
    fn probes(&mut self, batch: &RayBatch, settings: &StepSettings) -> Option<Probes> {
        if self.probes_a_ray(batch, settings) == 0 {
            return None;
        }
        let lights = batch.probe_lights.iter().map(|l| self.code_light(l)).collect();
        let started = Instant::now();
        let mut shadows = std::mem::take(&mut self.shadow_batch);
        let jitter = Jitter(Some(Random::new(self.config.seed, SHADOW_STREAM + settings.step)));
        let (samples, shadow) = (&self.batch, self.experience.shadow.mean());
        let probes = Probes::trace(&self.marcher(), batch, samples, lights, shadow, &mut shadows, jitter);
        let (marched, encoded) = (shadows.marched, shadows.encoded);
        // Whatever else tracing takes: most of it is `geo` at the samples.
        let others = StageCost {
            seconds: started.elapsed().as_secs_f64() - marched.seconds - encoded.seconds,
            operations: (self.networks.geo.forward_operations() * (shadows.t.len() + self.batch.t.len()))
                as f64,
            ..StageCost::default()
        };
        self.shadow_batch = shadows;
        self.costs.of(Stage::ShadowMarch).add(&marched);
        self.costs.of(Stage::ShadowEncode).add(&encoded);
        self.costs.of(Stage::ShadowGeometry).add(&others);
        Some(probes)
    }

    /// Probes of each ray that a step looks at: they teach nothing to a field that knows no light.
    fn probes_a_ray(&self, batch: &RayBatch, settings: &StepSettings) -> usize {
        let knows_light = self.field.architecture.light != LightInput::None;
        if knows_light && settings.probe_weight > 0.0 { batch.probes_per_ray() } else { 0 }
    }

    /// Forward and backward over all tiles; leaves gradients in the lanes and in `feature_gradients`.
    fn tiles(&mut self, batch: &RayBatch, settings: &StepSettings, probes: Option<&Probes>) {
        let started = Instant::now();
        let (rays, lights) = (&batch.rays, batch.lights_per_ray);
        let coded: Vec<CodedLight> = batch.lights.iter().map(|l| self.code_light(l)).collect();
        // Probes are further pairs, the last of their ray.
        let probes_a_ray = self.probes_a_ray(batch, settings);
        let pairs = lights + probes_a_ray;
        let n = rays.origins.len();
        let tiles = self.batch.tiles(rays);
        let columns = self.batch.columns;
        let tile_size = self.networks.features * columns;
        let mut lanes = std::mem::take(&mut self.lanes);
        let mut feature_gradients = std::mem::take(&mut self.feature_gradients);
        feature_gradients.resize(tiles * tile_size, 0.0);
        let mut densities = std::mem::take(&mut self.densities);
        densities.resize(tiles * columns, 0.0);
        let per_lane = tiles.div_ceil(LANES).max(1);
        let marcher = self.marcher();
        let (simd, shading, samples) = (self.simd, self.config.shading, &self.batch);
        let scale = 2.0 / (3 * n * lights) as f32;
        // Photographed probes are scaled by the trust too: what stands exactly at its light must not be favoured.
        let probe_weight = settings.probe_weight * self.experience.trust();
        let probe_scale = scale * probe_weight * lights as f32 / probes_a_ray.max(1) as f32;
        let roulette = Random::new(self.config.seed, ROULETTE_STREAM + settings.step);
        let gradients = feature_gradients.par_chunks_mut(per_lane * tile_size);
        let work = gradients.zip(densities.par_chunks_mut(per_lane * columns)).zip(&mut lanes);
        work.enumerate().with_max_len(1).for_each(|(i, ((gradients, densities), lane))| {
            lane.clear();
            self.workspaces.with(Workspace::default, |workspace| {
                let (mut colour_gradient, mut lengths) = (Vec::new(), Vec::new());
                let outputs = gradients.chunks_exact_mut(tile_size).zip(densities.chunks_exact_mut(columns));
                for (tile, (gradient, densities)) in (i * per_lane..).zip(outputs) {
                    let range = samples.range(rays, tile);
                    let first = range.start * lights;
                    let rays_here = samples.tile(&marcher, rays, tile);
                    let light = |r: usize, l: usize| match probes {
                        Some(probes) if l >= lights => {
                            &probes.lights[(range.start + r) * probes_a_ray + l - lights]
                        }
                        _ => &coded[batch.light_index[first + r * lights + l] as usize],
                    };
                    workspace.forward(simd, marcher.networks, shading, &rays_here, pairs, light);
                    colour_gradient.clear();
                    for (r, colours) in workspace.colours.chunks_exact(pairs).enumerate() {
                        let truth = &batch.colours[first + r * lights..first + (r + 1) * lights];
                        for (colour, truth) in colours.iter().zip(truth) {
                            let difference: [f32; 3] = std::array::from_fn(|c| colour[c] - truth[c]);
                            lane.sums.squared_error +=
                                difference.iter().map(|d| f64::from(d * d)).sum::<f64>();
                            colour_gradient.push(difference.map(|d| scale * d));
                        }
                        let Some(probes) = probes else { continue };
                        let ray = range.start + r;
                        let point = along(rays_here.origins[r], rays_here.directions[r], workspace.depths[r]);
                        let seen =
                            truth.iter().enumerate().map(|(l, &colour)| (light(r, l).position, colour));
                        probes.compare(
                            (ray, point),
                            &colours[lights..],
                            &batch.probe_colours,
                            seen,
                            probe_scale,
                            &mut colour_gradient,
                            (&mut lane.sums.shadow, &mut lane.sums.imagined),
                        );
                    }
                    workspace.clock.lap(Stage::Loss, 0);
                    let regularisers = Regularisers {
                        depths: if batch.depths.is_empty() { &[] } else { &batch.depths[range] },
                        depth_weight: settings.depth_weight / n as f32,
                        depth_margin: settings.depth_margin,
                        distortion_weight: settings.distortion_weight / n as f32,
                        edge: marcher.cube.edge,
                    };
                    densities.copy_from_slice(&workspace.density);
                    lane.sums.depth_spread += depth_spread(workspace, &rays_here);
                    let (penalty, distortion) = workspace.backward(
                        simd,
                        marcher.networks,
                        shading,
                        &rays_here,
                        pairs,
                        &colour_gradient,
                        &regularisers,
                        &mut lane.gradients,
                        gradient,
                    );
                    // Any number that is not finite makes the sum so.
                    lane.sums.gradient += f64::from(gradient.iter().sum::<f32>());
                    lane.sums.depth_penalty += f64::from(penalty);
                    lane.sums.distortion += f64::from(distortion);
                    let mut operations = 0;
                    if settings.roulette > 0.0 {
                        operations = 3 * gradient.len();
                        let used = rays_here.origins.len() * rays_here.samples;
                        let draw = |c| roulette.uniform_at((tile * columns + c) as u64);
                        roulette::thin(gradient, (columns, used), settings.roulette, draw, &mut lengths);
                    }
                    workspace.clock.lap(Stage::Roulette, operations);
                    lane.costs.add(workspace.clock.costs());
                }
            });
        });
        let mut costs = Costs::default();
        // Those that had tiles; the others hold what an earlier step left.
        self.lanes_used = tiles.div_ceil(per_lane);
        lanes[..self.lanes_used].iter().for_each(|lane| costs.add(&lane.costs));
        self.costs.add_share(costs, started.elapsed().as_secs_f64());
        self.lanes = lanes;
        self.feature_gradients = feature_gradients;
        self.densities = densities;
    }

    /// Shows the density grid the densities just computed, and lets it forget a little.
    fn observe(&mut self, rays: &Rays, step: u64) {
        if step % DENSITY_DECAY == DENSITY_DECAY - 1 {
            self.density.decay();
        }
        let (columns, batch, grid) = (self.batch.columns, &self.batch, &self.density);
        let tiles = batch.positions.par_chunks(3 * columns).zip(self.densities.par_chunks(columns));
        tiles.enumerate().for_each(|(tile, (positions, densities))| {
            let used = batch.range(rays, tile).len() * batch.samples;
            let cell = |c: usize| grid.cell([0, 1, 2].map(|a| positions[a * columns + c]));
            for (c, &density) in densities[..used].iter().enumerate() {
                if c + CELLS_AHEAD < used {
                    grid.ask(cell(c + CELLS_AHEAD));
                }
                grid.observe(cell(c), density);
            }
        });
    }
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

/// Refuses batches that contradict themselves.
fn check(batch: &RayBatch, step: u64) -> Result<(), EngineError> {
    let n = batch.rays.origins.len();
    let pairs = n * batch.lights_per_ray;
    let wrong = |what: &str| Err(EngineError::Shape(format!("ray batch: {what}")));
    if pairs == 0 {
        return wrong("it is empty");
    }
    if batch.rays.directions.len() != n {
        return wrong("origins and directions differ in number");
    }
    if batch.light_index.len() != pairs || batch.colours.len() != pairs {
        return wrong("light indices and colours must be as many as rays times lights a ray");
    }
    if !batch.depths.is_empty() && batch.depths.len() != n {
        return wrong("depths must be as many as rays, or none");
    }
    if batch.probe_colours.len() != batch.probe_lights.len() || !batch.probe_lights.len().is_multiple_of(n) {
        return wrong("probes must be as many for each ray, and as many as their colours");
    }
    let places = batch.rays.origins.iter().chain(&batch.rays.directions);
    if places.flatten().any(|c| !c.is_finite()) {
        return Err(EngineError::NonFinite { step, what: "a ray".into() });
    }
    if batch.light_index.iter().any(|&l| l as usize >= batch.lights.len()) {
        return wrong("a light index points past the lights");
    }
    Ok(())
}
