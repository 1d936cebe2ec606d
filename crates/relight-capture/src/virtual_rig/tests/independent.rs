//! The same scene as an independent path tracer shows it: `tools/golden_virtual_rig.py`.

use std::sync::Arc;

use glam::{DVec2, DVec3};
use serde::Deserialize;

use super::super::{Material, Mesh, Model, Raster, Settings, Texture, shapes};
use super::{camera, light, rig, settings, white_lamp};

#[derive(Deserialize)]
struct Golden {
    size: [u32; 2],
    focal: f64,
    block: u32,
    eye: [f64; 3],
    target: [f64; 3],
    lights: Vec<[f64; 3]>,
    radius: f64,
    check: f64,
    dark: [f32; 3],
    bright: [f32; 3],
    quads: Vec<[[f64; 3]; 3]>,
    room: [[f64; 3]; 2],
    grey: f32,
    positions: Vec<[f64; 3]>,
    triangles: Vec<[u32; 3]>,
    plastic: [f32; 3],
    plastic_alpha: f64,
    ior: f64,
    sphere: [f64; 3],
    sphere_radius: f64,
    metal_alpha: f64,
    pictures: Vec<Vec<f64>>,
}

fn scene(golden: &Golden) -> Model {
    let mut model = Model::default();
    let (dark, bright) = (golden.dark, golden.bright);
    let checks = Raster::linear(2, 2, vec![dark, bright, bright, dark]).unwrap().sharp();
    let cloth = Material::Lambert { reflectance: Texture::Raster(Arc::new(checks)) };
    for quad in &golden.quads {
        let [corner, across, down] = quad.map(DVec3::from_array);
        let mut mesh = shapes::quad(corner, across, down);
        let size = DVec2::new(across.length(), down.length()) / (2.0 * golden.check);
        mesh.uvs.iter_mut().for_each(|uv| *uv *= size);
        model.push(mesh, cloth.clone());
    }
    let [low, high] = golden.room.map(DVec3::from_array);
    model.push(shapes::cuboid(low, high), Material::matt([golden.grey; 3]));
    let positions = golden.positions.iter().copied().map(DVec3::from_array).collect();
    let plastic =
        Material::Glossy { reflectance: golden.plastic.into(), alpha: golden.plastic_alpha, ior: golden.ior };
    model.push(Mesh::flat(positions, golden.triangles.clone()), plastic);
    let ball = shapes::sphere(golden.sphere_radius, 256).at(DVec3::from_array(golden.sphere));
    model.push(ball, Material::metal([1.0; 3], golden.metal_alpha));
    model
}

#[test]
fn an_independent_path_tracer_shows_the_same_scene() {
    let golden: Golden =
        serde_json::from_str(include_str!("../../../tests/golden/virtual_rig.json")).unwrap();
    let [eye, target] = [golden.eye, golden.target].map(DVec3::from_array);
    let view = camera(eye, target, golden.size, golden.focal);
    let lights: Vec<_> =
        golden.lights.iter().enumerate().map(|(k, &p)| light(k, DVec3::from_array(p))).collect();
    let settings = Settings { samples: 128, ..settings(128) };
    let pictures = rig(&scene(&golden), white_lamp(golden.radius), settings).radiance(&view, &lights);
    let [columns, rows] = golden.size.map(|side| side / golden.block);
    for (picture, expected) in pictures.iter().zip(&golden.pictures) {
        let (mut squares, mut ours, mut theirs) = (0.0, 0.0, 0.0);
        for (k, expected) in expected.iter().enumerate() {
            let (channel, column, row) = (k % 3, k as u32 / 3 % columns, k as u32 / 3 / columns);
            let pixels = (0..golden.block * golden.block).map(|i| {
                picture.at(column * golden.block + i % golden.block, row * golden.block + i / golden.block)
                    [channel]
            });
            let mean = pixels.sum::<f64>() / f64::from(golden.block * golden.block);
            ours += mean;
            theirs += expected;
            // On the metal sphere we add what facets pass among themselves, half a per cent of a bright lamp.
            let metal = (14..17).contains(&column) && (7..10).contains(&row);
            if !metal {
                squares += (mean - expected).powi(2) / (expected * expected + 1e-3);
            }
            let allowed = 0.04 * expected + if metal { 0.025 } else { 0.01 };
            assert!((mean - expected).abs() < allowed, "block {column} {row}: {mean} {expected}");
        }
        let deviation = (squares / f64::from(3 * columns * rows)).sqrt();
        assert!((ours / theirs - 1.0).abs() < 0.003, "{ours} {theirs}");
        assert!(deviation < 0.008, "{deviation}");
    }
}
