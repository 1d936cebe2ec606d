//! One tile after the other, forward and backward, against the oracle in double precision, for the same samples.

use fearless_simd::Level;
use relight_cpu::adam::{Adam, BETA1};
use relight_cpu::deferred::NEGLIGIBLE;
use relight_cpu::hash_grid::HashGrid;
use relight_cpu::samples::{Jitter, SampleBatch};
use relight_cpu::tile::{Regularisers, Workspace};
use relight_field::architecture::{Architecture, LightInput, V0, V5};
use relight_field::engine::{RayBatch, StepSettings};
use relight_field::parameters::Parameters;
use relight_field::random::Random;
use relight_field::reference::{Field, loss_and_gradient};
use relight_field::sampling::{Sampling, Shading};

use crate::common::*;

const SAMPLING: Sampling = Sampling::Stratified { coarse: 7, fine: 5 };

const SETTINGS: StepSettings = StepSettings {
    step: 0,
    learning_rate: 0.01,
    depth_weight: 0.3,
    depth_margin: 0.05,
    distortion_weight: 0.2,
    probe_weight: 0.0,
    roulette: 0.0,
    search: false,
};

/// Gradients of a batch by the fast engine's parts, as arrays in the order of [`Parameters::tensors`].
struct Ours {
    colour: f64,
    depth: f64,
    distortion: f64,
    tensors: Vec<Vec<f32>>,
}

fn ours(
    simd: Level,
    parameters: &Parameters,
    shading: Shading,
    batch: &RayBatch,
    samples: &SampleBatch,
    parts: &Parts,
) -> Ours {
    let (n, lights, columns) = (batch.rays.origins.len(), batch.lights_per_ray, samples.columns);
    let (marcher, coded) = (parts.marcher(simd), coded(&batch.lights));
    let mut gradients = parts.networks.gradients();
    let tile_size = parts.networks.features * columns;
    let mut by_feature = vec![f32::NAN; samples.tiles(&batch.rays) * tile_size];
    let (mut colour, mut depth, mut distortion) = (0.0, 0.0, 0.0);
    // One workspace for all: what a tile leaves must not leak into the next.
    let mut workspace = Workspace::default();
    for (tile, by_feature) in by_feature.chunks_exact_mut(tile_size).enumerate() {
        let here = samples.tile(&marcher, &batch.rays, tile);
        let range = samples.range(&batch.rays, tile);
        let pairs = range.start * lights..range.end * lights;
        let light = |r: usize, l: usize| &coded[batch.light_index[pairs.start + r * lights + l] as usize];
        workspace.forward(simd, &parts.networks, shading, &here, lights, light);
        let truth = &batch.colours[pairs.clone()];
        let errors: Vec<[f32; 3]> = workspace
            .colours
            .iter()
            .zip(truth)
            .map(|(colour, truth)| std::array::from_fn(|c| colour[c] - truth[c]))
            .collect();
        colour += errors.as_flattened().iter().map(|e| f64::from(e * e)).sum::<f64>();
        let scale = 2.0 / (3 * n * lights) as f32;
        let by_colour: Vec<[f32; 3]> = errors.iter().map(|e| e.map(|e| scale * e)).collect();
        let regularisers = Regularisers {
            depths: &batch.depths[range],
            depth_weight: SETTINGS.depth_weight / n as f32,
            depth_margin: SETTINGS.depth_margin,
            distortion_weight: SETTINGS.distortion_weight / n as f32,
            edge: parts.cube.edge,
        };
        let (penalty, spread) = workspace.backward(
            simd,
            &parts.networks,
            shading,
            &here,
            lights,
            &by_colour,
            &regularisers,
            &mut gradients,
            by_feature,
        );
        depth += f64::from(penalty);
        distortion += f64::from(spread);
    }
    // The first moment after the first step is the gradient, but for a factor.
    let mut grid = HashGrid::new(&parameters.config.grid, &parameters.table);
    let tiles: Vec<_> = samples.positions().tiles(&by_feature).collect();
    grid.step(simd, &tiles, 0.01, &Adam::new(0.999));
    let table = grid.moments().0.iter().map(|m| m / (1.0 - BETA1)).collect();
    let mut tensors = vec![table];
    let networks = [Some(&parameters.geo), Some(&parameters.rgb), parameters.vis.as_ref()];
    for (network, gradient) in networks.into_iter().zip(gradients.parts()) {
        let mut rest = gradient;
        for layer in network.iter().flat_map(|n| &n.layers) {
            let (here, after) = rest.split_at(layer.weight.len());
            tensors.push(here.to_vec());
            rest = after;
        }
        assert!(rest.is_empty());
    }
    Ours {
        colour: colour / (3 * n * lights) as f64,
        depth: depth / n as f64,
        distortion: distortion / n as f64,
        tensors,
    }
}

/// Compares both in all that they give. 10 rays of 12 samples, in tiles of `tile_rays`.
fn compare(
    name: &str,
    parameters: &Parameters,
    shading: Shading,
    lights: usize,
    simd: Level,
    tile_rays: usize,
) {
    let name = format!("{name}, {shading:?}, {lights} lights, {simd:?}");
    let batch = batch(10, lights);
    let parts = Parts::new(parameters);
    let mut samples = SampleBatch::default();
    samples.fill(&parts.marcher(simd), &batch.rays, SAMPLING, tile_rays, Jitter(Some(Random::new(1, 2))));

    let ours = ours(simd, parameters, shading, &batch, &samples, &parts);
    let plain = plain_samples(&samples, batch.rays.origins.len());
    let field = Field::<f64>::new(parameters).unwrap();
    let oracle = loss_and_gradient(&field, shading, &batch, &plain, &SETTINGS).unwrap();
    for (what, ours, plain) in [
        ("colour", ours.colour, oracle.colour),
        ("depth", ours.depth, oracle.depth),
        ("distortion", ours.distortion, oracle.distortion),
    ] {
        assert!(plain > 0.0 && (ours / plain - 1.0).abs() < 1e-5, "{name}: {what} {ours} {plain}");
    }
    for ((tensor, _, plain), ours) in oracle.gradient.tensors().into_iter().zip(&ours.tensors) {
        assert_close(&format!("{name}: {tensor}"), ours, plain, 1e-4);
    }
}

#[test]
fn losses_and_gradients_equal_the_oracles() {
    for (name, architecture, shading) in cases() {
        compare(name, &field(architecture), shading, 3, Level::new(), 4);
    }
}

#[test]
fn every_instruction_set_gives_the_same() {
    for simd in levels() {
        for shading in SHADINGS {
            compare("v5", &field(V5), shading, 2, simd, 4);
        }
    }
}

#[test]
fn tiles_of_any_size_give_the_same() {
    for (tile_rays, lights) in [(1, 1), (3, 5), (10, 1), (16, 2)] {
        for shading in SHADINGS {
            compare("v5", &field(V5), shading, lights, Level::new(), tile_rays);
        }
    }
}

/// Visibility depends on the light's direction whatever the colour network is told.
#[test]
fn visibility_goes_with_any_light_input() {
    for light in [LightInput::None, LightInput::Pose] {
        let architecture = Architecture { light, visibility: true, ..V0 };
        for shading in SHADINGS {
            compare(&format!("visibility and {light:?}"), &field(architecture), shading, 3, Level::new(), 4);
        }
    }
}

/// Rays that show the box's face alone, and rays that do not show it.
#[test]
fn clear_and_opaque_fields_give_the_same() {
    for density_scale in [1e-4, 1e3] {
        let mut parameters = field(V5);
        parameters.config.density_scale = density_scale;
        let name = format!("density scale {density_scale}");
        compare(&name, &parameters, Shading::Deferred, 3, Level::new(), 4);
    }
}

/// Samples of a ray of [`SAMPLING`].
const SAMPLES: usize = 12;

/// The densities and weights of a tile of 10 rays.
fn look(parameters: &Parameters) -> Workspace {
    let (parts, batch) = (Parts::new(parameters), batch(10, 3));
    let (marcher, mut samples) = (parts.marcher(Level::new()), SampleBatch::default());
    samples.fill(&marcher, &batch.rays, SAMPLING, 10, Jitter(Some(Random::new(1, 2))));
    let mut workspace = Workspace::default();
    workspace.look(marcher.simd, &parts.networks, &samples.tile(&marcher, &batch.rays, 0));
    workspace
}

/// A tile of rays that end in front of the face, show it alone, and show it through what they meet.
#[test]
fn rays_of_all_kinds_share_a_tile() {
    let mut parameters = field(V5);
    parameters.config.density_scale = 8.0;
    let weights = look(&parameters).weights;
    let beyond: Vec<f32> = (1..=10).map(|r| weights[r * SAMPLES - 1]).collect();
    assert!(beyond.iter().any(|&w| w < NEGLIGIBLE) && beyond.iter().any(|&w| 1.0 - w < NEGLIGIBLE));
    assert!(beyond.iter().any(|&w| (0.01..0.99).contains(&w)), "{beyond:?}");
    compare("all kinds", &parameters, Shading::Deferred, 3, Level::new(), 10);
}

/// Where the derivative of the density no longer follows the logit.
#[test]
fn logits_beyond_the_derivatives_limit_give_the_same() {
    let mut parameters = field(V5);
    // Activations are not negative, so logits are not positive; the density that they scale makes up for it.
    let layer = parameters.geo.layers.last_mut().unwrap();
    layer.weight[..layer.inputs].fill(-7.0);
    parameters.config.density_scale = 3e6;
    let density = look(&parameters).density;
    let logits: Vec<f32> = density[..10 * SAMPLES].iter().map(|d| (d / 3e6).ln()).collect();
    let below = logits.iter().filter(|&&logit| logit < -15.5).count();
    let above = logits.iter().filter(|&&logit| logit > -14.5).count();
    assert!(below > 20 && above > 20, "{logits:?}");
    compare("logits beyond the limit", &parameters, Shading::Deferred, 3, Level::new(), 10);
}
