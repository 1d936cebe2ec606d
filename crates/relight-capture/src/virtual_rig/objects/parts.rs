//! Many small parts.

use std::f64::consts::TAU;

use glam::{DMat3, DVec3, dvec3};

use super::{Draws, polar};
use crate::virtual_rig::shapes::{block, cuboid, cylinder, lathe, sphere};
use crate::virtual_rig::{Material, Mesh, Model, Pattern, Solid, Texture};

const COLOURS: [[f32; 3]; 6] = [
    [0.62, 0.03, 0.02],
    [0.02, 0.12, 0.50],
    [0.80, 0.56, 0.02],
    [0.02, 0.28, 0.08],
    [0.80, 0.80, 0.78],
    [0.05, 0.05, 0.055],
];

/// A tower of studded bricks with gaps, and loose bricks around it.
pub fn bricks() -> Model {
    let (pitch, height) = (0.0128, 0.0154);
    let brick = |columns: i32, rows: i32| {
        let size =
            dvec3(f64::from(columns) * pitch - 0.0003, f64::from(rows) * pitch - 0.0003, height - 0.0002);
        let body = cuboid(DVec3::ZERO, size);
        let studs = (0..columns * rows).map(|k| {
            let place = dvec3(f64::from(k % columns) + 0.5, f64::from(k / columns) + 0.5, 0.0) * pitch;
            cylinder(0.0039, 0.0029, 24).at(place + dvec3(0.0, 0.0, height - 0.0002))
        });
        Mesh::joined([body].into_iter().chain(studs))
    };
    let mut draws = Draws::new(3);
    let mut coloured: Vec<Vec<Mesh>> = vec![Vec::new(); COLOURS.len()];
    let mut add = |mesh: Mesh, colour: usize| coloured[colour % COLOURS.len()].push(mesh);
    // Courses of bricks two studs wide around a square of ten studs, that lose some bricks as they rise.
    for level in 0..9 {
        let shift = if level % 2 == 0 { 0 } else { 2 };
        for side in 0..4 {
            for k in 0..2 {
                if level > 3 && draws.within(0.0, 1.0) < 0.07 * f64::from(level) {
                    continue;
                }
                let start = dvec3(f64::from(shift + 4 * k - 5), -5.0, 0.0) * pitch;
                let turn = DMat3::from_rotation_z(TAU / 4.0 * f64::from(side));
                let mesh = brick(4, 2).at(start + dvec3(0.0, 0.0, f64::from(level) * height));
                add(mesh.moved(turn, DVec3::ZERO), (draws.within(0.0, 6.0)) as usize);
            }
        }
    }
    for k in 0..13 {
        let place = polar(TAU * f64::from(k) / 13.0 + 0.1, draws.within(0.088, 0.094), 0.0);
        let (columns, rows) = if k % 3 == 0 { (1, 1) } else { (2, 1) };
        let centre = dvec3(f64::from(columns), f64::from(rows), 0.0) * (-pitch / 2.0);
        let turn = DMat3::from_rotation_z(draws.within(0.0, TAU));
        add(brick(columns, rows).at(centre).moved(turn, place), k as usize);
    }
    let mut model = Model::default();
    for (meshes, colour) in coloured.into_iter().zip(COLOURS) {
        model.push(Mesh::joined(meshes), Material::plastic(colour, 0.12));
    }
    model
}

/// Marbles heaped in a wooden tray.
pub fn marbles() -> Model {
    let mut model = Model::default();
    let (half, wall, rim) = (0.082, 0.007, 0.024);
    let wood = Solid {
        pattern: Pattern::Stripes,
        size: 0.014,
        low: [0.42, 0.25, 0.11],
        high: [0.52, 0.33, 0.16],
        seed: 4,
    };
    let tray = Mesh::joined([
        block(dvec3(0.0, 0.0, 0.003), dvec3(2.0 * half, 2.0 * half, 0.006)),
        block(dvec3(0.0, half, rim / 2.0), dvec3(2.0 * half + wall, wall, rim)),
        block(dvec3(0.0, -half, rim / 2.0), dvec3(2.0 * half + wall, wall, rim)),
        block(dvec3(half, 0.0, rim / 2.0), dvec3(wall, 2.0 * half - wall, rim)),
        block(dvec3(-half, 0.0, rim / 2.0), dvec3(wall, 2.0 * half - wall, rim)),
    ]);
    model.push(tray, Material::Lambert { reflectance: Texture::Solid(wood) });
    // A square pyramid of close-packed balls: each layer lies in the hollows of the one below.
    let radius = 0.0123;
    let mut draws = Draws::new(17);
    for layer in 0..6u32 {
        let side = 6 - layer;
        for k in 0..side * side {
            let offset = (f64::from(side) - 1.0) / 2.0;
            let [x, y] = [k % side, k / side].map(|i| (f64::from(i) - offset) * 2.02 * radius);
            let z = 0.006 + radius + f64::from(layer) * radius * 2f64.sqrt();
            let colour = COLOURS[(draws.within(0.0, 6.0)) as usize];
            let other = COLOURS[(draws.within(0.0, 6.0)) as usize];
            let reflectance = if draws.within(0.0, 1.0) < 0.5 {
                Texture::Uniform(colour)
            } else {
                let seed = u64::from(64 * layer + k);
                Texture::Solid(Solid { pattern: Pattern::Veins, size: 0.016, low: colour, high: other, seed })
            };
            let ball = sphere(radius, 56).at(dvec3(x, y, z));
            let shiny = draws.within(0.0, 1.0) < 0.15;
            let glass = Material::Glossy { reflectance, alpha: 0.04, ior: 1.52 };
            model.push(ball, if shiny { Material::metal([0.85, 0.85, 0.86], 0.08) } else { glass });
        }
    }
    model
}

/// A town: blocks, towers and a dome, with narrow streets.
pub fn skyline() -> Model {
    let mut draws = Draws::new(29);
    let mut model = Model::default();
    let plinth = Solid {
        pattern: Pattern::Clouds,
        size: 0.02,
        low: [0.16, 0.16, 0.17],
        high: [0.28, 0.28, 0.28],
        seed: 1,
    };
    model.push(
        block(dvec3(0.0, 0.0, 0.004), dvec3(0.2, 0.2, 0.008)),
        Material::Lambert { reflectance: Texture::Solid(plinth) },
    );
    let mut walls: Vec<Vec<Mesh>> = vec![Vec::new(); 4];
    let (mut windows, mut roofs) = (Vec::new(), Vec::new());
    for cell in 0..49 {
        let [i, j] = [cell % 7, cell / 7].map(|k| f64::from(k) - 3.0);
        if (i, j) == (0.0, 0.0) || draws.within(0.0, 1.0) < 0.06 {
            continue;
        }
        let centre = dvec3(i, j, 0.0) * 0.0275;
        let near = (1.0 - (i.hypot(j) / 4.6)).max(0.0);
        let height = 0.018 + draws.within(0.2, 1.0) * (0.02 + 0.125 * near * near);
        let width = dvec3(draws.within(0.015, 0.022), draws.within(0.015, 0.022), height);
        let base = centre + dvec3(0.0, 0.0, 0.008);
        walls[(draws.within(0.0, 4.0)) as usize].push(block(base + dvec3(0.0, 0.0, height / 2.0), width));
        let floors = ((height - 0.006) / 0.0075) as i32;
        for floor in 0..floors {
            let z = 0.0055 + 0.0075 * f64::from(floor);
            let band = dvec3(width.x + 0.0012, width.y + 0.0012, 0.0032);
            windows.push(block(base + dvec3(0.0, 0.0, z), band));
        }
        if draws.within(0.0, 1.0) < 0.5 {
            roofs.push(
                lathe(&[[width.x * 0.68, 0.0], [0.0, 0.012]], 4)
                    .turned(TAU / 8.0)
                    .at(base + dvec3(0.0, 0.0, height)),
            );
        }
    }
    let colours = [[0.62, 0.55, 0.45], [0.50, 0.22, 0.15], [0.35, 0.40, 0.44], [0.74, 0.72, 0.68]];
    for (meshes, colour) in walls.into_iter().zip(colours) {
        model.push(Mesh::joined(meshes), Material::matt(colour));
    }
    model.push(Mesh::joined(windows), Material::plastic([0.03, 0.05, 0.08], 0.1));
    model.push(Mesh::joined(roofs), Material::matt([0.42, 0.10, 0.05]));
    let dome = lathe(
        &[[0.0125, 0.0], [0.0125, 0.16], [0.0095, 0.17], [0.006, 0.176], [0.001, 0.179], [0.0, 0.192]],
        48,
    );
    model.push(dome.at(dvec3(0.0, 0.0, 0.008)), Material::metal([0.75, 0.78, 0.80], 0.2));
    model
}
