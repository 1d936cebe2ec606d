//! Camera and light paths, path files, and cameras and lights by name.

#![allow(clippy::unwrap_used)]

mod common;

use std::f64::consts::TAU;
use std::path::PathBuf;

use common::{lens, looking, polar};
use proptest::prelude::*;
use relight_render::paths::{Shot, from_file, lights, orbit};
use relight_render::{LightName, RenderError, named_camera};
use relight_scene::{Camera, Light, Pose};

fn named_light(lights: &[Light], focus: [f64; 3], name: &str) -> Result<Pose, RenderError> {
    name.parse::<LightName>()?.pose(lights, focus)
}

const DEGREE: f64 = TAU / 360.0;

/// Cameras at 0.6 m with azimuths in a range of degrees.
fn cameras(from: f64, to: f64) -> Vec<Camera> {
    (0..24)
        .map(|i| {
            let azimuth = from + (to - from) * f64::from(i) / 23.0;
            let elevation = if i % 2 == 0 { 25.0 } else { 35.0 };
            Camera {
                label: 2 * i as usize,
                intrinsics: lens(64, 48),
                pose: looking(0.6, azimuth * DEGREE, elevation * DEGREE),
            }
        })
        .collect()
}

/// Lights at 0.4 m, all round, between 47 and 85 degrees up.
fn dome() -> Vec<Light> {
    (0..40)
        .map(|i| {
            let azimuth = f64::from(i) * 2.4;
            let elevation = 47.0 + f64::from(i % 3) * 19.0;
            Light { label: i as usize, pose: looking(0.4, azimuth, elevation * DEGREE) }
        })
        .collect()
}

fn norm(v: [f64; 3]) -> f64 {
    v.iter().map(|c| c * c).sum::<f64>().sqrt()
}

fn distance(a: &Pose, b: &Pose) -> f64 {
    norm(std::array::from_fn(|i| a.position()[i] - b.position()[i]))
}

fn azimuth(pose: &Pose) -> f64 {
    let [x, y, _] = pose.position();
    y.atan2(x) / DEGREE
}

fn elevation(pose: &Pose) -> f64 {
    (pose.position()[2] / norm(pose.position())).asin() / DEGREE
}

/// No step of a closed path, the last back to the first included, is longer than `limit` metres.
fn is_smooth(poses: &[Pose], limit: f64) -> bool {
    poses.iter().zip(poses.iter().cycle().skip(1)).all(|(a, b)| distance(a, b) < limit)
}

#[test]
fn orbit_swings_within_a_wedge_of_cameras() {
    let light = looking(0.4, 1.0, 1.0);
    // Across the seam of the arctangent.
    let shots = orbit(&cameras(150.0, 207.0), &lens(64, 48), [0.0; 3], &light, 90).unwrap();
    let azimuths: Vec<f64> = shots.iter().map(|shot| azimuth(&shot.camera).rem_euclid(360.0)).collect();
    let (low, high) = azimuths.iter().fold((f64::MAX, f64::MIN), |(l, h), &a| (l.min(a), h.max(a)));
    assert!((150.0..152.0).contains(&low) && (205.0..207.001).contains(&high), "{low} to {high}");
    assert!(is_smooth(&shots.iter().map(|shot| shot.camera).collect::<Vec<_>>(), 0.03));
    for Shot { camera, light: shone } in &shots {
        assert!((norm(camera.position()) - 0.6).abs() < 1e-9);
        assert!((elevation(camera) - 30.0).abs() < 1e-9);
        assert_eq!(*shone, light);
        let [u, v] = lens(64, 48).project(camera.inverse_transform([0.0; 3])).unwrap();
        assert!((u - 31.5).abs() < 1e-9 && (v - 23.5).abs() < 1e-9, "the focus is at the image's middle");
    }
}

#[test]
fn orbit_goes_round_where_cameras_do() {
    let shots = orbit(&cameras(0.0, 345.0), &lens(64, 48), [0.0; 3], &Pose::IDENTITY, 36).unwrap();
    let mut azimuths: Vec<f64> = shots.iter().map(|shot| azimuth(&shot.camera).rem_euclid(360.0)).collect();
    azimuths.sort_by(f64::total_cmp);
    assert!(azimuths.windows(2).all(|pair| (pair[1] - pair[0] - 10.0).abs() < 1e-6));
}

#[test]
fn lights_wind_through_their_dome() {
    let camera = looking(0.6, 0.3, 0.5);
    let shots = lights(&dome(), [0.0; 3], &camera, 120).unwrap();
    let poses: Vec<Pose> = shots.iter().map(|shot| shot.light).collect();
    assert!(is_smooth(&poses, 0.04));
    let elevations: Vec<f64> = poses.iter().map(elevation).collect();
    let (low, high) = elevations.iter().fold((f64::MAX, f64::MIN), |(l, h), &e| (l.min(e), h.max(e)));
    assert!((low - 47.0).abs() < 1e-6 && (high - 85.0).abs() < 1e-6);
    for (shot, pose) in shots.iter().zip(&poses) {
        assert_eq!(shot.camera, camera);
        assert!((norm(pose.position()) - 0.4).abs() < 1e-9);
        let ahead = pose.transform([0.0, 0.0, 0.4]);
        assert!(norm(ahead) < 1e-9, "+Z points at the focus");
    }
}

#[test]
fn impossible_paths_are_refused() {
    let light = Pose::IDENTITY;
    assert!(orbit(&[], &lens(64, 48), [0.0; 3], &light, 10).is_err());
    assert!(lights(&[], [0.0; 3], &light, 10).is_err());
    for frames in [0, usize::MAX] {
        assert!(matches!(lights(&dome(), [0.0; 3], &light, frames), Err(RenderError::Placement(_))));
    }
    // One camera, right above the focus: nowhere to go, but no nonsense either.
    let above =
        [Camera { label: 0, intrinsics: lens(64, 48), pose: Pose::look_at([0.0, 0.0, 1.0], [0.0; 3]) }];
    let shots = orbit(&above, &lens(64, 48), [0.0; 3], &light, 4).unwrap();
    assert!(shots.iter().flat_map(|shot| shot.camera.0).flatten().all(f64::is_finite));
}

fn matrix(pose: &Pose) -> String {
    let numbers: Vec<String> =
        pose.0.iter().flatten().chain(&[0.0, 0.0, 0.0, 1.0]).map(f64::to_string).collect();
    format!("[{}]", numbers.join(", "))
}

fn written(text: &str) -> (tempfile::TempDir, PathBuf) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("path.json");
    std::fs::write(&path, text).unwrap();
    (folder, path)
}

#[test]
fn a_path_file_is_followed_from_end_to_end() {
    let poses: Vec<Pose> = (0..3).map(|i| looking(0.6, 0.4 * f64::from(i), 0.5)).collect();
    let keyframes: Vec<String> = poses
        .iter()
        .map(|pose| format!(r#"{{"camera": {}, "light": [0.1, 0.2, 0.4]}}"#, matrix(pose)))
        .collect();
    let keyframes = keyframes.join(", ");
    let whole = format!(r#"{{"format": "relight-path", "version": 1, "keyframes": [{keyframes}]}}"#);
    let (_folder, path) = written(&whole);
    let shots = from_file(&path, [0.0; 3], 21).unwrap();
    // As files were before the format was asked for.
    let (_folder, old) = written(&format!(r#"{{"version": 1, "keyframes": [{keyframes}]}}"#));
    assert_eq!(from_file(&old, [0.0; 3], 21).unwrap(), shots);
    assert_eq!(shots.len(), 21);
    for (shot, pose) in [0, 10, 20].map(|frame| &shots[frame]).into_iter().zip(&poses) {
        assert!(distance(&shot.camera, pose) < 1e-9);
    }
    assert!(shots.iter().all(|shot| (norm(shot.camera.position()) - 0.6).abs() < 0.01), "nearly an arc");
    assert!(
        shots.iter().all(|shot| distance(&shot.light, &Pose::look_at([0.1, 0.2, 0.4], [0.0; 3])) < 1e-12)
    );
    assert_eq!(from_file(&path, [0.0; 3], 1).unwrap().len(), 1);
}

#[test]
fn faulty_path_files_say_what_is_wrong() {
    let good = matrix(&looking(0.6, 0.0, 0.5));
    for (text, expected) in [
        ("nonsense".to_owned(), "looks like"),
        (r#"{"keyframes": []}"#.to_owned(), "version"),
        (r#"{"version": 2, "keyframes": []}"#.to_owned(), "version 2"),
        (r#"{"format": "relight-path", "version": 2, "keyframes": []}"#.to_owned(), "version 2"),
        (r#"{"format": "relight-plan", "version": 1, "keyframes": []}"#.to_owned(), "\"relight-plan\""),
        (r#"{"version": 1, "keyframes": []}"#.to_owned(), "no keyframes"),
        (r#"{"version": 1, "keyframes": [], "loop": true}"#.to_owned(), "loop"),
        (
            format!(r#"{{"version": 1, "keyframes": [{{"camera": {good}, "light": [1, 2]}}]}}"#),
            "light of keyframe 0",
        ),
        (
            format!(r#"{{"version": 1, "keyframes": [{{"camera": [1], "light": {good}}}]}}"#),
            "camera of keyframe 0",
        ),
        (
            format!(r#"{{"version": 1, "keyframes": [{{"camera": {good}, "light": [1e999, 0, 0]}}]}}"#),
            "path.json",
        ),
        (
            format!(r#"{{"version": 1, "keyframes": [{{"camera": {good}, "light": [1e7, 0, 0]}}]}}"#),
            "more than 1e6 m from the origin",
        ),
    ] {
        let (_folder, path) = written(&text);
        let message = from_file(&path, [0.0; 3], 10).unwrap_err().to_string();
        assert!(message.contains(expected) && message.contains("path.json"), "{text}: {message}");
    }
    assert!(from_file("none.json".as_ref(), [0.0; 3], 10).unwrap_err().to_string().contains("none.json"));
}

#[test]
fn cameras_and_lights_have_names() {
    let (cameras, lights) = (cameras(0.0, 57.0), dome());
    assert_eq!(named_camera(&cameras, "4").unwrap(), (lens(64, 48), cameras[2].pose));
    assert!(named_camera(&cameras, "5").unwrap_err().to_string().contains("0 to 46"));
    assert_eq!(named_light(&lights, [0.0; 3], "7").unwrap(), lights[7].pose);
    assert!(named_light(&lights, [0.0; 3], "40").is_err());

    let pose = looking(0.5, 1.0, 0.7);
    let (_folder, path) = written(&matrix(&pose));
    let (_, read) = named_camera(&cameras, path.to_str().unwrap()).unwrap();
    assert!(distance(&read, &pose) < 1e-12);
    assert_eq!(named_light(&lights, [0.0; 3], &matrix(&pose)).unwrap(), read);
    let (_folder, path) = written("1 0 0 0  0 2 0 0  0 0 1 0  0 0 0 1");
    assert!(named_camera(&cameras, path.to_str().unwrap()).unwrap_err().to_string().contains("orthonormal"));

    for name in ["", "x", "1,2", "1,2,nan", "1,2,3,4", "inf,0,0", "1e300,0,0"] {
        assert!(matches!(named_light(&lights, [0.0; 3], name), Err(RenderError::Placement(_))), "{name:?}");
    }
}

proptest! {
    #[test]
    fn a_light_by_position_looks_at_the_focus(
        azimuth in -3.0..3.0f64, elevation in -1.5..1.5f64, focus in proptest::array::uniform3(-0.1..0.1f64),
    ) {
        let [x, y, z] = polar(0.4, azimuth, elevation);
        let light = named_light(&[], focus, &format!("{x},{y},{z}")).unwrap();
        let [a, b, c] = light.inverse_transform(focus);
        prop_assert!(a.abs() < 1e-9 && b.abs() < 1e-9 && c > 0.0);
        prop_assert!(norm([light.position()[0] - x, light.position()[1] - y, light.position()[2] - z]) < 1e-12);
    }
}
