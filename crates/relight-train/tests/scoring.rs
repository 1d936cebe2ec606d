//! Scores and baselines against the plainest way to compute them.

mod common;

use std::ops::ControlFlow;

use common::{FakeEngine, config, tiny_scene};
use relight_field::engine::{Engine, RenderSettings};
use relight_metrics::psnr;
use relight_scene::{Image, SceneError, Split};
use relight_train::TrainError;
use relight_train::baselines::{NearestLight, mean_image};
use relight_train::evaluation::evaluate;

#[test]
fn the_mean_image_is_the_mean_of_all_training_images() {
    let folder = tempfile::tempdir().unwrap();
    let data = tiny_scene(folder.path());
    let images: Vec<Image> = data.splits.train.iter().map(|&f| data.scene.read_frame(f).unwrap()).collect();
    let all = data.splits.train.len();
    let mean_until = |last: usize| {
        mean_image(&data.scene, &data.splits.train, &|done, of| {
            assert_eq!(of, all);
            if done == last { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
        })
    };
    assert!(matches!(mean_until(all), Err(SceneError::Cancelled)));
    let mean = mean_until(all + 1).unwrap().unwrap();
    for (i, &byte) in mean.data.iter().enumerate() {
        let sum: f64 = images.iter().map(|image| f64::from(image.data[i])).sum();
        assert!((f64::from(byte) - sum / images.len() as f64).abs() <= 0.5 + 1e-9);
    }
}

#[test]
fn the_nearest_image_is_of_the_nearest_training_camera_and_light() {
    let folder = tempfile::tempdir().unwrap();
    let data = tiny_scene(folder.path());
    let nearest = NearestLight::new(&data.scene, &data.splits.train);
    let (cameras, lights) = (&data.scene.cameras, &data.scene.lights);
    let apart = |a: [f64; 3], b: [f64; 3]| (0..3).map(|i| (a[i] - b[i]).powi(2)).sum::<f64>().sqrt();
    for &frame in data.splits.easy.iter().chain(&data.splits.hard).chain(&data.splits.val) {
        let target = &data.scene.frames[frame];
        let chosen = &data.scene.frames[nearest.stand_in(frame).unwrap()];
        let camera_distance =
            |c: usize| apart(cameras[c].pose.position(), cameras[target.camera].pose.position());
        let light_distance =
            |l: usize| apart(lights[l].pose.position(), lights[target.light].pose.position());
        assert_ne!(chosen.camera, target.camera, "test cameras have no training images");
        for other in data.splits.train.iter().map(|&f| &data.scene.frames[f]) {
            assert!(camera_distance(chosen.camera) <= camera_distance(other.camera));
            if other.camera == chosen.camera {
                assert!(light_distance(chosen.light) <= light_distance(other.light));
            }
        }
    }
    // Under a training light, it is that light.
    let easy = data.splits.easy[0];
    let chosen = nearest.stand_in(easy).unwrap();
    assert_eq!(data.scene.frames[chosen].light, data.scene.frames[easy].light);
}

#[test]
fn scores_are_means_over_the_images_of_the_split() {
    let folder = tempfile::tempdir().unwrap();
    let data = tiny_scene(folder.path());
    let (fake, settings) = (FakeEngine::new(&config(&data, None)), RenderSettings::default());
    let engine: (&dyn Engine, _) = (&fake, &settings);
    let grey = Image { width: 24, height: 18, data: vec![100; 24 * 18 * 3] };
    let mut seen = Vec::new();
    let scores = evaluate(&data.scene, &data.splits, Split::Easy, Some(&grey), "v5", engine, &mut |drawn| {
        seen.push((drawn.frame, drawn.image.clone()));
        Ok(ControlFlow::Continue(()))
    })
    .unwrap()
    .unwrap();
    assert_eq!(seen.iter().map(|s| s.0).collect::<Vec<_>>(), data.splits.easy);
    let (mut sum, mut sum_of_grey) = (0.0, 0.0);
    for ((frame, image), scored) in seen.iter().zip(&scores.images) {
        let truth = data.scene.read_frame(*frame).unwrap();
        let own = psnr(&image.data, &truth.data).unwrap();
        assert_eq!(scored.scores.psnr, own);
        assert_eq!(scored.camera, data.scene.cameras[data.scene.frames[*frame].camera].label);
        sum += own;
        sum_of_grey += psnr(&grey.data, &truth.data).unwrap();
    }
    let images = seen.len() as f64;
    assert!((scores.mean.psnr - sum / images).abs() < 1e-12);
    assert!((scores.baselines.mean_image.unwrap().psnr - sum_of_grey / images).abs() < 1e-12);
    let stopped = evaluate(&data.scene, &data.splits, Split::Easy, None, "v5", engine, &mut |_| {
        Ok(ControlFlow::Break(()))
    });
    assert!(stopped.unwrap().is_none());
}

#[test]
fn black_ground_truth_is_counted_and_named_and_nothing_is_drawn() {
    let folder = tempfile::tempdir().unwrap();
    let data = tiny_scene(folder.path());
    let (fake, settings) = (FakeEngine::new(&config(&data, None)), RenderSettings::default());
    let engine: (&dyn Engine, _) = (&fake, &settings);
    let black = Image { width: 24, height: 18, data: vec![0; 24 * 18 * 3] };
    for &frame in &data.splits.easy[1..3] {
        black.write_png(&data.scene.frames[frame].path).unwrap();
    }
    let error = evaluate(&data.scene, &data.splits, Split::Easy, None, "v5", engine, &mut |_| {
        panic!("nothing is to be drawn")
    })
    .unwrap_err();
    let TrainError::BlackGroundTruth { path, count, total } = error else { panic!("{error}") };
    assert_eq!(path, data.scene.frames[data.splits.easy[1]].path);
    assert_eq!((count, total), (2, data.splits.easy.len()));
}
