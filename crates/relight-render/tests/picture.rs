//! Rays, whole pictures, and pictures in files, against a ball known by its equation.

#![allow(clippy::unwrap_used)]

mod common;

use std::ops::ControlFlow;

use common::{Ball, RADIUS, lens, looking};
use proptest::prelude::*;
use relight_field::engine::{Engine, LightPose, Outputs, Precision, RenderSettings};
use relight_render::{Map, Picture, RenderError, camera_rays, render, write_picture};
use relight_scene::{Intrinsics, Pose, read_image};

const SETTINGS: RenderSettings = RenderSettings { samples: None, precision: Precision::I16 };
const EVERYTHING: Outputs = Outputs { visibility: true, reflectance: true };

fn ball_picture(width: u32, height: u32) -> Picture {
    let (camera, light) = (looking(0.6, 0.3, 0.5), looking(0.4, 1.2, 0.9));
    render(&Ball::default(), &lens(width, height), &camera, &light, EVERYTHING, &SETTINGS, &mut |_, _| {
        ControlFlow::Continue(())
    })
    .unwrap()
}

proptest! {
    #[test]
    fn a_ray_projects_back_to_its_pixel(
        azimuth in -3.0..3.0f64, elevation in -1.4..1.4f64, pixel in 0..80 * 60usize,
        k1 in -0.1..0.1f64, k2 in -0.05..0.05f64, p1 in -0.005..0.005f64,
    ) {
        let lens = Intrinsics { distortion: vec![k1, k2, p1, -p1, 0.0], ..lens(80, 60) };
        let pose = looking(0.6, azimuth, elevation);
        let rays = camera_rays(&lens, &pose, pixel..pixel + 1);
        let (origin, direction) = (rays.origins[0], rays.directions[0]);
        let length: f32 = direction.iter().map(|c| c * c).sum();
        prop_assert!((length - 1.0).abs() < 1e-5);
        let point = std::array::from_fn(|i| f64::from(origin[i]) + 3.0 * f64::from(direction[i]));
        let [u, v] = lens.project(pose.inverse_transform(point)).unwrap();
        prop_assert!((u - (pixel % 80) as f64).abs() < 1e-3 && (v - (pixel / 80) as f64).abs() < 1e-3);
    }
}

#[test]
fn a_picture_in_tiles_is_the_picture_in_one() {
    let (lens, camera, light) = (lens(300, 250), looking(0.6, 0.3, 0.5), looking(0.4, 1.2, 0.9));
    let engine = Ball::default();
    let mut told = Vec::new();
    let picture = render(&engine, &lens, &camera, &light, EVERYTHING, &SETTINGS, &mut |done, all| {
        told.push((done, all));
        ControlFlow::Continue(())
    })
    .unwrap();
    assert!(told.len() > 1, "more than one batch");
    assert_eq!(told.last(), Some(&(75_000, 75_000)));

    let rays = camera_rays(&lens, &camera, 0..75_000);
    let light = LightPose(light.row_major_f32());
    let whole = engine.render(&rays, &light, EVERYTHING, &SETTINGS).unwrap();
    assert_eq!(picture.colour, whole.colour);
    assert_eq!(picture.visibility, whole.visibility);
    assert_eq!(picture.reflectance, whole.reflectance);
    assert_eq!(picture.depth, whole.depth);
    assert_eq!(picture.opacity, whole.opacity);
}

#[test]
fn the_ball_is_where_the_camera_looks() {
    let picture = ball_picture(101, 81);
    // The principal point, where the camera looks at the origin.
    let at = (0.42 * 81.0f64).round() as usize * 101 + (0.6 * 101.0f64).round() as usize;
    assert!((picture.depth[at] - (0.6 - RADIUS)).abs() < 1e-3);
    assert_eq!(picture.opacity[0], 0.0);
}

#[test]
fn drawing_stops_when_told() {
    let mut batches = 0;
    let stopped = render(
        &Ball::default(),
        &lens(300, 250),
        &Pose::IDENTITY,
        &Pose::IDENTITY,
        Outputs::default(),
        &SETTINGS,
        &mut |_, _| {
            batches += 1;
            ControlFlow::Break(())
        },
    );
    assert!(matches!(stopped, Err(RenderError::Cancelled)));
    assert_eq!(batches, 1);
}

#[test]
fn absurd_sizes_are_refused() {
    for (width, height) in [(0, 10), (10, 0), (100_000, 1), (16_000, 16_000)] {
        let drawn = render(
            &Ball::default(),
            &Intrinsics { width, height, ..lens(10, 10) },
            &Pose::IDENTITY,
            &Pose::IDENTITY,
            Outputs::default(),
            &SETTINGS,
            &mut |_, _| ControlFlow::Continue(()),
        );
        assert!(matches!(drawn, Err(RenderError::Size { .. })), "{width}x{height}");
    }
}

#[test]
fn png_holds_the_rounded_map() {
    let folder = tempfile::tempdir().unwrap();
    let picture = ball_picture(40, 30);
    for map in Map::ALL {
        let path = folder.path().join(format!("{map}.PNG"));
        write_picture(&picture, map, &path).unwrap();
        assert_eq!(read_image(&path).unwrap(), picture.image(map, None).unwrap(), "{map}");
    }
    assert_eq!(
        std::fs::read_dir(folder.path()).unwrap().count(),
        Map::ALL.len(),
        "no temporary file is left"
    );
}

#[test]
fn exr_holds_linear_colour_and_metres() {
    let folder = tempfile::tempdir().unwrap();
    let picture = ball_picture(40, 30);
    for (map, names) in
        [(Map::Reflectance, vec!["B", "G", "R"]), (Map::Depth, vec!["Z"]), (Map::Visibility, vec!["Y"])]
    {
        let path = folder.path().join(format!("{map}.exr"));
        write_picture(&picture, map, &path).unwrap();
        let image = exr::prelude::read_first_flat_layer_from_file(&path).unwrap();
        let channels = &image.layer_data.channel_data.list;
        let found: Vec<String> = channels.iter().map(|channel| channel.name.to_string()).collect();
        assert_eq!(found, names);
        assert_eq!(image.layer_data.size, exr::prelude::Vec2(40, 30));
        let values: Vec<f32> = channels.last().unwrap().sample_data.values_as_f32().collect();
        match map {
            Map::Depth => assert_eq!(values, picture.depth),
            Map::Visibility => assert_eq!(values, picture.visibility),
            _ => {
                let ball = picture.opacity.iter().position(|&o| o == 1.0).unwrap();
                // sRGB 0.9 in linear light.
                assert!((values[ball] - 0.787_412).abs() < 1e-5);
            }
        }
    }
}

#[test]
fn what_cannot_be_written_says_why() {
    let folder = tempfile::tempdir().unwrap();
    let picture = Picture { visibility: vec![], ..ball_picture(20, 15) };
    let message =
        |map, name: &str| write_picture(&picture, map, &folder.path().join(name)).unwrap_err().to_string();
    assert!(message(Map::Final, "picture.jpg").contains(".png or .exr"));
    assert!(message(Map::Visibility, "picture.png").contains("visibility"));
    assert!(message(Map::Visibility, "picture.exr").contains("visibility"));
    assert!(message(Map::Final, "no/folder.exr").contains("folder.exr"));
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0);
}

#[test]
fn an_engine_that_loses_rays_is_found_out() {
    let engine = Ball { loses: 1 };
    let drawn =
        render(&engine, &lens(8, 8), &Pose::IDENTITY, &Pose::IDENTITY, EVERYTHING, &SETTINGS, &mut |_, _| {
            ControlFlow::Continue(())
        });
    assert!(matches!(drawn, Err(RenderError::Engine(_))));
}
