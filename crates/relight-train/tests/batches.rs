//! Batches: what they hold, how evenly they are drawn, and what they depend on.

// Helpers outside of test functions.
#![allow(clippy::unwrap_used)]

mod common;

use std::collections::HashMap;
use std::ops::ControlFlow;

use relight_field::engine::RayBatch;
use relight_scene::{PixelStore, scene_bounds};
use relight_stereo::{DepthPrior, StereoSettings};
use relight_train::batch::{BatchSampler, LightChoice};

fn lights(per_ray: usize, shift: f64, probe_reach: f64) -> LightChoice {
    LightChoice { per_ray, shift, probes: 2, probe_reach }
}

/// The training images of a scene, all but `left` of those of one camera left out; with that camera, and the lights of
/// those that are left.
fn with_a_poor_view(data: &common::Data, left: usize) -> (usize, Vec<u32>, PixelStore) {
    let poor = data.scene.frames[data.splits.train[0]].camera;
    let (mut frames, rest): (Vec<usize>, Vec<usize>) =
        data.splits.train.iter().partition(|&&f| data.scene.frames[f].camera == poor);
    frames.truncate(left);
    let kept = frames.iter().map(|&f| data.scene.frames[f].light as u32).collect();
    frames.extend(rest);
    let pixels = PixelStore::load(&data.scene, &frames, &|_, _| ControlFlow::Continue(())).unwrap();
    (poor, kept, pixels)
}

#[test]
fn each_pair_is_the_pixel_that_its_ray_goes_through() {
    let folder = tempfile::tempdir().unwrap();
    let data = common::tiny_scene(folder.path());
    let bounds = scene_bounds(&data.scene);
    let settings = StereoSettings { confirmations: 0, ..StereoSettings::default() };
    let depths =
        DepthPrior::estimate(&data.scene, &data.pixels, &bounds, &settings, &|| ControlFlow::Continue(()))
            .unwrap();
    let sampler =
        BatchSampler::new(&data.scene, &data.pixels, Some(&depths), 200, lights(3, 0.0, 0.0), 1).unwrap();
    let mut batch = RayBatch::default();
    sampler.fill(5, &mut batch);
    assert_eq!((batch.rays.origins.len(), batch.colours.len(), batch.lights_per_ray), (200, 600, 3));
    let mut known = 0;
    for ray in 0..200 {
        let origin = batch.rays.origins[ray];
        let view = (0..data.pixels.views())
            .find(|&v| {
                let camera = &data.scene.cameras[data.pixels.camera(v)];
                camera.pose.position().map(|c| c as f32) == origin
            })
            .unwrap();
        let camera = &data.scene.cameras[data.pixels.camera(view)];
        let direction = batch.rays.directions[ray].map(f64::from);
        assert!((direction.iter().map(|c| c * c).sum::<f64>() - 1.0).abs() < 1e-6);
        let point = [0, 1, 2].map(|a| camera.pose.position()[a] + direction[a]);
        let [u, v] = camera.intrinsics.project(camera.pose.inverse_transform(point)).unwrap();
        assert!((u - u.round()).abs() < 1e-3 && (v - v.round()).abs() < 1e-3, "({u}, {v})");
        let pixel = v.round() as usize * 24 + u.round() as usize;
        let depth = depths.distance(view, pixel % 24, pixel / 24);
        assert_eq!(batch.depths[ray].to_bits(), depth.to_bits(), "also where nothing is known");
        known += usize::from(depth.is_finite());
        for pair in 3 * ray..3 * ray + 3 {
            let light = batch.light_index[pair] as usize;
            let frame = data.scene.frame(data.pixels.camera(view), light).unwrap();
            assert!(data.splits.train.contains(&frame), "only training images are drawn");
            let image = data.scene.read_frame(frame).unwrap();
            let colour = batch.colours[pair].map(|c| (c * 255.0).round() as u8);
            assert_eq!(image.data[3 * pixel..3 * pixel + 3], colour);
        }
    }
    assert!(known > 0);
}

#[test]
fn all_images_are_drawn_equally_often() {
    let folder = tempfile::tempdir().unwrap();
    let data = common::tiny_scene(folder.path());
    let sampler = BatchSampler::new(&data.scene, &data.pixels, None, 1000, lights(2, 0.0, 0.0), 3).unwrap();
    let mut counts = HashMap::<(u32, u32), f64>::new();
    let mut batch = RayBatch::default();
    for step in 0..50 {
        sampler.fill(step, &mut batch);
        assert!(batch.depths.is_empty());
        for (pair, &light) in batch.light_index.iter().enumerate() {
            *counts.entry((batch.rays.origins[pair / 2][0].to_bits(), light)).or_default() += 1.0;
        }
    }
    assert_eq!(counts.len(), data.splits.train.len());
    let expected = 100_000.0 / counts.len() as f64;
    // Five standard deviations.
    assert!(counts.values().all(|n| (n - expected).abs() < 5.0 * expected.sqrt()), "{counts:?}");
}

#[test]
fn a_batch_depends_on_seed_and_step_and_on_nothing_else() {
    let folder = tempfile::tempdir().unwrap();
    let data = common::tiny_scene(folder.path());
    let draw = |threads: usize, seed: u64, step: u64| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        let sampler =
            BatchSampler::new(&data.scene, &data.pixels, None, 500, lights(4, 0.0, 0.5), seed).unwrap();
        let mut batch = RayBatch::default();
        // What the buffers held before must not matter.
        sampler.fill(99, &mut batch);
        pool.install(|| sampler.fill(step, &mut batch));
        let probes: Vec<_> = batch.probe_colours.iter().map(|c| c.map(f32::to_bits)).collect();
        (batch.rays, batch.light_index, batch.probe_lights, probes)
    };
    assert_eq!(draw(1, 1, 4), draw(3, 1, 4));
    assert_ne!(draw(1, 1, 4), draw(1, 2, 4));
    assert_ne!(draw(1, 1, 4), draw(1, 1, 5));
}

#[test]
fn rays_carry_as_many_lights_as_the_richest_view_has() {
    let folder = tempfile::tempdir().unwrap();
    let data = common::tiny_scene(folder.path());
    let most = (0..data.pixels.views()).map(|v| data.pixels.lights(v).len()).max().unwrap();
    let sampler = BatchSampler::new(&data.scene, &data.pixels, None, 10, lights(100, 0.0, 0.0), 0).unwrap();
    assert_eq!(sampler.lights_per_ray(), most);
    let mut batch = RayBatch::default();
    sampler.fill(0, &mut batch);
    assert_eq!(batch.rays.origins.len(), 1000 / most, "as many pairs as were asked for");
}

#[test]
fn a_view_with_one_light_shows_it_again() {
    let folder = tempfile::tempdir().unwrap();
    let data = common::tiny_scene(folder.path());
    let (poor, kept, pixels) = with_a_poor_view(&data, 1);
    let sampler = BatchSampler::new(&data.scene, &pixels, None, 2000, lights(3, 0.0, 0.0), 1).unwrap();
    let mut batch = RayBatch::default();
    sampler.fill(0, &mut batch);
    let origin = data.scene.cameras[poor].pose.position().map(|c| c as f32);
    let of_poor: Vec<usize> = (0..2000).filter(|&r| batch.rays.origins[r] == origin).collect();
    assert!(!of_poor.is_empty());
    for ray in 0..2000 {
        let lights = &batch.light_index[3 * ray..3 * ray + 3];
        if of_poor.contains(&ray) {
            assert_eq!(lights, [kept[0]; 3]);
        } else {
            assert!(lights[0] != lights[1] && lights[1] != lights[2], "{lights:?}");
        }
    }
}

#[test]
fn a_view_with_fewer_lights_shows_them_equally_often() {
    let folder = tempfile::tempdir().unwrap();
    let data = common::tiny_scene(folder.path());
    let (poor, kept, pixels) = with_a_poor_view(&data, 3);
    // Four lights of a view that has three.
    let sampler = BatchSampler::new(&data.scene, &pixels, None, 20_000, lights(4, 0.0, 0.5), 1).unwrap();
    assert_eq!(sampler.lights_per_ray(), 4);
    let mut batch = RayBatch::default();
    sampler.fill(0, &mut batch);
    let origin = data.scene.cameras[poor].pose.position().map(|c| c as f32);
    let mut counts = HashMap::<u32, f64>::new();
    for ray in (0..batch.rays.origins.len()).filter(|&r| batch.rays.origins[r] == origin) {
        batch.light_index[4 * ray..4 * ray + 4].iter().for_each(|&l| *counts.entry(l).or_default() += 1.0);
        let probes = &batch.probe_colours[2 * ray..2 * ray + 2];
        assert!(probes.iter().all(|c| c[0].is_nan()), "no photograph is left for them");
    }
    let expected = counts.values().sum::<f64>() / 3.0;
    assert!(counts.len() == 3 && kept.iter().all(|light| counts.contains_key(light)), "{counts:?}");
    assert!(counts.values().all(|n| (n - expected).abs() < 5.0 * expected.sqrt()), "{counts:?}");
}

#[test]
fn probes_leave_one_photograph_to_compare_them_with() {
    let folder = tempfile::tempdir().unwrap();
    let data = common::tiny_scene(folder.path());
    let most = (0..data.pixels.views()).map(|v| data.pixels.lights(v).len()).max().unwrap();
    let choose = |per_ray: usize, reach: f64| {
        let sampler =
            BatchSampler::new(&data.scene, &data.pixels, None, 60, lights(per_ray, 0.0, reach), 1).unwrap();
        let mut batch = RayBatch::default();
        sampler.fill(0, &mut batch);
        (sampler.lights_per_ray(), batch.probes_per_ray())
    };
    assert!(most > 4);
    assert_eq!(choose(most, 0.5), (most - 1, 2));
    assert_eq!(choose(most, 0.0), (most, 0));
    assert_eq!(choose(3, 0.5), (3, 0));
}

#[test]
fn lights_are_moved_a_little_in_every_step() {
    let folder = tempfile::tempdir().unwrap();
    let data = common::tiny_scene(folder.path());
    let drawn = |shift: f64, step: u64| {
        let sampler =
            BatchSampler::new(&data.scene, &data.pixels, None, 10, lights(2, shift, 0.0), 1).unwrap();
        let mut batch = RayBatch::default();
        sampler.fill(step, &mut batch);
        batch.lights
    };
    let (still, moved) = (drawn(0.0, 3), drawn(0.5, 3));
    assert_eq!(moved, drawn(0.5, 3));
    assert_ne!(moved, drawn(0.5, 4));
    for (still, moved) in still.iter().zip(&moved) {
        for (n, (a, b)) in still.0.iter().zip(&moved.0).enumerate() {
            // Only positions move, by less than half the way to the nearest of the other lights.
            assert!(if n % 4 == 3 { (a - b).abs() < 0.5 } else { a == b }, "{n}: {a} {b}");
        }
    }
}

#[test]
fn probes_are_photographs_or_stand_where_nobody_took_any() {
    let folder = tempfile::tempdir().unwrap();
    let data = common::tiny_scene(folder.path());
    let drawn = |reach: f64| {
        let sampler =
            BatchSampler::new(&data.scene, &data.pixels, None, 200, lights(4, 0.0, reach), 1).unwrap();
        let mut batch = RayBatch::default();
        sampler.fill(3, &mut batch);
        batch
    };
    let none = drawn(0.0);
    assert!(none.probe_lights.is_empty() && none.probe_colours.is_empty());
    let sampler = BatchSampler::new(&data.scene, &data.pixels, None, 400, lights(3, 0.0, 0.5), 1).unwrap();
    let mut few = RayBatch::default();
    sampler.fill(3, &mut few);
    assert!(few.probe_lights.is_empty(), "too few lights a ray");
    let batch = drawn(0.5);
    assert_eq!((batch.probe_lights.len(), batch.probe_colours.len()), (400, 400));
    // Lights of the training split: those of the test splits must not be hinted at.
    let trained: Vec<[f32; 3]> = (0..data.scene.lights.len() as u32)
        .filter(|l| (0..data.pixels.views()).any(|v| data.pixels.lights(v).contains(l)))
        .map(|l| data.scene.lights[l as usize].pose.position().map(|c| c as f32))
        .collect();
    assert!(trained.len() < data.scene.lights.len());
    let nearest = |p: [f32; 3]| {
        let distance = |l: &[f32; 3]| (0..3).map(|a| (l[a] - p[a]).abs()).fold(0f32, f32::max);
        trained.iter().map(distance).fold(f32::INFINITY, f32::min)
    };
    // Half the distance between neighbouring training lights, along each axis.
    let gaps = trained.iter().map(|a| {
        let distance = |b: &[f32; 3]| (0..3).map(|i| (a[i] - b[i]).powi(2)).sum::<f32>().sqrt();
        trained.iter().map(distance).filter(|d| *d > 0.0).fold(f32::INFINITY, f32::min)
    });
    let spacing = 1.001 * gaps.sum::<f32>() / trained.len() as f32;
    let mut photographed = 0;
    for probe in 0..400 {
        let (ray, light, colour) = (probe / 2, batch.probe_lights[probe], batch.probe_colours[probe]);
        if colour[0].is_nan() {
            let moved = nearest(light.position());
            assert!(moved > 0.0 && moved <= 0.5 * spacing, "{moved}");
            continue;
        }
        photographed += 1;
        let origin = batch.rays.origins[ray];
        let camera =
            data.scene.cameras.iter().position(|c| c.pose.position().map(|c| c as f32) == origin).unwrap();
        let at =
            data.scene.lights.iter().position(|l| l.pose.position().map(|c| c as f32) == light.position());
        let image = data.scene.read_frame(data.scene.frame(camera, at.unwrap()).unwrap()).unwrap();
        let camera = &data.scene.cameras[camera];
        let direction = batch.rays.directions[ray].map(f64::from);
        let point = [0, 1, 2].map(|a| camera.pose.position()[a] + direction[a]);
        let [u, v] = camera.intrinsics.project(camera.pose.inverse_transform(point)).unwrap();
        let pixel = v.round() as usize * 24 + u.round() as usize;
        assert_eq!(image.data[3 * pixel..3 * pixel + 3], colour.map(|c| (c * 255.0).round() as u8));
        assert_eq!(nearest(light.position()), 0.0);
        // Not one of the photographs that the ray is compared with anyway.
        let pairs = &batch.light_index[4 * ray..4 * ray + 4];
        assert!(pairs.iter().all(|&l| batch.lights[l as usize] != light));
    }
    assert_eq!(photographed, 50);
    // The probes of a ray stand in different places.
    assert!(batch.probe_lights.as_chunks::<2>().0.iter().all(|[a, b]| a.position() != b.position()));
}
