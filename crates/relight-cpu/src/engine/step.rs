//! One step of training: forward and backward over all tiles, then the optimisers.
//!
//! Threads wait for each other at three places only: when all lanes are through, when their gradients are summed, and
//! when networks, hash grid and density grid have learnt from them.

use std::time::Instant;

use rayon::prelude::*;
use relight_field::architecture::LightInput;
use relight_field::engine::{EngineError, RayBatch, StageCost, StepSettings, StepStats};
use relight_field::random::Random;
use relight_field::sampling::Shading;

use super::CpuEngine;
use super::lane::{Lane, Sums, Work};
use crate::dense::COLUMN_ALIGN;
use crate::density_grid::DensityGrid;
use crate::hash_grid::TileGradients;
use crate::networks::Gradients;
use crate::samples::Marcher;
use crate::shade::CodedLight;
use crate::stages::{Costs, Stage};

/// Steps between two decays of the density grid.
const DENSITY_DECAY: u64 = 32;
/// Steps between two surveys of the density grid, once nothing is searched for.
const SURVEY_EVERY: u64 = 256;
/// One cell of so many is looked at in each.
const SURVEYED_OF: usize = 64;
/// Streams of the seed from here on draw those cells; those of shadow rays are below.
const SURVEY_STREAM: u64 = 3 << 60;
/// Columns that a tile aims at: few enough for its activations to stay in the second-level cache, enough to fill
/// the registers.
const TILE_COLUMNS: usize = 192;
/// Cells of the density grid that are asked of memory before their turn to be raised.
const CELLS_AHEAD: usize = 16;
/// Partial sums of the network gradients. Their number, and so every sum, is the same for any number of threads.
pub(super) const LANES: usize = 32;

impl CpuEngine {
    /// Takes one step, see [`Engine::train_step`](relight_field::engine::Engine::train_step).
    pub(super) fn step(
        &mut self,
        batch: &RayBatch,
        settings: &StepSettings,
    ) -> Result<StepStats, EngineError> {
        check(batch, settings.step)?;
        self.lanes(batch, settings);
        let summing = Instant::now();
        let mut sums = Sums::default();
        let lanes = &mut self.lanes[..self.lanes_used];
        lanes.iter().for_each(|lane| sums.add(&lane.sums));
        let (first, rest) = lanes.split_at_mut(1);
        let rest: Vec<&Gradients> = rest.iter().map(|lane| &lane.gradients).collect();
        first[0].gradients.add(&rest);
        self.costs.of(Stage::OptimiseNetworks).seconds += summing.elapsed().as_secs_f64();
        let (n, pixels) = (batch.rays.origins.len(), batch.colours.len());
        let stats = StepStats {
            loss: sums.squared_error / (3 * pixels) as f64,
            rays: n,
            pixels,
            samples: n * self.config.sampling.samples(),
            depth_spread: sums.depth_spread / n as f64,
        };
        self.check_finite(&sums, settings.step)?;
        if self.probes_a_ray(batch, settings) > 0 {
            self.experience.observe(&sums.told);
            self.experience.observe_field(stats.loss);
        }
        self.learn(settings);
        if self.is_guided() && !settings.search && settings.step % SURVEY_EVERY == SURVEY_EVERY - 1 {
            self.survey_some(settings.step);
        }
        Ok(stats)
    }

    /// Forward and backward over all tiles; leaves gradients and partial sums in the lanes.
    fn lanes(&mut self, batch: &RayBatch, settings: &StepSettings) {
        let started = Instant::now();
        let n = batch.rays.origins.len();
        let probes_a_ray = self.probes_a_ray(batch, settings);
        let coded = |light| self.code_light(light);
        let lights: Vec<CodedLight> = batch.lights.iter().map(coded).collect();
        let probe_lights: Vec<CodedLight> =
            batch.probe_lights[..n * probes_a_ray].iter().map(coded).collect();
        let tile_rays = self.tile_rays(batch.lights_per_ray + probes_a_ray);
        let lane_rays = n.div_ceil(tile_rays).div_ceil(LANES) * tile_rays;
        let mut lanes = std::mem::take(&mut self.lanes);
        // The others hold what an earlier step left.
        self.lanes_used = n.div_ceil(lane_rays);
        let work = Work {
            marcher: Marcher { search: settings.search, ..self.marcher() },
            config: self.config,
            settings,
            batch,
            lights: &lights,
            probe_lights: &probe_lights,
            experience: self.experience,
            tile_rays,
        };
        lanes[..self.lanes_used].par_iter_mut().enumerate().with_max_len(1).for_each(|(i, lane)| {
            lane.run(&work, i * lane_rays..((i + 1) * lane_rays).min(n));
        });
        let mut costs = Costs::default();
        lanes[..self.lanes_used].iter().for_each(|lane| costs.add(&lane.costs));
        self.costs.add_share(costs, started.elapsed().as_secs_f64());
        self.lanes = lanes;
    }

    /// Rays a tile, so that neither samples nor pairs at first points are many more than [`TILE_COLUMNS`].
    fn tile_rays(&self, pairs: usize) -> usize {
        let samples = self.config.sampling.samples();
        match self.config.shading {
            // What the lights of a point share fills whole vectors.
            Shading::Deferred => (TILE_COLUMNS / samples.max(pairs)).next_multiple_of(COLUMN_ALIGN),
            Shading::PerSample => (TILE_COLUMNS / samples.max(samples * pairs / 2)).max(1),
        }
    }

    /// Probes of each ray that a step looks at: they teach nothing to a field that knows no light.
    fn probes_a_ray(&self, batch: &RayBatch, settings: &StepSettings) -> usize {
        let knows_light = self.field.architecture.light != LightInput::None;
        if knows_light && settings.probe_weight > 0.0 { batch.probes_per_ray() } else { 0 }
    }

    /// Looks for what the density grid has forgotten.
    fn survey_some(&mut self, step: u64) {
        let started = Instant::now();
        let cost = self.marcher().survey(SURVEYED_OF, Random::new(self.config.seed, SURVEY_STREAM + step));
        self.costs.of(Stage::Survey).add(&StageCost { seconds: started.elapsed().as_secs_f64(), ..cost });
    }

    /// Refuses sums that are not finite, and so gradients that are not.
    fn check_finite(&self, sums: &Sums, step: u64) -> Result<(), EngineError> {
        let non_finite = |what: &str| Err(EngineError::NonFinite { step, what: what.into() });
        for (value, what) in [
            (sums.squared_error, "the colour loss"),
            (sums.depth_penalty, "the depth penalty"),
            (sums.distortion, "the distortion loss"),
            (sums.gradient, "the gradient of the hash grid"),
        ] {
            if !value.is_finite() {
                return non_finite(what);
            }
        }
        if !sums.told.is_finite() {
            return non_finite("what photographs tell of probes");
        }
        for (gradient, name) in self.lanes[0].gradients.parts().into_iter().zip(["geo", "rgb", "vis"]) {
            if gradient.iter().any(|g| !g.is_finite()) {
                return non_finite(&format!("the gradient of the network {name}"));
            }
        }
        Ok(())
    }

    /// Networks, hash grid and density grid learn from the lanes, all at once.
    fn learn(&mut self, settings: &StepSettings) {
        let started = Instant::now();
        let guided = self.is_guided();
        let Self { networks, moments, grid, density, adam, simd, .. } = self;
        let (lanes, rate) = (&self.lanes[..self.lanes_used], settings.learning_rate);
        let tiles: Vec<TileGradients<'_>> =
            lanes.iter().flat_map(|lane| lane.samples.positions().tiles(&lane.feature_gradients)).collect();
        let optimise_networks = || {
            let mut costs = networks.step(*simd, &lanes[0].gradients, moments, rate, adam);
            let weights: usize = moments.iter().map(|moments| moments.m.len()).sum();
            let cost = costs.of(Stage::OptimiseNetworks);
            // The sums over lanes before.
            cost.operations += ((lanes.len() - 1) * weights) as f64;
            cost.bytes = (size_of::<f32>() * (lanes.len() + 7) * weights) as f64;
            costs
        };
        let observe_densities = || {
            let started = Instant::now();
            let mut costs = Costs::default();
            if guided {
                let updates = observe(density, lanes, settings.step) as f64;
                let seconds = started.elapsed().as_secs_f64();
                *costs.of(Stage::Occupancy) = StageCost { seconds, updates, ..StageCost::default() };
            }
            costs
        };
        let (mut costs, (of_networks, of_densities)) = rayon::join(
            || grid.step(*simd, &tiles, rate, adam),
            || rayon::join(optimise_networks, observe_densities),
        );
        costs.add(&of_networks);
        costs.add(&of_densities);
        self.costs.add_share(costs, started.elapsed().as_secs_f64());
    }
}

/// Shows the density grid the densities just computed, and lets it forget a little. Returns how many it was shown.
fn observe(grid: &mut DensityGrid, lanes: &[Lane], step: u64) -> usize {
    if step % DENSITY_DECAY == DENSITY_DECAY - 1 {
        grid.decay();
    }
    let grid = &*grid;
    let one = |lane: &Lane| -> usize {
        let positions = lane.samples.positions();
        let tiles = positions.data.chunks_exact(3 * positions.columns);
        let tiles = tiles.zip(lane.densities.chunks_exact(positions.columns)).enumerate();
        let shown = tiles.map(|(tile, (positions, densities))| {
            let (used, columns) = (lane.used(tile), densities.len());
            let cell = |c: usize| grid.cell([0, 1, 2].map(|a| positions[a * columns + c]));
            for (c, &density) in densities[..used].iter().enumerate() {
                if c + CELLS_AHEAD < used {
                    grid.ask(cell(c + CELLS_AHEAD));
                }
                grid.observe(cell(c), density);
            }
            used
        });
        shown.sum()
    };
    lanes.par_iter().map(one).sum()
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
