//! The built-in objects: each whole, within its box, and unlike the others.

use glam::{DVec3, dvec3};
use relight_scene::{Camera, Image, Light, Pose};

use super::super::stage::{OBJECT_HALF, OBJECT_HEIGHT};
use super::super::{Lamp, Model, RigError, Sensor, Settings, Stage, VirtualRig, objects};
use super::camera;

#[test]
fn every_object_stands_whole_within_its_box() {
    let mut faults = Vec::new();
    for object in objects::ALL {
        let model = object.model();
        let (mut low, mut high) = (DVec3::INFINITY, DVec3::NEG_INFINITY);
        for part in &model.parts {
            assert!(!part.mesh.triangles.is_empty(), "{}: an empty part", object.name);
            assert!(part.mesh.normals.iter().all(|n| (n.length() - 1.0).abs() < 1e-6), "{}", object.name);
            let [a, b] = part.mesh.extent().unwrap();
            (low, high) = (low.min(a), high.max(b));
        }
        let box_low = dvec3(-OBJECT_HALF, -OBJECT_HALF, -1e-4);
        let box_high = dvec3(OBJECT_HALF, OBJECT_HALF, OBJECT_HEIGHT);
        let inside = low.cmpge(box_low).all() && high.cmple(box_high).all();
        let size = high - low;
        if !inside || low.z > 0.002 || size.x.max(size.y) < 0.1 {
            faults.push(format!("{}: from {low} to {high}", object.name));
        }
        VirtualRig::new(&model, Lamp::default(), Sensor::default(), Settings::default()).unwrap();
    }
    assert!(faults.is_empty(), "{faults:#?}");
}

#[test]
fn names_are_known_and_differ() {
    for (k, object) in objects::ALL.iter().enumerate() {
        assert!(objects::named(object.name).is_ok());
        assert!(objects::ALL[..k].iter().all(|other| other.name != object.name));
    }
    let fault = objects::named("unicorn").unwrap_err();
    assert!(matches!(fault, RigError::UnknownObject { .. }) && fault.to_string().contains("wire-cube"));
}

fn view(azimuth: f64, elevation: f64, size: [u32; 2]) -> Camera {
    let focal = 8.0 / 0.00345 * f64::from(size[0]) / 1440.0;
    let eye = 0.61 * dvec3(azimuth.cos() * elevation.cos(), azimuth.sin() * elevation.cos(), elevation.sin());
    camera(eye, dvec3(0.0, 0.0, 0.06), size, focal)
}

fn lamp(label: usize, azimuth: f64, elevation: f64) -> Light {
    let place =
        0.4 * dvec3(azimuth.cos() * elevation.cos(), azimuth.sin() * elevation.cos(), elevation.sin());
    Light { label, pose: Pose::look_at(place.to_array(), [0.0; 3]) }
}

/// A sheet of pictures to look at: `RELIGHT_SHEETS` names the folder.
#[test]
#[ignore = "draws pictures for people to look at; needs RELIGHT_SHEETS, a folder"]
fn sheet_of_all_objects() {
    let folder =
        std::path::PathBuf::from(std::env::var_os("RELIGHT_SHEETS").expect("RELIGHT_SHEETS names a folder"));
    let size = [240u32, 180];
    let stage = Stage::default().model().unwrap();
    let settings = Settings { samples: 32, ..Settings::default() };
    let wanted = std::env::var("RELIGHT_OBJECT").ok();
    let chosen: Vec<_> =
        objects::ALL.iter().filter(|o| wanted.as_deref().is_none_or(|w| w == o.name)).collect();
    // Five objects a row, each in two views under two lights.
    let columns = 5.min(chosen.len()) as u32;
    let rows = (chosen.len() as u32).div_ceil(columns);
    let mut sheet = Image { width: 2 * columns * size[0], height: rows * size[1], data: Vec::new() };
    sheet.data.resize(3 * (sheet.width * sheet.height) as usize, 0);
    for (k, object) in (0u32..).zip(chosen) {
        let model: Model = stage.clone().with(object.model());
        let rig = VirtualRig::new(&model, Lamp::default(), Sensor::default(), settings).unwrap();
        for (i, (azimuth, light)) in
            [(-0.9, lamp(0, -0.4, 0.9)), (-1.2, lamp(1, -2.2, 1.2))].into_iter().enumerate()
        {
            let picture = &rig.photograph(&view(azimuth, 0.5, size), &[light])[0];
            let (x, y) = ((2 * (k % columns) + i as u32) * size[0], k / columns * size[1]);
            for row in 0..size[1] {
                let there = 3 * ((y + row) * sheet.width + x) as usize;
                let here = 3 * (row * size[0]) as usize;
                let width = 3 * size[0] as usize;
                sheet.data[there..there + width].copy_from_slice(&picture.data[here..here + width]);
            }
        }
    }
    sheet
        .write_png(
            &folder.join(format!("objects{}.png", wanted.map(|w| format!("-{w}")).unwrap_or_default())),
        )
        .unwrap();
}

/// The rate of a capture of the paper's size, and the noise of tracing: `cargo test --release ... -- --ignored --nocapture`.
#[test]
#[ignore = "measures a rate; asserts nothing about it"]
fn rate_of_a_view() {
    let size = [320, 240];
    let stage = Stage::default().model().unwrap();
    let lights: Vec<_> =
        (0u32..40).map(|k| lamp(k as usize, f64::from(k) * 2.4, 0.82 + 0.66 * f64::from(k) / 40.0)).collect();
    let sensor = Sensor::noiseless(Sensor::default().exposure);
    for name in ["wire-cube", "fern", "mirrors"] {
        let model = stage.clone().with(objects::named(name).unwrap());
        for bounce_share in [1, 2] {
            let shoot = |seed: u64| {
                let settings = Settings { bounce_share, seed, ..Settings::default() };
                let rig = VirtualRig::new(&model, Lamp::default(), sensor, settings).unwrap();
                let start = std::time::Instant::now();
                (rig.photograph(&view(-0.9, 0.5, size), &lights), start.elapsed().as_secs_f64())
            };
            let ((one, seconds), (other, _)) = (shoot(1), shoot(2));
            let differences = one.iter().zip(&other).flat_map(|(a, b)| a.data.iter().zip(&b.data));
            let (sum, count) = differences.fold((0.0, 0.0), |(sum, count), (&a, &b)| {
                (sum + (f64::from(a) - f64::from(b)).powi(2) / 2.0, count + 1.0)
            });
            println!(
                "{name}, bounces joined to 1 in {bounce_share}: {seconds:.2} s a view, {:.2} M pairs/s, noise {:.1} dB",
                320.0 * 240.0 * 32.0 * 40.0 / seconds / 1e6,
                10.0 * (255f64.powi(2) * count / sum).log10()
            );
        }
    }
}
