//! The plain engine as an engine: it learns, resumes and refuses.

use relight_field::architecture::{V0, V2, V5};
use relight_field::engine::{
    Engine, EngineError, LightPose, Outputs, Points, RayBatch, Rays, RenderSettings, StepSettings,
};
use relight_field::optimiser::Optimiser;
use relight_field::parameters::Parameters;
use relight_field::reference::ReferenceEngine;
use relight_field::sampling::{EngineConfig, Sampling, Shading};

use crate::tiny::{batch, config, settings, trained};

const ENGINE: EngineConfig = EngineConfig {
    sampling: Sampling::Stratified { coarse: 8, fine: 8 },
    shading: Shading::PerSample,
    optimiser: Optimiser::Adam,
    beta2: 0.999,
    seed: 4,
};

fn engine() -> ReferenceEngine<f32> {
    ReferenceEngine::new(&Parameters::init(config(V5), 1).unwrap(), ENGINE).unwrap()
}

fn at(step: u64) -> StepSettings {
    StepSettings { step, ..settings(0.0, 0.01) }
}

#[test]
fn it_learns_a_batch_by_heart() {
    for shading in [Shading::PerSample, Shading::Deferred] {
        let parameters = Parameters::init(config(V5), 1).unwrap();
        let mut engine =
            ReferenceEngine::<f32>::new(&parameters, EngineConfig { shading, ..ENGINE }).unwrap();
        let batch = batch(4, 2, 1.0);
        let losses: Vec<f64> =
            (0..100).map(|step| engine.train_step(&batch, &at(step)).unwrap().loss).collect();
        assert!(losses[99] < 0.05 * losses[0], "{shading:?}: {} to {}", losses[0], losses[99]);
    }
}

#[test]
fn a_step_says_what_it_did() {
    let stats = engine().train_step(&batch(3, 2, 1.0), &at(0)).unwrap();
    // 8 coarse, 8 fine and the opaque sample.
    assert_eq!((stats.rays, stats.pixels, stats.samples), (3, 6, 51));
    assert!(stats.depth_spread > 0.0 && stats.depth_spread < 1.0);
}

#[test]
fn a_restored_engine_continues_the_very_same_run() {
    for optimiser in [Optimiser::Adam, Optimiser::Soap] {
        restored_continues(EngineConfig { optimiser, ..ENGINE });
    }
}

fn restored_continues(config: EngineConfig) {
    let engine =
        || ReferenceEngine::<f32>::new(&Parameters::init(self::config(V5), 1).unwrap(), config).unwrap();
    let batch = batch(3, 2, 1.0);
    let mut whole = engine();
    let mut first = engine();
    for step in 0..6 {
        whole.train_step(&batch, &at(step)).unwrap();
        if step < 3 {
            first.train_step(&batch, &at(step)).unwrap();
        }
    }
    let mut second = engine();
    second.restore(&first.parameters().unwrap(), &first.state().unwrap()).unwrap();
    for step in 3..6 {
        second.train_step(&batch, &at(step)).unwrap();
    }
    assert_eq!(second.parameters().unwrap(), whole.parameters().unwrap());
    assert_eq!(second.state().unwrap(), whole.state().unwrap());
}

#[test]
fn another_fields_checkpoint_is_refused() {
    let mut engine = engine();
    let other = ReferenceEngine::<f32>::new(&Parameters::init(config(V2), 1).unwrap(), ENGINE).unwrap();
    let (parameters, state) = (engine.parameters().unwrap(), other.state().unwrap());
    assert!(matches!(engine.restore(&other.parameters().unwrap(), &state), Err(EngineError::Shape(_))));
    assert!(matches!(engine.restore(&parameters, &state), Err(EngineError::Shape(_))));
    assert_eq!(engine.parameters().unwrap(), parameters);
}

#[test]
fn a_colour_that_is_not_finite_stops_the_step_and_spares_the_weights() {
    let mut engine = engine();
    let before = engine.parameters().unwrap();
    let mut batch = batch(3, 2, 1.0);
    batch.colours[2][1] = f32::NAN;
    let error = engine.train_step(&batch, &at(7)).unwrap_err();
    assert_eq!(error.to_string(), "step 7: the loss is not finite");
    assert_eq!(engine.parameters().unwrap(), before);
}

#[test]
fn contradictory_batches_are_refused() {
    let refuse = |change: fn(&mut RayBatch)| {
        let mut batch = batch(3, 2, 1.0);
        change(&mut batch);
        assert!(matches!(engine().train_step(&batch, &at(0)), Err(EngineError::Shape(_))));
    };
    refuse(|b| b.rays.directions.truncate(2));
    refuse(|b| b.colours.truncate(5));
    refuse(|b| b.light_index.truncate(5));
    refuse(|b| b.light_index[0] = 3);
    refuse(|b| b.depths.truncate(1));
    refuse(|b| b.lights_per_ray = usize::MAX);
    refuse(|b| *b = RayBatch::default());
    let margin = StepSettings { depth_margin: 0.0, ..settings(0.1, 0.0) };
    assert!(matches!(engine().train_step(&batch(3, 2, 1.0), &margin), Err(EngineError::Shape(_))));
}

#[test]
fn unknown_ways_of_sampling_are_refused() {
    let parameters = Parameters::init(config(V5), 1).unwrap();
    for sampling in [Sampling::Guided { samples: 8 }, Sampling::Stratified { coarse: 0, fine: 8 }] {
        let error =
            ReferenceEngine::<f32>::new(&parameters, EngineConfig { sampling, ..ENGINE }).unwrap_err();
        assert!(matches!(error, EngineError::Shape(_)));
    }
}

#[test]
fn pictures_hold_what_was_asked_for() {
    let batch = batch(5, 1, 1.0);
    let all = Outputs { visibility: true, reflectance: true };
    let engine = ReferenceEngine::<f64>::new(&trained(config(V5), 1), ENGINE).unwrap();
    let draw = |outputs, samples| {
        engine
            .render(&batch.rays, &batch.lights[0], outputs, &RenderSettings { samples, ..Default::default() })
            .unwrap()
    };
    let bare = draw(Outputs::default(), None);
    assert_eq!((bare.colour.len(), bare.visibility.len(), bare.reflectance.len()), (5, 0, 0));
    let full = draw(all, Some(48));
    assert_eq!((full.visibility.len(), full.reflectance.len()), (5, 5));
    for i in 0..5 {
        assert!((0..3).all(|c| full.colour[i][c] <= full.reflectance[i][c] && full.colour[i][c] > 0.0));
        assert!((0.0..=1.0).contains(&full.visibility[i]) && (0.0..=1.0).contains(&full.opacity[i]));
        // The cameras are at z = 1, the box is below 0.8 and ends at 0 or at a side.
        assert!(full.depth[i] > 0.2 && full.depth[i] < 1.3);
        // Few samples and many agree roughly.
        assert!((0..3).all(|c| (full.colour[i][c] - bare.colour[i][c]).abs() < 0.1));
    }
    let none = ReferenceEngine::<f32>::new(&trained(config(V0), 1), ENGINE).unwrap();
    assert!(
        none.render(&batch.rays, &batch.lights[0], all, &RenderSettings::default())
            .unwrap()
            .visibility
            .is_empty()
    );
}

#[test]
fn a_ray_that_misses_the_box_still_has_a_colour() {
    let rays = Rays { origins: vec![[5.0, 5.0, 5.0]], directions: vec![[0.0, 0.0, 1.0]] };
    let light = LightPose([0.5; 12]);
    let picture = engine().render(&rays, &light, Outputs::default(), &RenderSettings::default()).unwrap();
    assert!(picture.colour[0].iter().all(|c| (0.0..=1.0).contains(c)));
    assert_eq!(picture.opacity[0], 0.0);
}

#[test]
fn the_field_ends_at_its_box_and_needs_a_light() {
    let mut points = Points {
        positions: vec![[0.0, 0.0, 0.4], [0.0, 0.0, 0.9]],
        directions: vec![[0.0, 0.0, -1.0]; 2],
        light: Some(LightPose([0.5; 12])),
    };
    let values = engine().query(&points).unwrap();
    assert!(values.density[0] > 0.0 && values.density[1] == 0.0);
    points.light = None;
    assert!(engine().query(&points).unwrap_err().to_string().contains("v5"));
    let unlit = ReferenceEngine::<f32>::new(&Parameters::init(config(V0), 1).unwrap(), ENGINE).unwrap();
    assert!(unlit.query(&points).unwrap().visibility.is_none());
    points.directions.truncate(1);
    assert!(unlit.query(&points).is_err());
}
