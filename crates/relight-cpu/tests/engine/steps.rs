//! Whole training steps against the oracle's gradients and plain Adam.

use fearless_simd::Level;
use relight_cpu::CpuEngine;
use relight_cpu::adam::Adam;
use relight_cpu::networks::Networks;
use relight_cpu::samples::{Jitter, Marcher, SampleBatch};
use relight_field::architecture::V5;
use relight_field::engine::*;
use relight_field::optimiser::{Optimiser, PERIOD};
use relight_field::parameters::Parameters;
use relight_field::random::Random;
use relight_field::reference::{Field, Soap, loss_and_gradient};
use relight_field::sampling::{EngineConfig, Sampling};

use crate::common::*;

const SEED: u64 = 3;

pub(crate) fn settings(step: u64) -> StepSettings {
    StepSettings {
        step,
        learning_rate: 0.003,
        depth_weight: 0.1,
        depth_margin: 0.05,
        distortion_weight: 0.05,
        probe_weight: 0.0,
        roulette: 0.0,
        search: true,
    }
}

/// Of so many guided samples a ray.
pub(crate) fn guided(samples: usize) -> EngineConfig {
    EngineConfig {
        sampling: Sampling::Guided { samples },
        shading: SHADINGS[0],
        optimiser: Optimiser::Adam,
        beta2: 0.999,
        seed: SEED,
    }
}

fn f32s<'a>(state: &'a EngineState, name: &str) -> &'a [f32] {
    match &state[name] {
        StateTensor::F32(values) => values,
        other => panic!("{name}: {other:?}"),
    }
}

fn u32s<'a>(state: &'a EngineState, name: &str) -> &'a [u32] {
    match &state[name] {
        StateTensor::U32(values) => values,
        other => panic!("{name}: {other:?}"),
    }
}

/// The table, and the weights of each network one after another.
fn groups<R: relight_field::real::Real>(parameters: &Parameters<R>) -> [Vec<R>; 4] {
    let mut groups = [const { Vec::new() }; 4];
    for (name, _, values) in parameters.tensors() {
        let group = ["grid", "geo", "rgb", "vis"].iter().position(|g| name.starts_with(g)).unwrap();
        groups[group].extend_from_slice(values);
    }
    groups
}

/// Three steps. Each one's moments must be those of the oracle's gradients at the parameters before it, and its
/// parameters those that Adam makes of its moments.
#[test]
fn three_steps_follow_the_oracles_gradients() {
    let (n, mut batch) = (37, batch(37, 3));
    // Samples of a ray that misses lie on corners of the box, and meet other vertices with weight zero: the oracle
    // counts those untouched.
    batch.rays.origins[0] = batch.rays.origins[1];
    for (name, architecture, shading) in cases() {
        // A second pass puts samples so close together that some of them are too light to be shaded.
        let sampling = Sampling::Stratified { coarse: 12, fine: 0 };
        let beta2 = 0.99f64;
        let config = EngineConfig { sampling, shading, optimiser: Optimiser::Adam, beta2, seed: SEED };
        let mut engine = CpuEngine::new(&field(architecture), config).unwrap();
        let mut moments: [Vec<[f64; 2]>; 4] =
            groups(&engine.parameters().unwrap()).map(|g| vec![[0.0; 2]; g.len()]);
        for step in 0..3 {
            let name = format!("{name}, {shading:?}, step {step}");
            let before = engine.parameters().unwrap();
            let parts = Parts::new(&before);
            let mut samples = SampleBatch::default();
            let jitter = Jitter(Some(Random::new(SEED, step)));
            let marcher = Marcher { search: true, ..parts.marcher(Level::new()) };
            samples.fill(&marcher, &batch.rays, sampling, 4, jitter);
            let stats = engine.train_step(&batch, &settings(step)).unwrap();

            let plain = plain_samples(&samples, n);
            let field = Field::<f64>::new(&before).unwrap();
            let oracle = loss_and_gradient(&field, shading, &batch, &plain, &settings(step)).unwrap();
            assert!((stats.loss / oracle.colour - 1.0).abs() < 1e-5, "{name}: {stats:?} {}", oracle.colour);
            assert!((stats.depth_spread / oracle.depth_spread - 1.0).abs() < 1e-3, "{name}: {stats:?}");
            assert_eq!((stats.rays, stats.pixels, stats.samples), (n, 3 * n, 12 * n));

            let (state, after) = (engine.state().unwrap(), groups(&engine.parameters().unwrap()));
            let (before, gradient) = (groups(&before), groups(&oracle.gradient));
            let updates = u32s(&state, "adam.grid.updates");
            for (g, group) in ["grid", "geo", "rgb", "vis"].into_iter().enumerate() {
                if before[g].is_empty() {
                    continue;
                }
                let name = format!("{name}, {group}");
                let touched =
                    |i: usize| group != "grid" || gradient[g][i & !1] != 0.0 || gradient[g][i | 1] != 0.0;
                for (i, [m, v]) in moments[g].iter_mut().enumerate().filter(|&(i, _)| touched(i)) {
                    let d = gradient[g][i];
                    (*m, *v) = (0.9 * *m + 0.1 * d, beta2 * *v + (1.0 - beta2) * d * d);
                }
                let [first, second] = [0, 1].map(|k| moments[g].iter().map(|m| m[k]).collect::<Vec<_>>());
                let (m, v) =
                    (f32s(&state, &format!("adam.{group}.m")), f32s(&state, &format!("adam.{group}.v")));
                assert_close(&name, m, &first, 1e-4);
                assert_close(&name, v, &second, 2e-4);
                for (i, (&before, &after)) in before[g].iter().zip(&after[g]).enumerate() {
                    if !touched(i) {
                        assert_eq!(before.to_bits(), after.to_bits(), "{name}, number {i}");
                        continue;
                    }
                    let count = if group == "grid" { updates[i / 2] } else { step as u32 + 1 } as i32;
                    let first = f64::from(m[i]) / (1.0 - 0.9f64.powi(count));
                    let second = f64::from(v[i]) / (1.0 - beta2.powi(count));
                    let plain = f64::from(before) - 0.003 * first / (second.sqrt() + 1e-15);
                    // The square of a tiny gradient loses its digits to underflow.
                    assert!(second < 1e-36 || (f64::from(after) - plain).abs() < 1e-6, "{name}, number {i}");
                }
            }
        }
    }
}

/// A field learns a batch by heart, with either way of placing samples.
#[test]
fn training_lowers_the_loss() {
    let batch = batch(64, 2);
    let samplings = [Sampling::Guided { samples: 16 }, Sampling::Stratified { coarse: 8, fine: 8 }];
    let ways = samplings.into_iter().flat_map(|s| SHADINGS.map(|shading| (s, shading)));
    for (sampling, shading) in ways {
        for optimiser in [Optimiser::Adam, Optimiser::Soap] {
            let config = EngineConfig { sampling, shading, optimiser, beta2: 0.999, seed: SEED };
            let mut engine = CpuEngine::new(&field(V5), config).unwrap();
            let mut loss = |steps: std::ops::Range<u64>| {
                steps.map(|step| engine.train_step(&batch, &settings(step)).unwrap().loss).last().unwrap()
            };
            let (first, last) = (loss(0..1), loss(1..60));
            assert!(last < 0.5 * first, "{sampling:?}, {shading:?}, {optimiser:?}: {first} {last}");
        }
    }
}

/// Every layer by itself, with its own part of the gradient, and renewing its bases when it is its turn.
#[test]
fn networks_follow_by_soap_as_the_oracle_does() {
    const RATE: f32 = 0.01;
    let parameters = field(V5);
    let (mut networks, adam) = (Networks::new(&parameters), Adam::new(0.999));
    let mut moments = networks.moments(Optimiser::Soap);
    // Layers in their order, each with its number in its network.
    let tensors: Vec<_> = parameters.tensors().into_iter().skip(1).collect();
    let mut oracle: Vec<_> = tensors
        .iter()
        .map(|(name, shape, weights)| {
            let layer: u32 = name.split('.').nth(1).unwrap().parse().unwrap();
            let weights: Vec<f64> = weights.iter().map(|&w| f64::from(w)).collect();
            let zeros = vec![0.0; weights.len()];
            (layer, Soap::<f64>::new(*shape), weights, zeros.clone(), zeros)
        })
        .collect();
    for count in 1..=u64::from(PERIOD) + 5 {
        let random = Random::new(8, count);
        let mut gradients = networks.gradients();
        let numbers = [&mut gradients.geo, &mut gradients.rgb, &mut gradients.vis].into_iter().flatten();
        (0..).zip(numbers).for_each(|(i, g)| *g = random.uniform_at(i) - 0.4);
        let mut left: Vec<f64> = gradients.parts().concat().into_iter().map(f64::from).collect();
        networks.step(Level::new(), &gradients, &mut moments, RATE, &adam);
        for (layer, soap, weights, first, second) in &mut oracle {
            let rest = left.split_off(weights.len());
            let at = (*layer, count as u32);
            soap.step(weights, &left, [&mut first[..], &mut second[..]], at, f64::from(RATE), 0.999);
            left = rest;
        }
    }
    let mut after = parameters.clone();
    (after.geo, after.rgb) = (networks.geo.network(), networks.rgb.network());
    after.vis = networks.vis.as_ref().map(|vis| vis.network());
    for ((name, _, ours), (_, _, plain, ..)) in after.tensors().into_iter().skip(1).zip(&oracle) {
        let squares = ours.iter().zip(plain).map(|(&o, p)| (f64::from(o) - p).powi(2));
        let apart = (squares.sum::<f64>() / plain.len() as f64).sqrt();
        assert!(apart < 5e-3, "{name}: {apart}");
    }
}

/// What is known to be worth nothing is not learnt from.
#[test]
fn probes_that_nobody_trusts_change_nothing() {
    let batch = batch(40, 3);
    let config = guided(12);
    let [without, distrusted] = [(0.0, 0.005), (0.7, 0.0)].map(|(probe_weight, least)| {
        let parameters = field(V5);
        let mut engine = CpuEngine::new(&parameters, config).unwrap();
        let mut state = engine.state().unwrap();
        tell(&mut state, [[1.0, 100.0], [1.0, 100.0]], least);
        engine.restore(&parameters, &state).unwrap();
        engine.train_step(&batch, &StepSettings { probe_weight, ..settings(0) }).unwrap();
        engine
    });
    let same =
        groups(&without.parameters().unwrap()).into_iter().zip(groups(&distrusted.parameters().unwrap()));
    for (group, (without, distrusted)) in ["grid", "geo", "rgb", "vis"].into_iter().zip(same) {
        let expected: Vec<f64> = without.iter().map(|&w| f64::from(w)).collect();
        assert_close(group, &distrusted, &expected, 1e-5);
    }
}

/// Where something is known, a search sends some samples elsewhere.
#[test]
fn steps_that_search_place_samples_otherwise() {
    let (batch, parameters) = (batch(60, 2), field(V5));
    let config = guided(12);
    let random = Random::new(8, 0);
    let point = |i: u64| [0, 1, 2].map(|a| 0.6 * random.uniform_at(3 * i + a) - [0.3, 0.3, 0.0][a as usize]);
    let points: Vec<[f32; 3]> = (0..20_000).map(point).collect();
    let [searches, again, knows] = [true, true, false].map(|search| {
        let mut engine = CpuEngine::new(&parameters, config).unwrap();
        engine.expect_surfaces(&points);
        engine.train_step(&batch, &StepSettings { search, ..settings(0) }).unwrap().loss
    });
    assert_eq!(searches, again);
    assert_ne!(searches, knows);
}

/// Each stage counts its own work.
#[test]
fn stages_count_what_a_step_takes() {
    let (n, samples) = (40, 12);
    let batch = batch(n, 3);
    let parameters = field(V5);
    let config = guided(samples);
    let mut engine = CpuEngine::new(&parameters, config).unwrap();
    for step in 0..2 {
        engine
            .train_step(&batch, &StepSettings { probe_weight: 0.5, roulette: 1.0, ..settings(step) })
            .unwrap();
    }
    let stages = engine.stages();
    let of = |name: &str| stages.iter().find(|(stage, _)| *stage == name).unwrap().1;
    let levels = parameters.config.grid.levels;
    assert_eq!(of("encode").lookups, (2 * n * samples * levels * 8) as f64);
    let scattered = of("scatter").updates;
    assert!(scattered > 0.0 && scattered < of("encode").lookups, "roulette leaves samples out: {scattered}");
    assert_eq!(of("occupancy").updates, (2 * n * samples) as f64);
    let weights =
        |layers: &[relight_field::parameters::Layer]| layers.iter().map(|l| l.weight.len()).sum::<usize>();
    let pairs = of("colour and visibility").operations
        / (2 * (weights(&parameters.rgb.layers) + weights(&parameters.vis.as_ref().unwrap().layers))) as f64;
    // Three photographs and two probes a ray, nearly all at two points, and columns that fill the tiles up.
    assert!((600.0..800.0).contains(&pairs), "{pairs}");
}

/// Probes that were photographed are pairs like any other, as far as probes are trusted.
#[test]
fn photographed_probes_count_as_further_pairs() {
    let n = 40;
    let mut batch = batch(n, 3);
    batch.rays.origins[0] = batch.rays.origins[1];
    batch.probe_lights = (0..2 * n).map(|p| lights()[p % 3]).collect();
    batch.probe_colours = (0..2 * n).map(|p| [0.1, 0.4, 0.01 * p as f32]).collect();
    // The oracle gets them as pairs.
    let mut with_pairs = batch.clone();
    with_pairs.lights.extend(&batch.probe_lights);
    with_pairs.lights_per_ray = 5;
    (with_pairs.light_index, with_pairs.colours) = (Vec::new(), Vec::new());
    for r in 0..n {
        with_pairs.light_index.extend(&batch.light_index[3 * r..3 * r + 3]);
        with_pairs.light_index.extend([2 * r, 2 * r + 1].map(|p| (batch.lights.len() + p) as u32));
        with_pairs.colours.extend(&batch.colours[3 * r..3 * r + 3]);
        with_pairs.colours.extend(&batch.probe_colours[2 * r..2 * r + 2]);
    }
    let settings =
        StepSettings { depth_weight: 0.0, distortion_weight: 0.0, probe_weight: 4.0 / 3.0, ..settings(0) };
    for shading in SHADINGS {
        let sampling = Sampling::Stratified { coarse: 12, fine: 0 };
        let mut engine = CpuEngine::new(
            &field(V5),
            EngineConfig { sampling, shading, optimiser: Optimiser::Adam, beta2: 0.999, seed: SEED },
        )
        .unwrap();
        let before = engine.parameters().unwrap();
        let mut samples = SampleBatch::default();
        let jitter = Jitter(Some(Random::new(SEED, 0)));
        let parts = Parts::new(&before);
        let marcher = Marcher { search: true, ..parts.marcher(Level::new()) };
        samples.fill(&marcher, &batch.rays, sampling, 4, jitter);
        // As if imagined colours had proved to miss by twice as much as the field: probes count half.
        let mut trusting = engine.state().unwrap();
        tell(&mut trusting, [[1.0, 100.0], [1.0, 100.0]], 0.005);
        engine.restore(&before, &trusting).unwrap();
        let stats = engine.train_step(&batch, &settings).unwrap();
        let after = engine.state().unwrap();
        let &[imagined, guesses, field, steps, least] = f32s(&after, "probes") else { panic!() };
        assert!(imagined > 0.999 && guesses > 99.9, "photographed probes tell what guesses are worth");
        assert!((f64::from(field) - 0.999 - stats.loss).abs() < 1e-5 && (steps - 100.9).abs() < 1e-3);
        assert_eq!(least, 0.005f32.min(field / steps));
        let plain = plain_samples(&samples, n);
        let field = Field::<f64>::new(&before).unwrap();
        let oracle = loss_and_gradient(&field, shading, &with_pairs, &plain, &settings).unwrap();
        let (state, gradient) = (engine.state().unwrap(), groups(&oracle.gradient));
        for (g, group) in ["grid", "geo", "rgb", "vis"].into_iter().enumerate() {
            // The mean is over three pairs, not five; a first moment is a tenth of the gradient.
            let expected: Vec<f64> = gradient[g].iter().map(|d| 0.1 * d * 5.0 / 3.0).collect();
            assert_close(group, f32s(&state, &format!("adam.{group}.m")), &expected, 1e-4);
        }
    }
}
