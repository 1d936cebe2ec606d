//! Pictures in fixed point against the same in single precision.

use fearless_simd::Level;
use relight_cpu::CpuEngine;
use relight_cpu::dense::has_fixed_point;
use relight_field::architecture::{Architecture, V5};
use relight_field::engine::*;
use relight_field::optimiser::Optimiser;
use relight_field::sampling::{EngineConfig, Sampling, Shading};

use crate::common::*;

/// An engine whose layers are large enough for fixed point to be worth it, but for those of few outputs.
fn engine(architecture: Architecture, shading: Shading) -> CpuEngine {
    let sampling = Sampling::Stratified { coarse: 12, fine: 0 };
    let config = EngineConfig { sampling, shading, optimiser: Optimiser::Adam, beta2: 0.999, seed: 3 };
    CpuEngine::new(&field_of(architecture, 4), config).unwrap()
}

fn draw(engine: &CpuEngine, precision: Precision) -> Samples {
    let settings = RenderSettings { samples: None, precision };
    engine.render(&rays(300), &lights()[1], Outputs::default(), &settings).unwrap()
}

/// How far two arrays differ, by their norms.
fn apart(fixed: &[f32], single: &[f32]) -> f64 {
    let norm =
        |values: &mut dyn Iterator<Item = f32>| values.map(|v| f64::from(v).powi(2)).sum::<f64>().sqrt();
    norm(&mut fixed.iter().zip(single).map(|(a, b)| a - b)) / norm(&mut single.iter().copied())
}

#[test]
fn pictures_look_the_same() {
    for (name, architecture, shading) in cases() {
        let engine = engine(architecture, shading);
        let [single, fixed] = [Precision::F32, Precision::I16].map(|precision| draw(&engine, precision));
        let colours = apart(fixed.colour.as_flattened(), single.colour.as_flattened());
        let depths = apart(&fixed.depth, &single.depth);
        assert!(colours < 1e-4 && depths < 1e-3, "{name}, {shading:?}: {colours} {depths}");
        // All have layers in fixed point, of the geometry and of colour.
        assert_eq!(colours.min(depths) > 0.0, has_fixed_point(Level::new()), "{name}, {shading:?}");
    }
}

/// What pictures are made of in fixed point is that of before until somebody makes it anew.
#[test]
fn pictures_follow_what_was_learnt() {
    let mut engine = engine(V5, Shading::Deferred);
    let before = draw(&engine, Precision::I16);
    let settings = StepSettings {
        step: 0,
        learning_rate: 0.05,
        depth_weight: 0.0,
        depth_margin: 0.05,
        distortion_weight: 0.0,
        probe_weight: 0.0,
        roulette: 0.0,
        search: false,
    };
    engine.train_step(&batch(64, 3), &settings).unwrap();
    let [single, fixed] = [Precision::F32, Precision::I16].map(|precision| draw(&engine, precision));
    let moved = apart(single.colour.as_flattened(), before.colour.as_flattened());
    let colours = apart(fixed.colour.as_flattened(), single.colour.as_flattened());
    assert!(moved > 0.01 && colours < 0.01 * moved, "{moved} {colours}");
}
