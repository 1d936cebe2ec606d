//! Round things, and flat round ones.

use std::f64::consts::{PI, TAU};

use glam::{DMat3, dvec3};

use super::{Draws, polar};
use crate::virtual_rig::shapes::{circle, curve, lathe, patch, sphere, sweep, torus};
use crate::virtual_rig::{Material, Mesh, Model, Pattern, Solid, Texture};

/// An apple, two oranges, a banana, grapes and a leaf.
pub fn fruit() -> Model {
    let mut model = Model::default();
    let mut draws = Draws::new(14);
    let apple = patch(96, 64, |u, v| {
        let t = PI * v;
        // A cardioid-like section, dented at both ends, with five faint lobes.
        let radius = 0.041 * (1.0 + 0.22 * (-t.cos() * 0.9).powi(3)) * (1.0 + 0.012 * (5.0 * TAU * u).cos());
        let dent = 0.030 * (-(t / 0.42).powi(2)).exp() + 0.016 * (-((PI - t) / 0.5).powi(2)).exp();
        polar(TAU * u, radius * t.sin(), 0.0385 + radius * t.cos() - dent * t.cos())
    });
    let skin = Solid {
        pattern: Pattern::Clouds,
        size: 0.045,
        low: [0.62, 0.42, 0.06],
        high: [0.50, 0.02, 0.02],
        seed: 2,
    };
    let lacquer = |reflectance: Texture, alpha: f64| Material::Glossy { reflectance, alpha, ior: 1.42 };
    model.push(apple.at(dvec3(-0.042, 0.034, 0.0018)), lacquer(Texture::Solid(skin), 0.16));
    let stalk = curve(&[dvec3(0.0, 0.0, 0.0), dvec3(0.002, 0.001, 0.012), dvec3(0.008, 0.003, 0.022)], 6);
    model.push(
        sweep(&stalk, &circle(0.0015, 8), |s| 0.8 + 0.7 * s).at(dvec3(-0.042, 0.034, 0.056)),
        Material::matt([0.10, 0.05, 0.02]),
    );
    let oranges = [(0.036, 0.040, 0.050), (0.033, 0.064, -0.022)].map(|(radius, x, y)| {
        let centre = dvec3(x, y, radius * 1.006);
        sphere(radius, 160)
            .bent(
                |p| p * (1.0 + 0.006 * (p.x * 2100.0).sin() * (p.y * 2300.0).sin() * (p.z * 1900.0).cos()),
                1.0,
            )
            .at(centre)
    });
    model.push(Mesh::joined(oranges), lacquer([0.80, 0.28, 0.01].into(), 0.3));
    let path: Vec<_> = (0..=40)
        .map(|i| {
            let angle = -2.75 + 1.75 * f64::from(i) / 40.0;
            dvec3(
                0.075 * angle.cos() - 0.012,
                0.075 * angle.sin() + 0.004,
                0.0145 + 0.006 * (f64::from(i) / 20.0 - 1.0).powi(2),
            )
        })
        .collect();
    let banana = sweep(&path, &circle(0.0145, 7), |s| {
        let body = (1.0 - (2.0 * s - 1.0).abs().powi(5)).max(0.0).sqrt();
        if s > 0.9 { body.max(0.24) } else { body.max(0.16) }
    });
    let ripe = Solid {
        pattern: Pattern::Spots,
        size: 0.017,
        low: [0.78, 0.56, 0.05],
        high: [0.30, 0.17, 0.03],
        seed: 7,
    };
    model.push(banana, lacquer(Texture::Solid(ripe), 0.4));
    let grapes = (0..27).map(|k| {
        let (layer, index) = (k / 12, k % 12);
        let angle = 2.4 * f64::from(index) + f64::from(layer);
        let distance = 0.0088 * f64::from(index).sqrt() * (1.0 - 0.15 * f64::from(layer));
        sphere(draws.within(0.0068, 0.0082), 32)
            .at(dvec3(0.004, -0.014, 0.0082 + 0.0135 * f64::from(layer)) + polar(angle, distance, 0.0))
    });
    model.push(Mesh::joined(grapes), lacquer([0.10, 0.02, 0.12].into(), 0.1));
    let leaf = patch(24, 12, |u, v| {
        let width = 0.017 * (PI * u).sin().powf(0.8);
        dvec3(
            0.052 * u,
            width * (2.0 * v - 1.0),
            0.012 * (PI * u).sin() + 0.25 * width * (2.0 * v - 1.0).powi(2) + 0.0007,
        )
    });
    let green = Material::Translucent {
        reflectance: [0.08, 0.26, 0.04].into(),
        transmittance: [0.09, 0.24, 0.02].into(),
    };
    model.push(leaf.moved(DMat3::from_rotation_z(-0.7), dvec3(0.028, -0.052, 0.0)), green);
    model
}

/// Plates, a bowl and a cup, glazed and painted.
pub fn plates() -> Model {
    let mut model = Model::default();
    let plate = |radius: f64| {
        let shape = [
            [0.0, 0.004],
            [0.50, 0.004],
            [0.52, 0.0],
            [0.58, 0.0],
            [0.62, 0.010],
            [0.98, 0.098],
            [1.0, 0.108],
            [0.985, 0.118],
            [0.66, 0.058],
            [0.55, 0.044],
            [0.0, 0.044],
        ];
        lathe(&shape.map(|p| p.map(|v| v * radius)), 160)
    };
    let painted = |seed: u64, low: [f32; 3], high: [f32; 3], pattern: Pattern, size: f32| Material::Glossy {
        reflectance: Texture::Solid(Solid { pattern, size, low, high, seed }),
        alpha: 0.07,
        ior: 1.5,
    };
    model.push(plate(0.104), painted(1, [0.76, 0.76, 0.73], [0.05, 0.12, 0.42], Pattern::Veins, 0.05));
    let lift = 0.047 * 0.104;
    model.push(
        plate(0.076).at(dvec3(0.006, -0.004, lift)),
        painted(2, [0.70, 0.62, 0.45], [0.55, 0.10, 0.06], Pattern::Rings, 0.013),
    );
    let lift = lift + 0.047 * 0.076;
    let bowl = [
        [0.0, 0.0],
        [0.020, 0.0],
        [0.021, 0.004],
        [0.036, 0.014],
        [0.045, 0.030],
        [0.047, 0.042],
        [0.0455, 0.042],
        [0.043, 0.031],
        [0.034, 0.017],
        [0.018, 0.008],
        [0.0, 0.007],
    ];
    model.push(
        lathe(&bowl, 120).at(dvec3(-0.012, 0.006, lift)),
        painted(3, [0.02, 0.16, 0.15], [0.05, 0.30, 0.26], Pattern::Clouds, 0.02),
    );
    let cup = lathe(
        &[
            [0.0, 0.0],
            [0.022, 0.0],
            [0.027, 0.006],
            [0.029, 0.05],
            [0.0285, 0.052],
            [0.026, 0.050],
            [0.0245, 0.008],
            [0.0, 0.006],
        ],
        96,
    );
    let handle: Vec<_> = (0..=24)
        .map(|i| {
            let angle = -1.75 + 3.5 * f64::from(i) / 24.0;
            dvec3(0.027 + 0.015 * angle.cos(), 0.0, 0.028 + 0.016 * angle.sin())
        })
        .collect();
    let cup = Mesh::joined([cup, sweep(&handle, &circle(0.0032, 12), |_| 1.0)]);
    // In the bowl, upside down and tilted.
    let turn = DMat3::from_rotation_z(-1.1) * DMat3::from_rotation_x(PI + 0.22);
    model.push(
        cup.moved(turn, dvec3(-0.010, 0.010, lift + 0.0665)),
        painted(4, [0.80, 0.78, 0.72], [0.62, 0.05, 0.05], Pattern::Spots, 0.016),
    );
    model
}

/// A snail: a coiled, striped shell on a soft foot.
pub fn snail() -> Model {
    let mut model = Model::default();
    let turns = 3.3;
    let coil = |s: f64| {
        // A logarithmic spiral in the plane of x and z, drawn out along y.
        let angle = TAU * turns * s;
        let distance = 0.038 * (2.0 * (s - 1.0)).exp();
        (angle, distance)
    };
    let shell = patch(420, 40, |u, v| {
        let (angle, distance) = coil(u);
        let radius = distance * 0.70;
        let across = TAU * v;
        let rib = 1.0 + 0.018 * (110.0 * u).sin();
        let (out, aside) =
            (distance + radius * rib * across.cos(), radius * rib * across.sin() + 0.55 * (0.038 - distance));
        dvec3(-out * angle.cos(), aside, out * angle.sin())
    });
    let bands = Solid {
        pattern: Pattern::Rings,
        size: 0.0085,
        low: [0.66, 0.44, 0.20],
        high: [0.16, 0.055, 0.02],
        seed: 3,
    };
    let turn = DMat3::from_rotation_z(0.35) * DMat3::from_rotation_x(0.25);
    let glaze = Material::Glossy { reflectance: Texture::Solid(bands), alpha: 0.15, ior: 1.5 };
    model.push(shell.moved(turn, dvec3(0.006, -0.004, 0.069)), glaze);
    let spine = curve(
        &[
            dvec3(0.105, 0.02, 0.002),
            dvec3(0.06, 0.01, 0.007),
            dvec3(0.0, 0.0, 0.013),
            dvec3(-0.055, -0.012, 0.014),
            dvec3(-0.078, -0.022, 0.024),
            dvec3(-0.086, -0.026, 0.046),
        ],
        12,
    );
    let foot = sweep(&spine, &circle(0.017, 28), |s| (0.10 + 1.9 * s * (1.0 - 0.62 * s)).min(0.95))
        .bent(|p| dvec3(p.x, p.y, p.z.max(0.0004)), 1.0);
    let flesh = Solid {
        pattern: Pattern::Spots,
        size: 0.007,
        low: [0.30, 0.21, 0.13],
        high: [0.50, 0.38, 0.25],
        seed: 6,
    };
    let soft = Material::Glossy { reflectance: Texture::Solid(flesh), alpha: 0.3, ior: 1.38 };
    let horns = [(-1.0, 0.040), (1.0, 0.036)].map(|(side, rise)| {
        let start = dvec3(-0.086, -0.026 + 0.005 * side, 0.050);
        let path = curve(
            &[
                start,
                start + dvec3(-0.006, 0.004 * side, 0.6 * rise),
                start + dvec3(-0.016, 0.011 * side, rise),
            ],
            8,
        );
        let tip = start + dvec3(-0.016, 0.011 * side, rise);
        Mesh::joined([sweep(&path, &circle(0.0021, 10), |s| 1.2 - 0.5 * s), sphere(0.0033, 20).at(tip)])
    });
    let head = sphere(0.0155, 40).at(dvec3(-0.085, -0.026, 0.046));
    model.push(Mesh::joined([foot, head].into_iter().chain(horns)), soft);
    model.push(
        torus(0.012, 0.0018, 40, 8).at(dvec3(0.078, -0.07, 0.0018)),
        Material::metal([0.87, 0.64, 0.26], 0.2),
    );
    model
}
