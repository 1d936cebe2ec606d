//! What an engine refuses, and what it says.

use relight_cpu::CpuEngine;
use relight_field::architecture::{V4, V5};
use relight_field::engine::*;
use relight_field::optimiser::Optimiser;
use relight_field::sampling::{EngineConfig, Sampling, Shading};

use crate::common::*;

const CONFIG: EngineConfig = EngineConfig {
    sampling: Sampling::Guided { samples: 4 },
    shading: Shading::Deferred,
    optimiser: Optimiser::Soap,
    beta2: 0.999,
    seed: 0,
};
const SETTINGS: StepSettings = StepSettings {
    step: 0,
    learning_rate: 0.01,
    depth_weight: 0.0,
    depth_margin: 0.1,
    distortion_weight: 0.0,
    probe_weight: 0.5,
    roulette: 1.5,
    search: false,
};

fn refused<T>(result: Result<T, EngineError>) -> String {
    match result {
        Err(EngineError::Shape(message)) => message,
        Err(other) => panic!("{other}"),
        Ok(_) => panic!("nothing was refused"),
    }
}

#[test]
fn batches_that_contradict_themselves() {
    let mut engine = CpuEngine::new(&field(V5), CONFIG).unwrap();
    let before = engine.parameters().unwrap();
    let mut refuse = |spoil: &dyn Fn(&mut RayBatch), about: &str| {
        let mut batch = batch(6, 2);
        spoil(&mut batch);
        let message = refused(engine.train_step(&batch, &SETTINGS));
        assert!(message.contains(about), "{message}");
    };
    refuse(&|b| *b = RayBatch::default(), "empty");
    refuse(&|b| b.lights_per_ray = 0, "empty");
    refuse(&|b| b.lights_per_ray = 3, "lights a ray");
    refuse(&|b| b.rays.directions.truncate(5), "directions");
    refuse(&|b| b.light_index.truncate(11), "light indices");
    refuse(&|b| b.light_index[3] = 5, "past the lights");
    refuse(&|b| b.lights.clear(), "past the lights");
    refuse(&|b| b.colours.truncate(11), "colours");
    refuse(&|b| b.depths.truncate(5), "depths");
    refuse(&|b| b.probe_lights.truncate(5), "probes");
    refuse(&|b| b.probe_colours.clear(), "probes");
    let truncate = |b: &mut RayBatch| {
        b.probe_lights.truncate(5);
        b.probe_colours.truncate(5);
    };
    refuse(&truncate, "probes");
    assert_eq!(engine.parameters().unwrap(), before);
    // Without any expected depths a batch is fine.
    let mut batch = batch(6, 2);
    batch.depths.clear();
    engine.train_step(&batch, &SETTINGS).unwrap();
}

#[test]
fn points_and_rays_without_directions() {
    let engine = CpuEngine::new(&field(V5), CONFIG).unwrap();
    let mut rays = rays(3);
    rays.directions.pop();
    let settings = RenderSettings::default();
    refused(engine.render(&rays, &lights()[0], Outputs::default(), &settings));
    let points = Points {
        positions: vec![[0.0; 3]; 3],
        directions: vec![[0.0, 0.0, 1.0]; 2],
        light: Some(lights()[0]),
    };
    refused(engine.query(&points));
}

#[test]
fn engines_that_cannot_be() {
    for sampling in [
        Sampling::Guided { samples: 1 },
        Sampling::Stratified { coarse: 1, fine: 8 },
        Sampling::Stratified { coarse: 0, fine: 0 },
    ] {
        let message = refused(CpuEngine::new(&field(V5), EngineConfig { sampling, ..CONFIG }));
        assert!(message.contains("two samples"), "{message}");
    }
    for beta2 in [0.0, 1.0, f64::NAN] {
        let message = refused(CpuEngine::new(&field(V5), EngineConfig { beta2, ..CONFIG }));
        assert!(message.contains("beta2"), "{message}");
    }
    let mut short = field(V5);
    short.table.pop();
    refused(CpuEngine::new(&short, CONFIG));
    let mut diverged = field(V5);
    diverged.rgb.layers[1].weight[0] = f32::NAN;
    refused(CpuEngine::new(&diverged, CONFIG));
}

#[test]
fn checkpoints_of_other_runs() {
    let mut engine = CpuEngine::new(&field(V5), CONFIG).unwrap();
    engine.train_step(&batch(6, 2), &SETTINGS).unwrap();
    let (parameters, state) = (engine.parameters().unwrap(), engine.state().unwrap());
    refused(engine.restore(&field(V4), &state));
    for name in state.keys() {
        let mut without = state.clone();
        without.remove(name);
        let message = refused(engine.restore(&field(V5), &without));
        assert!(message.contains(name), "{name}: {message}");
        let mut short = state.clone();
        short.insert(name.clone(), StateTensor::U8(vec![1]));
        refused(engine.restore(&field(V5), &short));
    }
    // Moments are in bases that Adam knows nothing of.
    let mut plain =
        CpuEngine::new(&field(V5), EngineConfig { optimiser: Optimiser::Adam, ..CONFIG }).unwrap();
    let message = refused(plain.restore(&parameters, &state));
    assert!(message.contains("SOAP"), "{message}");
    // Refused checkpoints change nothing.
    assert_eq!(engine.parameters().unwrap(), parameters);
    assert!(engine.state().unwrap() == state);
}

/// A file may hold any numbers: counts that cannot grow are no reason to panic.
#[test]
fn checkpoints_with_absurd_counts() {
    let mut engine = CpuEngine::new(&field(V5), CONFIG).unwrap();
    let mut state = engine.state().unwrap();
    for tensor in state.values_mut() {
        if let StateTensor::U32(counts) = tensor {
            counts.fill(u32::MAX);
        }
    }
    engine.restore(&field(V5), &state).unwrap();
    engine.train_step(&batch(6, 2), &SETTINGS).unwrap();
}
