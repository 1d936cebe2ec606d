//! Pictures and queries against the plain engine's.

use fearless_simd::Level;
use relight_cpu::CpuEngine;
use relight_cpu::march::{UnitCube, along};
use relight_cpu::samples::{Jitter, SampleBatch};
use relight_cpu::tile::Workspace;
use relight_field::architecture::{LightInput, V0, V1, V5};
use relight_field::engine::*;
use relight_field::optimiser::Optimiser;
use relight_field::random::Random;
use relight_field::reference::{Field, ReferenceEngine, loss_and_gradient};
use relight_field::sampling::{EngineConfig, NEGLIGIBLE, Sampling, Shading};

use crate::common::*;

const SAMPLING: Sampling = Sampling::Stratified { coarse: 9, fine: 6 };

fn config(sampling: Sampling, shading: Shading) -> EngineConfig {
    EngineConfig { sampling, shading, optimiser: Optimiser::Adam, beta2: 0.999, seed: 3 }
}

/// Settings of pictures to be compared with the plain engine's.
fn plainly(samples: Option<usize>) -> RenderSettings {
    RenderSettings { samples, precision: Precision::F32 }
}

/// Relative difference, of numbers that are not nearly zero.
fn assert_equal(what: &str, ours: &[f32], plain: &[f32], tolerance: f32) {
    assert_eq!(ours.len(), plain.len(), "{what}");
    for (i, (a, b)) in ours.iter().zip(plain).enumerate() {
        assert!((a - b).abs() <= tolerance * b.abs().max(1e-3), "{what}, number {i}: {a} is not {b}");
    }
}

#[test]
fn queries_equal_the_plain_engines() {
    let random = Random::new(4, 0);
    // More than are evaluated together, and some of them outside the box.
    let positions = (0..431u64)
        .map(|i| {
            std::array::from_fn(|a| {
                let share = 1.2 * random.uniform_at(6 * i + a as u64) - 0.1;
                f64::from(BOUNDS.lo[a] + share * (BOUNDS.hi[a] - BOUNDS.lo[a]))
            })
        })
        .collect();
    let directions = (0..431)
        .map(|i| normalised([0, 1, 2].map(|a| random.uniform_at(6 * i + 3 + a) - 0.5)).map(f64::from))
        .collect();
    let points = Points { positions, directions, light: Some(lights()[2]) };
    for (name, architecture, shading) in cases() {
        let parameters = field(architecture);
        let ours = CpuEngine::new(&parameters, config(SAMPLING, shading)).unwrap().query(&points).unwrap();
        let plain = ReferenceEngine::<f64>::new(&parameters, config(SAMPLING, shading)).unwrap();
        let plain = plain.query(&points).unwrap();
        assert_equal(name, &ours.density, &plain.density, 1e-5);
        assert_equal(name, ours.rgb.as_flattened(), plain.rgb.as_flattened(), 1e-5);
        assert_eq!(ours.visibility.is_some(), plain.visibility.is_some());
        if let (Some(ours), Some(plain)) = (&ours.visibility, &plain.visibility) {
            assert_equal(name, ours, plain, 1e-5);
        }
        let outside = plain.density.iter().filter(|&&d| d == 0.0).count();
        assert!((50..400).contains(&outside), "{outside}");
    }
}

#[test]
fn queries_need_a_light_only_where_the_field_does() {
    let points = Points { positions: vec![[0.0; 3]], directions: vec![[0.0, 0.0, 1.0]], light: None };
    let engine = |a| CpuEngine::new(&field(a), config(SAMPLING, Shading::Deferred)).unwrap();
    assert_eq!(engine(V0).query(&points).unwrap().rgb.len(), 1);
    for architecture in [V1, V5] {
        assert!(matches!(engine(architecture).query(&points), Err(EngineError::Shape(_))));
    }
    let empty = engine(V5).query(&Points { light: Some(lights()[0]), ..Points::default() }).unwrap();
    assert!(empty.density.is_empty() && empty.rgb.is_empty());
}

/// What a picture holds, from the oracle and the same samples: the loss against black under one light is the mean
/// square of the colours.
#[test]
fn colours_equal_the_oracles() {
    let n = 23;
    for (name, architecture, shading) in cases() {
        let parameters = field(architecture);
        let light = lights()[1];
        let engine = CpuEngine::new(&parameters, config(SAMPLING, shading)).unwrap();
        let rays = rays(n);
        let drawn = engine.render(&rays, &light, Outputs::default(), &plainly(None)).unwrap();
        assert!(drawn.visibility.is_empty() && drawn.reflectance.is_empty());

        let parts = Parts::new(&parameters);
        let mut samples = SampleBatch::default();
        samples.fill(&parts.marcher(Level::new()), &rays, SAMPLING, 4, Jitter(None));
        let plain = plain_samples(&samples, n);
        let field = Field::<f64>::new(&parameters).unwrap();
        let still = StepSettings {
            step: 0,
            learning_rate: 0.0,
            depth_weight: 0.0,
            depth_margin: 1.0,
            distortion_weight: 0.0,
            probe_weight: 0.0,
            roulette: 0.0,
            search: false,
        };
        for r in 0..n {
            let one = RayBatch {
                rays: Rays { origins: vec![rays.origins[r]], directions: vec![rays.directions[r]] },
                lights: vec![light],
                lights_per_ray: 1,
                light_index: vec![0],
                // Against the colour drawn, nothing is left of the loss if it is the oracle's.
                colours: vec![drawn.colour[r]],
                ..RayBatch::default()
            };
            let loss = loss_and_gradient(&field, shading, &one, &plain[r..=r], &still).unwrap().colour;
            // Samples of less than 1e-4 in all are not shaded.
            assert!(loss.sqrt() < 2e-6, "{name}, {shading:?}, ray {r}: {}", loss.sqrt());
        }
    }
}

/// Surfaces so dense that what lies behind them is not looked at, for rays of some tiles: one of which misses the box, and
/// then none.
#[test]
fn rays_that_end_early_look_like_whole_ones() {
    let (light, simd) = (lights()[1], Level::new());
    for (density, misses) in [(100.0, 1), (1e6, 0)] {
        let mut parameters = field(V5);
        parameters.config.density_scale *= density;
        let engine = CpuEngine::new(&parameters, config(SAMPLING, Shading::Deferred)).unwrap();
        let mut rays = rays(131);
        let skipped = 1 - misses;
        rays.origins.drain(..skipped);
        rays.directions.drain(..skipped);
        let n = rays.origins.len();
        let settings = plainly(None);
        let drawn = engine.render(&rays, &light, Outputs::default(), &settings).unwrap();

        let parts = Parts::new(&parameters);
        let (mut samples, mut whole) = (SampleBatch::default(), Workspace::default());
        samples.fill(&parts.marcher(simd), &rays, SAMPLING, n, Jitter(None));
        let coded = coded(&[light]);
        let tile = samples.tile(&parts.marcher(simd), &rays, 0);
        whole.forward(simd, &parts.networks, Shading::Deferred, &tile, 1, |_, _| &coded[0]);
        let mut early = 0;
        for r in 0..n {
            let weights = &whole.weights[r * tile.samples..(r + 1) * tile.samples];
            early += usize::from(weights[..4].iter().sum::<f32>() > 0.9995);
            let close = (0..3).all(|c| (drawn.colour[r][c] - whole.colours[r][c]).abs() < 1e-3);
            assert!(close, "ray {r}: {:?} {:?}", drawn.colour[r], whole.colours[r]);
            assert!((drawn.depth[r] - whole.depths[r]).abs() < 2e-3, "ray {r}");
            assert!((drawn.opacity[r] - (1.0 - weights[tile.samples - 1])).abs() < 1e-3, "ray {r}");
        }
        assert!((20..=n - misses).contains(&early), "{early}");
        assert_eq!(drawn.opacity.iter().all(|&opacity| opacity == 1.0), misses == 0, "faces");
    }
}

/// Fog that lets a little through, and a little more than what counts.
#[test]
fn rays_that_let_no_more_than_a_hundredth_through_are_opaque() {
    let mut rays = Rays::default();
    rays.origins.push([0.1, 0.1, 1.2]);
    rays.directions.push([0.0, 0.0, -1.0]);
    for (left, opaque) in [(0.005f32, true), (0.015, false)] {
        let mut parameters = field(V5);
        // Logits of no features are zero: the density is its scale, all of the 0.7 m down.
        parameters.table.fill(0.0);
        parameters.config.density_scale = -left.ln() / 0.7;
        let engine = CpuEngine::new(&parameters, config(SAMPLING, Shading::Deferred)).unwrap();
        let plain = ReferenceEngine::<f64>::new(&parameters, config(SAMPLING, Shading::Deferred)).unwrap();
        let [ours, plain] = [&engine as &dyn Engine, &plain].map(|engine| {
            engine.render(&rays, &lights()[1], Outputs::default(), &plainly(Some(200))).unwrap()
        });
        assert_eq!(ours.opacity[0] == 1.0, opaque, "{}", ours.opacity[0]);
        assert!((ours.opacity[0] - plain.opacity[0]).abs() < 0.01);
        assert!((0..3).all(|c| (ours.colour[0][c] - plain.colour[0][c]).abs() < 0.01));
    }
}

/// Points along rays at which surfaces may be expected, so that rays look on behind the first.
fn surfaces(rays: &Rays) -> Vec<[f32; 3]> {
    let cube = UnitCube::new(&BOUNDS);
    let spans = rays.origins.iter().zip(&rays.directions).map(|(&o, &d)| (o, d, cube.clip(o, d)));
    let points = |(o, d, (near, far))| [0.2, 0.5, 0.7].map(|share| along(o, d, near + share * (far - near)));
    spans.flat_map(points).collect()
}

/// With the same number of samples both engines draw nearly the same picture of a smooth field, though they place
/// them differently.
#[test]
fn all_outputs_approach_the_plain_engines() {
    let mut parameters = field(V5);
    parameters.table.iter_mut().for_each(|v| *v *= 0.3);
    let (rays, light) = (rays(12), lights()[1]);
    let outputs = Outputs { visibility: true, reflectance: true };
    let settings = plainly(Some(2000));
    for shading in SHADINGS {
        let plain = ReferenceEngine::<f32>::new(&parameters, config(SAMPLING, shading)).unwrap();
        let plain = plain.render(&rays, &light, outputs, &settings).unwrap();
        let guided = Sampling::Guided { samples: 16 };
        let mut cases = vec![(SAMPLING, None), (guided, None)];
        // Where nothing is deferred, rays look but once, and too seldom beside the surfaces for such a comparison.
        cases.extend((shading == Shading::Deferred).then(|| (guided, Some(surfaces(&rays)))));
        for (sampling, surfaces) in cases {
            let mut engine = CpuEngine::new(&parameters, config(sampling, shading)).unwrap();
            let name =
                format!("{shading:?}, {sampling:?}, {} surfaces", surfaces.as_ref().map_or(0, Vec::len));
            surfaces.iter().for_each(|surfaces| engine.expect_surfaces(surfaces));
            let ours = engine.render(&rays, &light, outputs, &settings).unwrap();
            assert_equal(&name, ours.colour.as_flattened(), plain.colour.as_flattened(), 5e-3);
            assert_equal(&name, &ours.visibility, &plain.visibility, 5e-3);
            assert_equal(&name, ours.reflectance.as_flattened(), plain.reflectance.as_flattened(), 5e-3);
            assert_equal(&name, &ours.depth, &plain.depth, 5e-3);
            // The first ray misses the box; the others' opacity neither vanishes nor is full.
            for (r, (ours, plain)) in ours.opacity.iter().zip(&plain.opacity).enumerate() {
                assert!((ours - plain).abs() < 5e-3, "{name}, ray {r}: opacity {ours} {plain}");
                assert!(if r == 0 { *ours == 0.0 } else { (0.05..0.95).contains(ours) }, "{ours}");
            }
        }
    }
}

#[test]
fn reflectance_times_visibility_is_the_colour_of_deferred_rays_that_show_one_point() {
    let mut parameters = field(V5);
    // Some rays end inside the box, some beyond.
    parameters.config.density_scale *= 4.0;
    let engine = CpuEngine::new(&parameters, config(SAMPLING, Shading::Deferred)).unwrap();
    let outputs = Outputs { visibility: true, reflectance: true };
    // More rays than are marched together.
    let rays = rays(3000);
    let drawn = engine.render(&rays, &lights()[0], outputs, &plainly(Some(4))).unwrap();
    assert_eq!((drawn.colour.len(), drawn.visibility.len(), drawn.depth.len()), (3000, 3000, 3000));
    let one_point = |opacity: f32| f64::from(opacity.min(1.0 - opacity)) <= NEGLIGIBLE;
    let maps = drawn.colour.iter().zip(&drawn.visibility).zip(&drawn.reflectance).zip(&drawn.opacity);
    for (((colour, o), c), _) in maps.filter(|(_, opacity)| one_point(**opacity)) {
        assert!((0..3).all(|k| (colour[k] - o * c[k]).abs() < 1e-6));
    }
    let at_one = drawn.opacity.iter().filter(|opacity| one_point(**opacity)).count();
    assert!((100..2900).contains(&at_one), "{at_one}");
    let none = engine.render(&Rays::default(), &lights()[0], outputs, &plainly(None));
    assert!(none.unwrap().colour.is_empty());
}

#[test]
fn fields_without_visibility_draw_none() {
    let engine = CpuEngine::new(&field(V0), config(SAMPLING, Shading::PerSample)).unwrap();
    let outputs = Outputs { visibility: true, reflectance: true };
    let drawn = engine.render(&rays(3), &lights()[0], outputs, &plainly(None)).unwrap();
    assert!(drawn.visibility.is_empty());
    assert_eq!(drawn.reflectance, drawn.colour);
    assert_eq!(V0.light, LightInput::None);
}
