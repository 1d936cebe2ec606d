//! A tiny field and a tiny batch.

use relight_field::architecture::Architecture;
use relight_field::engine::{LightPose, RayBatch, StepSettings};
use relight_field::parameters::{FieldConfig, GridConfig, Parameters};
use relight_field::random::Random;
use relight_field::real::Real;
use relight_field::reference::{RaySamples, stratified};
use relight_scene::Bounds;

/// A grid with dense and hashed levels in a box that is no cube.
pub fn config(architecture: Architecture) -> FieldConfig {
    FieldConfig {
        architecture,
        grid: GridConfig { levels: 3, features: 2, log2_table: 7, base: 2, finest: 9 },
        bounds: Bounds { lo: [-0.5, -0.4, 0.0], hi: [0.75, 0.6, 0.8] },
        density_scale: 3.0,
    }
}

/// What the table's first values are multiplied by.
pub const TABLE_SCALE: f32 = 8e3;

/// A field whose table is as large as training makes it, so that nothing is negligible.
pub fn trained(config: FieldConfig, seed: u64) -> Parameters {
    let mut parameters = Parameters::init(config, seed).unwrap();
    parameters.table.iter_mut().for_each(|v| *v *= TABLE_SCALE);
    parameters
}

/// Rays from above into the box, with lights at about `distance` metres and random colours; the last ray has no
/// expected depth.
pub fn batch(rays: usize, lights_per_ray: usize, distance: f32) -> RayBatch {
    let random = Random::new(77, 0);
    let mut index = 0;
    let mut draw = || {
        index += 1;
        random.uniform_at(index)
    };
    let mut batch = RayBatch { lights_per_ray, ..RayBatch::default() };
    for ray in 0..rays {
        let (x, y) = (0.6 * draw() - 0.3, 0.6 * draw() - 0.2);
        let direction = [0.5 * draw() - 0.25, 0.5 * draw() - 0.25, -1.0f32];
        let norm = direction.iter().map(|v| v * v).sum::<f32>().sqrt();
        batch.rays.origins.push([x, y, 1.0]);
        batch.rays.directions.push(direction.map(|v| v / norm));
        batch.depths.push(if ray + 1 == rays { f32::NAN } else { 0.3 + 0.6 * draw() });
    }
    for _ in 0..3 {
        let mut pose = [0.0; 12];
        pose.iter_mut().for_each(|v| *v = 2.0 * draw() - 1.0);
        for (i, v) in [(3, -0.6), (7, 0.5), (11, 0.9)] {
            pose[i] = distance * (v + 0.3 * pose[i]);
        }
        batch.lights.push(LightPose(pose));
    }
    for pair in 0..rays * lights_per_ray {
        batch.light_index.push(pair as u32 % 3);
        batch.colours.push([draw(), draw(), draw()]);
    }
    batch
}

/// Irregular samples between 0.15 and 1.1 metres for some rays.
pub fn samples<R: Real>(rays: usize) -> Vec<RaySamples<R>> {
    let near_far = (R::from_f64(0.15), R::from_f64(1.1));
    (0..rays)
        .map(|r| {
            let random = Random::new(5, r as u64);
            stratified(near_far, 6, |i| R::from_f32(random.uniform_at(i as u64)))
        })
        .collect()
}

/// Settings of step 0.
pub fn settings(depth_weight: f32, distortion_weight: f32) -> StepSettings {
    StepSettings {
        step: 0,
        learning_rate: 1e-2,
        depth_weight,
        depth_margin: 0.1,
        distortion_weight,
        probe_weight: 0.0,
        roulette: 0.0,
        search: false,
    }
}
