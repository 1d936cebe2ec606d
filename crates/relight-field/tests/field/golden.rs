//! The plain engine against PyTorch: values made by `tools/golden_field.py`.

use std::collections::BTreeMap;
use std::path::Path;

use crate::tiny::{config, settings, trained};
use relight_field::architecture::{Architecture, V0, V5};
use relight_field::encoding::{fourier, hash_grid, spherical_harmonics};
use relight_field::engine::{Engine, LightPose, Points, RayBatch, Rays, StepSettings};
use relight_field::optimiser::Optimiser;
use relight_field::parameters::GridConfig;
use relight_field::random::Random;
use relight_field::real::Real;
use relight_field::reference::{Field, RaySamples, ReferenceEngine, loss_and_gradient};
use relight_field::sampling::{EngineConfig, Sampling, Shading};
use relight_field::weights_file;
use serde::Deserialize;

#[derive(Deserialize)]
struct Golden {
    seed: u64,
    table_scale: f32,
    grid: GridConfig,
    bounds: [[f32; 3]; 2],
    density_scale: f32,
    depth_weight: f32,
    depth_margin: f32,
    distortion_weight: f32,
    batch: Batch,
    points: GoldenPoints,
    hash_grid: Vec<Vec<f64>>,
    harmonics: Vec<Vec<f64>>,
    pose_code: Vec<f64>,
    models: BTreeMap<String, Model>,
}

#[derive(Deserialize)]
struct Batch {
    origins: Vec<[f32; 3]>,
    directions: Vec<[f32; 3]>,
    lights: Vec<[f32; 12]>,
    light_index: Vec<Vec<u32>>,
    colours: Vec<Vec<[f32; 3]>>,
    depths: Vec<Option<f32>>,
    t: Vec<Vec<f64>>,
    delta: Vec<Vec<f64>>,
}

#[derive(Deserialize)]
struct GoldenPoints {
    positions: Vec<[f32; 3]>,
    directions: Vec<[f32; 3]>,
    light: [f32; 12],
}

#[derive(Deserialize)]
struct Model {
    values: Values,
    #[serde(rename = "per-sample")]
    per_sample: Losses,
    deferred: Losses,
}

#[derive(Deserialize)]
struct Values {
    density: Vec<f64>,
    rgb: Vec<[f64; 3]>,
    visibility: Vec<f64>,
}

#[derive(Deserialize)]
struct Losses {
    mse: f64,
    depth: f64,
    distortion: f64,
    total: f64,
    gradient: BTreeMap<String, Probes>,
}

#[derive(Deserialize)]
struct Probes {
    projections: [f64; 2],
    norm: f64,
    largest: (usize, f64),
}

fn golden() -> Golden {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/golden/field.json");
    let golden: Golden = serde_json::from_str(&std::fs::read_to_string(path).unwrap()).unwrap();
    // Both sides must speak of the same field.
    let ours = config(V0);
    assert_eq!((golden.grid, golden.bounds), (ours.grid, [ours.bounds.lo, ours.bounds.hi]));
    assert_eq!((golden.density_scale, golden.table_scale), (ours.density_scale, crate::tiny::TABLE_SCALE));
    golden
}

fn close(ours: f64, theirs: f64, tolerance: f64, what: &str) {
    assert!((ours - theirs).abs() <= tolerance * theirs.abs().max(1e-3), "{what}: {ours} {theirs}");
}

fn all_close<R: Real>(ours: &[R], theirs: &[f64], tolerance: f64, what: &str) {
    assert_eq!(ours.len(), theirs.len(), "{what}");
    for (i, (a, &b)) in ours.iter().zip(theirs).enumerate() {
        close(a.to_f64(), b, tolerance, &format!("{what} [{i}]"));
    }
}

#[test]
fn encodings() {
    let golden = golden();
    let field: Field<f64> = Field::new(&trained(config(V0), golden.seed)).unwrap();
    let grid = hash_grid::HashGrid::new(&golden.grid);
    for (i, (position, direction)) in
        golden.points.positions.iter().zip(&golden.points.directions).enumerate()
    {
        let x = hash_grid::unit(&field.parameters.config.bounds, position.map(f64::from));
        all_close(&grid.encode(&field.parameters.table, x), &golden.hash_grid[i], 1e-12, "h(x)");
        let zeta = spherical_harmonics::encode(direction.map(f64::from));
        all_close(&zeta, &golden.harmonics[i], 1e-9, "zeta(d)");
    }
    all_close(&fourier::encode(&golden.points.light.map(f64::from)), &golden.pose_code, 1e-12, "gamma");
}

fn field_values<R: Real>(tolerance: f64) {
    let golden = golden();
    let points = Points {
        positions: golden.points.positions.into_iter().map(|p| p.map(f64::from)).collect(),
        directions: golden.points.directions.into_iter().map(|d| d.map(f64::from)).collect(),
        light: Some(LightPose(golden.points.light)),
    };
    for (name, model) in golden.models {
        let architecture = Architecture::named(&name).unwrap();
        let engine_config = EngineConfig {
            sampling: Sampling::Stratified { coarse: 4, fine: 4 },
            shading: Shading::PerSample,
            optimiser: Optimiser::Adam,
            beta2: 0.999,
            seed: 0,
        };
        let parameters = trained(config(architecture), golden.seed);
        let values = ReferenceEngine::<R>::new(&parameters, engine_config).unwrap().query(&points).unwrap();
        all_close(&values.density, &model.values.density, tolerance, &name);
        all_close(values.rgb.as_flattened(), model.values.rgb.as_flattened(), tolerance, &name);
        match values.visibility {
            Some(visibility) => all_close(&visibility, &model.values.visibility, tolerance, &name),
            None => assert!(model.values.visibility.iter().all(|&o| o == 1.0)),
        }
    }
}

#[test]
fn field_values_in_f64() {
    // Values leave the engine as f32.
    field_values::<f64>(1e-7);
}

#[test]
fn field_values_in_f32() {
    field_values::<f32>(1e-5);
}

fn losses_and_gradients<R: Real>(tolerance: f64) {
    let golden = golden();
    let given = &golden.batch;
    let batch = RayBatch {
        rays: Rays { origins: given.origins.clone(), directions: given.directions.clone() },
        lights: given.lights.iter().map(|&l| LightPose(l)).collect(),
        lights_per_ray: given.light_index[0].len(),
        light_index: given.light_index.concat(),
        colours: given.colours.concat(),
        depths: given.depths.iter().map(|d| d.unwrap_or(f32::NAN)).collect(),
        ..RayBatch::default()
    };
    let to_real = |v: &Vec<f64>| v.iter().map(|&v| R::from_f64(v)).collect();
    let samples: Vec<RaySamples<R>> = given
        .t
        .iter()
        .zip(&given.delta)
        .map(|(t, delta)| RaySamples { t: to_real(t), delta: to_real(delta) })
        .collect();
    let settings = StepSettings {
        depth_margin: golden.depth_margin,
        ..settings(golden.depth_weight, golden.distortion_weight)
    };
    for (name, model) in &golden.models {
        let architecture = Architecture::named(name).unwrap();
        let field = Field::new(&trained(config(architecture), golden.seed)).unwrap();
        for (shading, theirs) in
            [(Shading::PerSample, &model.per_sample), (Shading::Deferred, &model.deferred)]
        {
            let ours = loss_and_gradient::<R>(&field, shading, &batch, &samples, &settings).unwrap();
            let what = format!("{name} {shading:?}");
            close(ours.colour.to_f64(), theirs.mse, tolerance, &what);
            close(ours.depth.to_f64(), theirs.depth, tolerance, &what);
            close(ours.distortion.to_f64(), theirs.distortion, tolerance, &what);
            close(ours.total.to_f64(), theirs.total, tolerance, &what);
            let tensors = ours.gradient.tensors();
            assert_eq!(tensors.len(), theirs.gradient.len());
            for (tensor, _, gradient) in tensors {
                same_gradient(gradient, &theirs.gradient[&tensor], tolerance, &format!("{what} {tensor}"));
            }
        }
    }
}

/// Compares norm, largest entry and two random projections, all relative to the norm.
fn same_gradient<R: Real>(ours: &[R], theirs: &Probes, tolerance: f64, what: &str) {
    let ours: Vec<f64> = ours.iter().map(|g| g.to_f64()).collect();
    let norm = ours.iter().map(|g| g * g).sum::<f64>().sqrt();
    let (at, largest) = theirs.largest;
    let near = |a: f64, b: f64| assert!((a - b).abs() <= tolerance * theirs.norm, "{what}: {a} {b}");
    near(norm, theirs.norm);
    near(ours[at], largest);
    for (stream, projection) in (0..).zip(theirs.projections) {
        let random = Random::new(17, stream);
        let sign = |i| f64::from(2.0 * random.uniform_at(i) - 1.0);
        near((0..).zip(&ours).map(|(i, g)| g * sign(i)).sum(), projection);
    }
}

#[test]
fn losses_and_gradients_in_f64() {
    losses_and_gradients::<f64>(1e-9);
}

#[test]
fn losses_and_gradients_in_f32() {
    losses_and_gradients::<f32>(1e-4);
}

#[test]
fn weights_written_by_another_program() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/golden/v5.safetensors");
    assert_eq!(weights_file::load(&path).unwrap(), trained(config(V5), golden().seed));
}
