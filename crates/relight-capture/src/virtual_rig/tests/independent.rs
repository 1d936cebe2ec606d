//! The same scenes as an independent path tracer shows them: `tools/golden_virtual_rig.py`.

use std::sync::Arc;

use glam::{DVec2, DVec3};
use serde::Deserialize;

use super::super::{Material, Mesh, Model, Raster, Settings, Texture, shapes};
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
}

type Quad = [[f64; 3]; 3];

#[derive(Deserialize)]
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

/// Pictures of ours of different seeds, and camera rays a pixel of each.
const SEEDS: u32 = 16;
const SAMPLES: u32 = 16;

impl View {
    /// Holds our pictures of a model against these: every block is as near as its noise allows, and so is the whole.
    fn compare(&self, name: &str, model: &Model, radius: f64) {
        let view = camera(DVec3::from(self.eye), DVec3::from(self.target), self.size, self.focal);
        let lights: Vec<_> = (0..).zip(&self.lights).map(|(k, &p)| light(k, DVec3::from(p))).collect();
        let mut sums = vec![vec![[0.0; 2]; self.means[0].len()]; lights.len()];
        for seed in 0..SEEDS {
            let settings = Settings { seed: seed.into(), ..settings(SAMPLES) };
            let pictures = rig(model, white_lamp(radius), settings).radiance(&view, &lights);
            for (picture, sums) in pictures.iter().zip(&mut sums) {
                for (k, [sum, squares]) in (0..).zip(sums) {
                    let mean = self.block_of(k, |x, y, channel| picture.at(x, y)[channel]);
                    (*sum, *squares) = (*sum + mean, *squares + mean * mean);
                }
            }
        }
        for ((sums, means), errors) in sums.iter().zip(&self.means).zip(&self.errors) {
            let (mut off, mut squares, mut count) = ([0.0; 2], 0.0, 0.0);
            for (((k, [sum, square]), expected), error) in (0u32..).zip(sums).zip(means).zip(errors) {
                let seeds = f64::from(SEEDS);
                let mean = sum / seeds;
                let own = (square / seeds - mean * mean).max(0.0) / (seeds - 1.0);
                let theirs = 1e-4 * f64::from(*error) * expected;
                // Numbers are rounded, and our spheres have corners.
                let noise = (own + theirs * theirs + (3e-4 * expected).powi(2)).sqrt();
                let miss = mean - expected;
                assert!(miss.abs() <= MOST * noise, "{name}, block {k}: {mean} {expected}, noise {noise}");
                off = [off[0] + miss, off[1] + expected];
                if noise > 0.0 {
                    (squares, count) = (squares + (miss / noise).powi(2), count + 1.0);
                }
            }
            let (spread, ratio) = ((squares / count).sqrt(), off[0] / off[1]);
            println!("{name}: {spread:.2} of the noise in blocks, {:.3} % in the mean", 100.0 * ratio);
            assert!(spread < 1.3 && ratio.abs() < 1e-3, "{name}: {spread}, {ratio}");
        }
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
    golden.room.compare("room", &room(&golden), golden.radius);
}
