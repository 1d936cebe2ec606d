//! The same run again, on other numbers of threads, and continued from a checkpoint: always the same bits.

use relight_cpu::CpuEngine;
use relight_field::architecture::V5;
use relight_field::engine::*;
use relight_field::optimiser::{Optimiser, PERIOD};
use relight_field::parameters::Parameters;
use relight_field::sampling::{EngineConfig, Sampling, Shading};

use crate::common::*;

/// The fast recipe's way and the paper's.
const CONFIGS: [EngineConfig; 2] = [
    EngineConfig {
        sampling: Sampling::Guided { samples: 9 },
        shading: Shading::Deferred,
        optimiser: Optimiser::Soap,
        beta2: 0.999,
        seed: 11,
    },
    EngineConfig {
        sampling: Sampling::Stratified { coarse: 5, fine: 4 },
        shading: Shading::PerSample,
        optimiser: Optimiser::Adam,
        beta2: 0.99,
        seed: 11,
    },
];

/// Steps after which all layers have had new bases, and some before the last of those.
const RENEWED: u64 = PERIOD as u64 + 4;
const BEFORE: u64 = PERIOD as u64 - 5;
/// The number of the first step: the density grid is surveyed between those two, after step 255.
const FIRST: u64 = 255 - PERIOD as u64;

fn settings(step: u64) -> StepSettings {
    StepSettings {
        step: FIRST + step,
        learning_rate: 0.01,
        depth_weight: 0.1,
        depth_margin: 0.05,
        distortion_weight: 0.05,
        probe_weight: 0.5,
        roulette: 1.5,
        search: false,
    }
}

fn engine(config: EngineConfig) -> CpuEngine {
    // As the presets have it.
    let features = if config.shading == Shading::Deferred { 4 } else { 2 };
    let field = field_of(V5, features);
    let mut engine = CpuEngine::new(&field, config).unwrap();
    // It has seen shadows and how far imagined colours miss, and so imagines what probes show and trusts it by half.
    let mut state = engine.state().unwrap();
    tell(&mut state, [[2.0, 80.0], [1.0, 70.0]], 0.0125);
    engine.restore(&field, &state).unwrap();
    engine.expect_surfaces(&[[0.1, 0.1, 0.3], [-0.2, 0.0, 0.5], [9.0, 0.0, 0.0]]);
    engine
}

/// Takes the steps, of more tiles than there are partial sums.
fn train(engine: &mut CpuEngine, steps: std::ops::Range<u64>) {
    let batch = batch(701, 2);
    for step in steps {
        engine.train_step(&batch, &settings(step)).unwrap();
    }
}

fn bits(parameters: &Parameters) -> Vec<u32> {
    parameters.tensors().iter().flat_map(|(_, _, v)| v.iter().map(|v| v.to_bits())).collect()
}

fn assert_same(a: &CpuEngine, b: &CpuEngine) {
    assert!(bits(&a.parameters().unwrap()) == bits(&b.parameters().unwrap()), "parameters differ");
    assert!(a.state().unwrap() == b.state().unwrap(), "states differ");
}

#[test]
fn the_same_seed_gives_the_same_run_on_any_number_of_threads() {
    for config in CONFIGS {
        let [one, four] = [1, 4].map(|threads| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| {
                let mut engine = engine(config);
                train(&mut engine, 0..RENEWED);
                engine
            })
        });
        assert_same(&one, &four);
        let drawn = |threads: usize| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            let settings = RenderSettings::default();
            pool.install(|| {
                one.render(&rays(5000), &lights()[0], Outputs::default(), &settings).unwrap().colour
            })
        };
        assert!(drawn(1) == drawn(4));

        let mut other = engine(EngineConfig { seed: 12, ..config });
        train(&mut other, 0..2);
        let mut same = engine(config);
        train(&mut same, 0..2);
        assert!(
            bits(&other.parameters().unwrap()) != bits(&same.parameters().unwrap()),
            "the seed is ignored"
        );
    }
}

#[test]
fn imagined_probes_are_learnt_from() {
    let mut batch = batch(701, 2);
    batch.probe_colours.fill([f32::NAN; 3]);
    for config in CONFIGS {
        let [with, without] = [0.5, 0.0].map(|probe_weight| {
            let mut engine = engine(config);
            engine.train_step(&batch, &StepSettings { probe_weight, ..settings(0) }).unwrap();
            engine
        });
        assert!(bits(&with.parameters().unwrap()) != bits(&without.parameters().unwrap()));
    }
}

/// Before shadows had classes, one number told of them all, and it is forgotten.
#[test]
fn what_older_checkpoints_tell_of_probes_is_kept_but_for_shadows() {
    let field = field(V5);
    let mut engine = CpuEngine::new(&field, CONFIGS[0]).unwrap();
    let mut state = engine.state().unwrap();
    let unknown = state["probes.shadows"].clone();
    tell(&mut state, [[2.0, 80.0], [1.0, 70.0]], 0.0125);
    let newer = state.clone();
    state.remove("probes.shadows");
    state.insert("probes".into(), StateTensor::F32(vec![40.0, 90.0, 2.0, 80.0, 1.0, 70.0, 0.0125]));
    engine.restore(&field, &newer).unwrap();
    assert!(engine.state().unwrap() == newer);
    engine.restore(&field, &state).unwrap();
    let restored = engine.state().unwrap();
    assert_eq!(restored["probes"], newer["probes"]);
    assert_eq!(restored["probes.shadows"], unknown);
    for (name, numbers) in [("probes", 3), ("probes", 9), ("probes.shadows", 3), ("probes.shadows", 40)] {
        let mut wrong = newer.clone();
        wrong.insert(name.into(), StateTensor::F32(vec![1.0; numbers]));
        assert!(engine.restore(&field, &wrong).is_err(), "{name} of {numbers} numbers");
    }
}

#[test]
fn a_restored_run_is_the_very_same_run() {
    for config in CONFIGS {
        let mut straight = engine(config);
        train(&mut straight, 0..BEFORE);
        let (parameters, state) = (straight.parameters().unwrap(), straight.state().unwrap());
        train(&mut straight, BEFORE..RENEWED);

        // Into an engine that has been elsewhere.
        let mut restored = engine(config);
        train(&mut restored, 60..61);
        restored.restore(&parameters, &state).unwrap();
        train(&mut restored, BEFORE..RENEWED);
        assert_same(&straight, &restored);
    }
}

/// Of a small batch after a large one: what the partial sums of the large one hold must not count again.
#[test]
fn steps_of_other_sizes_leave_nothing_behind() {
    for config in CONFIGS {
        let (mut used, mut fresh) = (engine(config), engine(config));
        used.train_step(&batch(701, 2), &settings(0)).unwrap();
        fresh.restore(&used.parameters().unwrap(), &used.state().unwrap()).unwrap();
        for engine in [&mut used, &mut fresh] {
            engine.train_step(&batch(20, 2), &settings(1)).unwrap();
        }
        assert_same(&used, &fresh);
    }
}

#[test]
fn a_step_that_is_not_finite_changes_nothing() {
    for config in CONFIGS {
        for bad in [f32::NAN, f32::INFINITY, 1e30] {
            let mut engine = engine(config);
            train(&mut engine, 0..2);
            let (parameters, state) = (engine.parameters().unwrap(), engine.state().unwrap());
            let mut batch = batch(701, 2);
            batch.colours[1234][1] = bad;
            let error = engine.train_step(&batch, &settings(2)).unwrap_err();
            assert!(matches!(error, EngineError::NonFinite { step, .. } if step == FIRST + 2), "{error}");
            assert!(bits(&parameters) == bits(&engine.parameters().unwrap()));
            assert!(state == engine.state().unwrap());

            // Nor does it leave anything behind that shows later.
            train(&mut engine, 2..4);
            let mut untroubled = self::engine(config);
            train(&mut untroubled, 0..4);
            assert_same(&engine, &untroubled);
        }
    }
}

#[test]
fn rays_that_are_nowhere_are_refused_in_training_and_harmless_in_pictures() {
    for config in CONFIGS {
        let mut engine = engine(config);
        let parameters = engine.parameters().unwrap();
        for (origin, direction) in [([f32::NAN; 3], [0.0, 0.0, 1.0]), ([0.0; 3], [f32::NAN, 0.0, 0.0])] {
            let mut batch = batch(20, 2);
            (batch.rays.origins[7], batch.rays.directions[7]) = (origin, direction);
            let error = engine.train_step(&batch, &settings(0)).unwrap_err();
            assert!(matches!(error, EngineError::NonFinite { .. }), "{error}");
            assert!(bits(&parameters) == bits(&engine.parameters().unwrap()));
            let settings = RenderSettings::default();
            let drawn = engine.render(&batch.rays, &lights()[0], Outputs::default(), &settings).unwrap();
            let alone = engine.render(&rays(20), &lights()[0], Outputs::default(), &settings).unwrap();
            // The other rays do not notice.
            assert!((0..20).all(|r| r == 7 || drawn.colour[r] == alone.colour[r]));
        }
    }
}
