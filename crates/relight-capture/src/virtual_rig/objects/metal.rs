//! Metal: from mirrors to rough castings.

use std::f64::consts::{PI, TAU};

use glam::{DMat3, DVec2, dvec3};

use super::polar;
use crate::virtual_rig::shapes::{curve, cylinder, lathe, plate, rod, sphere, torus};
use crate::virtual_rig::{Material, Mesh, Model, Pattern, Solid, Texture};

const STEEL: [f32; 3] = [0.62, 0.61, 0.60];
const BRASS: [f32; 3] = [0.87, 0.64, 0.26];
const COPPER: [f32; 3] = [0.90, 0.48, 0.33];

/// Spheres from chrome to sandblasted steel on a dark lacquered tray.
pub fn mirrors() -> Model {
    let mut model = Model::default();
    let tray = lathe(
        &[
            [0.0, 0.0],
            [0.098, 0.0],
            [0.102, 0.004],
            [0.102, 0.012],
            [0.098, 0.012],
            [0.096, 0.006],
            [0.0, 0.006],
        ],
        120,
    );
    model.push(tray, Material::plastic([0.03, 0.03, 0.04], 0.12));
    let balls = [
        (0.052, -0.028, 0.018, [0.91, 0.92, 0.92], 0.015),
        (0.034, 0.050, 0.032, [0.95, 0.72, 0.36], 0.06),
        (0.028, 0.040, -0.038, COPPER, 0.15),
        (0.021, -0.022, -0.062, STEEL, 0.35),
        (0.016, 0.010, 0.076, [0.91, 0.92, 0.92], 0.03),
        (0.015, 0.008, -0.030, [0.35, 0.40, 0.62], 0.1),
        (0.013, -0.077, -0.026, STEEL, 0.55),
    ];
    for (radius, x, y, colour, alpha) in balls {
        model.push(sphere(radius, 144).at(dvec3(x, y, 0.006 + radius)), Material::metal(colour, alpha));
    }
    model
}

/// A bell's profile with inside and outside, for a height.
fn bell(height: f64) -> Mesh {
    let outside =
        [[0.50, 0.0], [0.47, 0.08], [0.36, 0.30], [0.28, 0.60], [0.24, 0.80], [0.15, 0.93], [0.0, 0.97]];
    let points: Vec<_> = outside.iter().map(|p| dvec3(p[0], 0.0, p[1])).collect();
    let smooth = curve(&points, 8);
    let mut profile: Vec<[f64; 2]> =
        smooth.iter().rev().map(|p| [(p.x - 0.035).max(0.0), p.z - 0.03 * p.z]).collect();
    profile.extend(smooth.iter().map(|p| [p.x, p.z]));
    let scaled: Vec<[f64; 2]> = profile.iter().map(|p| p.map(|v| v * height)).collect();
    lathe(&scaled, 96)
}

/// Three bells: brass, copper and blackened iron.
pub fn bells() -> Model {
    let mut model = Model::default();
    let patina =
        Solid { pattern: Pattern::Clouds, size: 0.035, low: [0.30, 0.62, 0.48], high: COPPER, seed: 12 };
    let kinds = [
        (0.125, -0.032, 0.024, 0.0, Material::metal(BRASS, 0.14)),
        (0.085, 0.054, 0.045, 0.0, Material::Conductor { reflectance: Texture::Solid(patina), alpha: 0.28 }),
        (0.075, 0.034, -0.052, 0.62, Material::metal([0.30, 0.29, 0.29], 0.42)),
    ];
    for (height, x, y, tilt, material) in kinds {
        let handle = torus(0.10 * height, 0.028 * height, 48, 14)
            .moved(DMat3::from_rotation_x(PI / 2.0), dvec3(0.0, 0.0, 1.04 * height));
        let clapper = Mesh::joined([
            rod(dvec3(0.0, 0.0, 0.16 * height), dvec3(0.0, 0.0, 0.85 * height), 0.02 * height, 10),
            sphere(0.09 * height, 32).at(dvec3(0.0, 0.0, 0.14 * height)),
        ]);
        let whole = Mesh::joined([bell(height), handle, clapper]);
        // Tilted about its rim, and set down on it.
        let turn = DMat3::from_rotation_z(0.8) * DMat3::from_rotation_y(tilt);
        let lowest = 0.50 * height * tilt.sin();
        model.push(whole.moved(turn, dvec3(x, y, lowest)), material);
    }
    model
}

/// A spur gear: teeth, holes left to the eye, and a hub.
fn gear(teeth: usize, module: f64, thickness: f64) -> Mesh {
    let pitch = module * teeth as f64 / 2.0;
    let outline: Vec<DVec2> = (0..teeth)
        .flat_map(|k| {
            [(-0.29, -1.15), (-0.14, 1.0), (0.14, 1.0), (0.29, -1.15)].map(|(turn, height)| {
                let angle = TAU * (k as f64 + turn) / teeth as f64;
                (pitch + height * module) * DVec2::from_angle(angle)
            })
        })
        .collect();
    let hub = lathe(
        &[
            [0.32 * pitch, thickness],
            [0.32 * pitch, 1.5 * thickness],
            [0.15 * pitch, 1.5 * thickness],
            [0.15 * pitch, thickness],
        ],
        60,
    );
    let ring = torus(0.66 * pitch, 0.06 * pitch, 72, 12).at(dvec3(0.0, 0.0, thickness));
    Mesh::joined([plate(&outline, thickness), hub, ring])
}

/// Gears of steel, brass and painted iron that mesh on a base plate, and one that leans on them.
pub fn gears() -> Model {
    let mut model = Model::default();
    let module = 0.0042;
    let base = cylinder(0.1, 0.008, 96);
    model.push(base, Material::plastic([0.045, 0.05, 0.06], 0.35));
    let brushed = Solid {
        pattern: Pattern::Rings,
        size: 0.002,
        low: [0.42, 0.41, 0.40],
        high: [0.70, 0.69, 0.68],
        seed: 2,
    };
    let (big, middle, small) = (24, 16, 10);
    let distance = |a: usize, b: usize| module * (a + b) as f64 / 2.0;
    let first = dvec3(-0.034, 0.018, 0.008);
    let second = first + polar(-0.75, distance(big, middle), 0.0);
    let third = first + polar(0.28, distance(big, small), 0.0);
    model.push(
        gear(big, module, 0.014).at(first),
        Material::Conductor { reflectance: Texture::Solid(brushed), alpha: 0.22 },
    );
    model.push(gear(middle, module, 0.018).turned(0.16).at(second), Material::metal(BRASS, 0.1));
    model.push(gear(small, module, 0.024).turned(0.2).at(third), Material::metal(COPPER, 0.3));
    let axles = [first, second, third].map(|p| cylinder(0.005, 0.04, 32).at(p));
    model.push(Mesh::joined(axles), Material::metal([0.91, 0.92, 0.92], 0.05));
    let leaning = gear(14, module, 0.012)
        .moved(DMat3::from_rotation_z(2.2) * DMat3::from_rotation_y(1.15), dvec3(-0.066, 0.062, 0.058));
    model.push(leaning, Material::plastic([0.55, 0.06, 0.04], 0.25));
    model
}
