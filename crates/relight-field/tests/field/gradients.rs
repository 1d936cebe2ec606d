//! Whole gradients of the plain engine against finite differences, in f64.

use crate::tiny::{batch, config, samples, settings, trained};
use relight_field::architecture::{LightInput, VARIANTS};
use relight_field::engine::{RayBatch, StepSettings};
use relight_field::parameters::FieldConfig;
use relight_field::random::Random;
use relight_field::reference::{Field, RaySamples, loss_and_gradient};
use relight_field::sampling::Shading;

/// Weights checked of every array.
const CHECKED: u32 = 25;

fn check(name: &str, shading: Shading, mut field: Field<f64>, batch: &RayBatch, settings: &StepSettings) {
    let samples: Vec<RaySamples<f64>> = samples(batch.rays.origins.len());
    let evaluate = |field: &Field<f64>| loss_and_gradient(field, shading, batch, &samples, settings).unwrap();
    let gradient = evaluate(&field).gradient;
    let random = Random::new(9, 0);
    for (tensor, (array, shape, gradient)) in gradient.tensors().into_iter().enumerate() {
        let largest = gradient.iter().fold(0.0f64, |m, g| m.max(g.abs()));
        assert!(largest > 0.0, "{name} {shading:?}: no gradient reaches {array}");
        // Random weights, and the one that matters most.
        let strongest = gradient.iter().position(|g| g.abs() == largest).unwrap();
        let chosen = (0..CHECKED.into()).map(|i| random.below_at(i, (shape[0] * shape[1]) as u32) as usize);
        for i in chosen.chain([strongest]) {
            let value = field.parameters.tensors()[tensor].2[i];
            let mut loss_at = |v: f64| {
                field.parameters.tensors_mut()[tensor][i] = v;
                evaluate(&field).total
            };
            let h = 1e-6;
            let numeric = (loss_at(value + h) - loss_at(value - h)) / (2.0 * h);
            loss_at(value);
            let error = (numeric - gradient[i]).abs();
            assert!(
                error < 2e-6 * largest + 1e-10,
                "{name} {shading:?} {array}[{i}]: numeric {numeric:e}, analytic {:e}, largest {largest:e}",
                gradient[i]
            );
        }
    }
}

#[test]
fn shading_every_sample() {
    for (name, architecture) in VARIANTS {
        let field = Field::new(&trained(config(architecture), 3)).unwrap();
        check(name, Shading::PerSample, field, &batch(3, 2, 1.0), &settings(0.0, 0.0));
    }
}

/// Lights whose direction matters are so far away that it hardly depends on the mean position, through which by
/// definition no gradient flows.
#[test]
fn shading_deferred() {
    for (name, architecture) in VARIANTS {
        let distance = if architecture.light == LightInput::Direction { 1e8 } else { 1.0 };
        // Rays that show what is inside the box and beyond, only what is inside, and only what lies beyond.
        for density_scale in [3.0, 100.0, 1e-6] {
            let config = FieldConfig { density_scale, ..config(architecture) };
            let field = Field::new(&trained(config, 3)).unwrap();
            check(name, Shading::Deferred, field, &batch(3, 2, distance), &settings(0.0, 0.0));
        }
    }
}

#[test]
fn penalties_on_the_weights() {
    let (name, architecture) = VARIANTS[0];
    let field = Field::new(&trained(config(architecture), 3)).unwrap();
    for shading in [Shading::PerSample, Shading::Deferred] {
        for penalties in [settings(0.3, 0.0), settings(0.0, 0.3)] {
            check(name, shading, field.clone(), &batch(3, 2, 1.0), &penalties);
        }
    }
}
