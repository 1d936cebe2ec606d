//! Dark beside bright.

use std::f64::consts::PI;

use glam::{DMat3, dvec3};

use super::{Draws, polar};
use crate::virtual_rig::shapes::{block, circle, cylinder, lathe, rod, sphere, sweep};
use crate::virtual_rig::{Material, Mesh, Model, Pattern, Solid, Texture};

/// A turned chessman: base, waist and collar, up to where its head sits (in units of its height).
fn turned(height: f64, head: &[[f64; 2]]) -> Mesh {
    let base = [
        [0.0, 0.0],
        [0.26, 0.0],
        [0.27, 0.03],
        [0.25, 0.075],
        [0.21, 0.10],
        [0.20, 0.13],
        [0.13, 0.20],
        [0.095, 0.34],
        [0.085, 0.48],
        [0.15, 0.52],
        [0.15, 0.55],
        [0.09, 0.575],
    ];
    let profile: Vec<[f64; 2]> = base.iter().chain(head).map(|p| p.map(|v| v * height)).collect();
    lathe(&profile, 72)
}

fn pawn(height: f64) -> Mesh {
    let ball = |k: i32| {
        let angle = -1.1 + (PI / 2.0 + 1.1) * f64::from(k) / 12.0;
        [0.17 * angle.cos(), 0.72 + 0.17 * angle.sin()]
    };
    turned(height, &(0..=12).map(ball).collect::<Vec<_>>())
}

fn rook(height: f64) -> Mesh {
    let tower = turned(
        height,
        &[[0.12, 0.60], [0.13, 0.70], [0.19, 0.74], [0.19, 0.84], [0.12, 0.84], [0.12, 0.78], [0.0, 0.78]],
    );
    let teeth = (0..6).map(|k| {
        let turn = PI / 3.0 * f64::from(k);
        block(dvec3(0.155 * height, 0.0, 0.88 * height), dvec3(0.07, 0.11, 0.08) * height).turned(turn)
    });
    Mesh::joined([tower].into_iter().chain(teeth))
}

fn king(height: f64) -> Mesh {
    let crown = turned(height, &[[0.10, 0.60], [0.17, 0.80], [0.165, 0.83], [0.06, 0.88], [0.0, 0.885]]);
    let upright = block(dvec3(0.0, 0.0, 0.94 * height), dvec3(0.035, 0.035, 0.13) * height);
    let across = block(dvec3(0.0, 0.0, 0.95 * height), dvec3(0.11, 0.035, 0.035) * height);
    Mesh::joined([crown, upright, across])
}

/// An ending on a small board: black and white men.
pub fn chess() -> Model {
    let mut model = Model::default();
    let square = 0.034;
    // The pattern's planes lie between squares, and well off the board's faces.
    let checks = Solid {
        pattern: Pattern::Checks,
        size: square as f32,
        low: [0.62, 0.50, 0.34],
        high: [0.06, 0.035, 0.02],
        seed: 0,
    };
    let board = block(dvec3(0.0, 0.0, 0.007), dvec3(6.0 * square, 6.0 * square, 0.0136));
    model.push(board, Material::Glossy { reflectance: Texture::Solid(checks), alpha: 0.22, ior: 1.5 });
    let rim = [(0.0, 1.0), (0.0, -1.0), (1.0, 0.0), (-1.0, 0.0)].map(|(x, y): (f64, f64)| {
        let size = dvec3(0.006 + 0.21 * y.abs(), 0.006 + 0.204 * x.abs(), 0.016);
        block(dvec3(x, y, 0.0) * 0.105 + dvec3(0.0, 0.0, 0.008), size)
    });
    model.push(Mesh::joined(rim), Material::plastic([0.10, 0.045, 0.02], 0.2));
    let place = |i: i32, j: i32| dvec3((f64::from(i) - 2.5) * square, (f64::from(j) - 2.5) * square, 0.0138);
    let white = [
        king(0.088).at(place(1, 0)),
        rook(0.062).at(place(4, 1)),
        pawn(0.050).at(place(0, 1)),
        pawn(0.050).at(place(2, 2)),
        pawn(0.050).at(place(3, 1)),
    ];
    // One of the black pawns has fallen.
    let fallen = pawn(0.050).moved(
        DMat3::from_rotation_z(0.9) * DMat3::from_rotation_y(1.48),
        place(4, 2) + dvec3(0.0, 0.0, 0.0134),
    );
    let black = [
        king(0.088).at(place(4, 5)),
        rook(0.062).at(place(1, 4)),
        pawn(0.050).at(place(2, 3)),
        pawn(0.050).at(place(5, 4)),
        pawn(0.050).at(place(3, 4)),
        fallen,
    ];
    model.push(Mesh::joined(white), Material::plastic([0.80, 0.76, 0.66], 0.15));
    model.push(Mesh::joined(black), Material::plastic([0.018, 0.016, 0.016], 0.12));
    model
}

/// A snowman on a snowy disc: near-white balls, coal, a carrot, a scarf and a black hat.
pub fn snowman() -> Model {
    let mut model = Model::default();
    let mut draws = Draws::new(77);
    let snow = Solid {
        pattern: Pattern::Clouds,
        size: 0.012,
        low: [0.80, 0.82, 0.85],
        high: [0.88, 0.89, 0.90],
        seed: 3,
    };
    let lumpy = |radius: f64| {
        sphere(radius, 120).bent(
            |p| p * (1.0 + 0.012 * (p.x * 300.0).sin() * (p.y * 260.0 + 1.0).sin() * (p.z * 280.0).cos()),
            1.2,
        )
    };
    let ground =
        lathe(&[[0.0, 0.0], [0.098, 0.0], [0.1, 0.004], [0.085, 0.010], [0.05, 0.013], [0.0, 0.014]], 96);
    let body = [(0.046, 0.054), (0.034, 0.118), (0.025, 0.162)]
        .map(|(radius, z)| lumpy(radius).at(dvec3(0.0, 0.0, z)));
    model.push(
        Mesh::joined([ground].into_iter().chain(body)),
        Material::Lambert { reflectance: Texture::Solid(snow) },
    );
    let coal = [
        (0.025, 0.162, 0.34, 0.30),
        (0.025, 0.162, -0.34, 0.30),
        (0.034, 0.118, 0.0, 0.35),
        (0.034, 0.118, 0.0, -0.15),
        (0.046, 0.054, 0.0, 0.40),
    ];
    let front = -0.9;
    let lumps = coal.map(|(radius, z, aside, rise): (f64, f64, f64, f64)| {
        let out = polar(front + aside, rise.cos(), rise.sin());
        sphere(0.0042, 7).stretched(dvec3(1.0, 0.8, 1.2)).at(dvec3(0.0, 0.0, z) + out * radius)
    });
    let loose = (0..9).map(|_| {
        let place = polar(draws.within(0.0, 6.2), draws.within(0.066, 0.083), 0.014);
        sphere(draws.within(0.004, 0.007), 6).turned(draws.within(0.0, 3.0)).at(place)
    });
    model.push(Mesh::joined(lumps.into_iter().chain(loose)), Material::plastic([0.012, 0.012, 0.013], 0.25));
    let nose = lathe(&[[0.0045, 0.0], [0.0, 0.030]], 20);
    let aim = DMat3::from_rotation_z(front) * DMat3::from_rotation_y(PI / 2.0);
    model.push(
        nose.moved(aim, dvec3(0.0, 0.0, 0.162) + polar(front, 0.022, 0.0)),
        Material::matt([0.75, 0.25, 0.03]),
    );
    let hat = Mesh::joined([
        cylinder(0.028, 0.003, 64).at(dvec3(0.0, 0.0, 0.179)),
        cylinder(0.0185, 0.018, 64).at(dvec3(0.0, 0.0, 0.181)),
    ]);
    model.push(hat, Material::matt([0.02, 0.02, 0.022]));
    let around: Vec<_> = (0..=48).map(|k| polar(PI / 24.0 * f64::from(k), 0.0255, 0.1425)).collect();
    let end = polar(front + 0.5, 0.030, 0.0);
    let scarf = Mesh::joined([
        sweep(&around, &circle(0.0068, 14), |_| 1.0),
        sweep(
            &[
                end + dvec3(0.0, 0.0, 0.142),
                end * 1.22 + dvec3(0.0, 0.0, 0.118),
                end * 1.26 + dvec3(0.0, 0.0, 0.094),
            ],
            &circle(0.0062, 10),
            |_| 1.0,
        ),
    ]);
    let knit = Solid {
        pattern: Pattern::Stripes,
        size: 0.012,
        low: [0.55, 0.03, 0.03],
        high: [0.05, 0.22, 0.08],
        seed: 9,
    };
    model.push(scarf, Material::Lambert { reflectance: Texture::Solid(knit) });
    let arms = [1.0, -1.0].map(|side| {
        let start = polar(front + 1.45 * side, 0.030, 0.122);
        let hand = polar(front + 1.30 * side, 0.088, 0.152);
        let twig = |to: glam::DVec3| rod(start + (hand - start) * 0.72, to, 0.0009, 6);
        Mesh::joined([
            rod(start, hand, 0.0016, 8),
            twig(hand + dvec3(0.0, 0.0, 0.014)),
            twig(hand + polar(front, 0.012, 0.004)),
        ])
    });
    model.push(Mesh::joined(arms), Material::matt([0.14, 0.07, 0.03]));
    model
}
