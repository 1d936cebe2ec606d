//! The same scenes as an independent path tracer shows them: `tools/golden_virtual_rig.py`.

use std::sync::Arc;

use glam::{DVec2, DVec3};
use relight_scene::Camera;
use serde::Deserialize;

use super::super::{Material, Mesh, Model, Raster, Texture, shapes};
use super::{camera, light, rig, settings, white_lamp};

#[derive(Deserialize)]
struct Golden {
    radius: f64,
    room: View,
    check: f64,
    dark: [f32; 3],
    bright: [f32; 3],
    quads: Vec<Quad>,
    around: [[f64; 3]; 2],
    grey: f32,
    positions: Vec<[f64; 3]>,
    triangles: Vec<[u32; 3]>,
    rods: Described,
    sheet: Described,
    sheet_quad: Quad,
    spheres: Vec<([f64; 3], f64, Described)>,
    ball_radius: f64,
    balls: Vec<Ball>,
}

/// A sphere of one material, alone about the origin.
#[derive(Deserialize)]
struct Ball {
    material: Described,
    view: View,
}

type Quad = [[f64; 3]; 3];

#[derive(Debug, Deserialize)]
#[serde(tag = "kind", rename_all = "lowercase")]
enum Described {
    Metal { colour: [f32; 3], alpha: f64 },
    Glossy { colour: [f32; 3], alpha: f64, ior: f64 },
    Translucent { colour: [f32; 3], through: [f32; 3] },
}

impl Described {
    fn material(&self) -> Material {
        match *self {
            Described::Metal { colour, alpha } => Material::metal(colour, alpha),
            Described::Glossy { colour, alpha, ior } => {
                Material::Glossy { reflectance: colour.into(), alpha, ior }
            }
            Described::Translucent { colour, through } => {
                Material::Translucent { reflectance: colour.into(), transmittance: through.into() }
            }
        }
    }
}

/// What a camera saw under each light: means over blocks of pixels, and their standard errors in parts of 10,000 of them.
#[derive(Deserialize)]
struct View {
    size: [u32; 2],
    focal: f64,
    block: u32,
    eye: [f64; 3],
    target: [f64; 3],
    lights: Vec<[f64; 3]>,
    means: Vec<Vec<f64>>,
    errors: Vec<Vec<u32>>,
}

/// Pictures of ours of different seeds.
const SEEDS: u32 = 16;

impl View {
    /// Holds our pictures of a model, of so many rays a pixel, against these: every block is as near as its noise allows, and so is
    /// the whole. Returns misses in standard errors, root mean square of all blocks.
    fn compare(&self, name: &str, model: &Model, radius: f64, samples: u32) -> f64 {
        let view = camera(DVec3::from(self.eye), DVec3::from(self.target), self.size, self.focal);
        let lights: Vec<_> = (0..).zip(&self.lights).map(|(k, &p)| light(k, DVec3::from(p))).collect();
        let mut sums = vec![vec![[0.0; 2]; self.means[0].len()]; lights.len()];
        let rig = rig(model, white_lamp(radius), settings(samples));
        for seed in 0..SEEDS as usize {
            // A camera's label is a seed of its own.
            let pictures = rig.radiance(&Camera { label: seed, ..view.clone() }, &lights);
            for (picture, sums) in pictures.iter().zip(&mut sums) {
                for (k, [sum, squares]) in (0..).zip(sums) {
                    let mean = self.block_of(k, |x, y, channel| picture.at(x, y)[channel]);
                    (*sum, *squares) = (*sum + mean, *squares + mean * mean);
                }
            }
        }
        let (mut squares, mut count) = (0.0, 0.0);
        for ((sums, means), errors) in sums.iter().zip(&self.means).zip(&self.errors) {
            let (mut off, mut all, mut variance) = (0.0, 0.0, 0.0);
            // Few rays find the dimmest blocks, too few to tell their noise.
            let dim = 1e-4 * means.iter().sum::<f64>() / means.len() as f64;
            for (((k, [sum, square]), expected), error) in (0u32..).zip(sums).zip(means).zip(errors) {
                let seeds = f64::from(SEEDS);
                let mean = sum / seeds;
                let own = (square / seeds - mean * mean).max(0.0) / (seeds - 1.0);
                let theirs = 1e-4 * f64::from(*error) * expected;
                // Numbers are rounded, and our spheres have corners.
                let noise = (own + theirs * theirs + (3e-4 * expected).powi(2) + dim * dim).sqrt();
                let miss = mean - expected;
                assert!(miss.abs() <= MOST * noise, "{name}, block {k}: {mean} {expected}, noise {noise}");
                (off, all, variance) = (off + miss, all + expected, variance + noise * noise);
                if *expected > 0.0 {
                    (squares, count) = (squares + (miss / noise).powi(2), count + 1.0);
                }
            }
            // The three colours of a block share its noise.
            let (ratio, noise) = (off / all, (3.0 * variance).sqrt() / all);
            println!("{name}: {:.3} % off in the mean, noise {:.3} %", 100.0 * ratio, 100.0 * noise);
            assert!(ratio.abs() < f64::max(1e-3, 4.0 * noise), "{name}: {ratio}, noise {noise}");
        }
        let spread = f64::sqrt(squares / count);
        println!("{name}: {spread:.2} of the noise in blocks");
        spread
    }

    /// Mean over the pixels of a block's channel.
    fn block_of(&self, k: u32, at: impl Fn(u32, u32, usize) -> f64) -> f64 {
        let (block, columns) = (self.block, self.size[0] / self.block);
        let (channel, column, row) = (k as usize % 3, k / 3 % columns, k / 3 / columns);
        let pixels =
            (0..block * block).map(|i| at(column * block + i % block, row * block + i / block, channel));
        pixels.sum::<f64>() / f64::from(block * block)
    }
}

/// The largest miss of a block, in standard errors: one of several thousand, each from sixteen pictures.
const MOST: f64 = 6.5;

fn golden() -> Golden {
    serde_json::from_str(include_str!("../../../tests/golden/virtual_rig.json")).unwrap()
}

fn room(golden: &Golden) -> Model {
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
    let [low, high] = golden.around.map(DVec3::from_array);
    model.push(shapes::cuboid(low, high), Material::matt([golden.grey; 3]));
    let positions = golden.positions.iter().copied().map(DVec3::from_array).collect();
    model.push(Mesh::flat(positions, golden.triangles.clone()), golden.rods.material());
    let [corner, across, down] = golden.sheet_quad.map(DVec3::from_array);
    model.push(shapes::quad(corner, across, down), golden.sheet.material());
    for (centre, radius, described) in &golden.spheres {
        model.push(shapes::sphere(*radius, 256).at(DVec3::from(*centre)), described.material());
    }
    model
}

#[test]
fn an_independent_path_tracer_shows_the_same_room() {
    let golden = golden();
    let spread = golden.room.compare("room", &room(&golden), golden.radius, 16);
    assert!(spread < 1.3, "{spread}");
}

#[test]
fn an_independent_path_tracer_shows_the_same_balls() {
    let golden = golden();
    let spreads = golden.balls.iter().map(|Ball { material, view }| {
        let mut model = Model::default();
        model.push(shapes::sphere(golden.ball_radius, 256), material.material());
        view.compare(&format!("{material:?}"), &model, golden.radius, 64)
    });
    // Each has few blocks.
    let spread = f64::sqrt(spreads.map(|spread| spread * spread).sum::<f64>() / golden.balls.len() as f64);
    assert!(spread < 1.3, "{spread}");
}
