//! Paper, rubber and tape: light that comes through.

use std::f64::consts::{PI, TAU};

use glam::{DMat3, DVec3, dvec2, dvec3};

use super::{Draws, polar};
use crate::virtual_rig::shapes::{circle, curve, cylinder, lathe, patch, plate, sphere, strip, sweep, torus};
use crate::virtual_rig::{Material, Mesh, Model, Pattern, Solid, Texture};

/// A pleated paper lantern between two wooden lids, with a candle in it.
pub fn lantern() -> Model {
    let mut model = Model::default();
    let (low, high) = (0.012, 0.158);
    let paper = patch(240, 60, |u, v| {
        let height = low + (high - low) * v;
        let belly = 0.046 + 0.034 * (PI * v).sin();
        // Pleats run aslant, and are pulled in by each hoop.
        let pleat = 0.0028 * (24.0 * TAU * (u + 0.06 * v)).cos();
        let hoop = 0.0018 * (7.0 * TAU * v).cos();
        polar(TAU * u, belly + pleat + hoop, height)
    });
    let dyed = Solid {
        pattern: Pattern::Clouds,
        size: 0.05,
        low: [0.62, 0.20, 0.05],
        high: [0.66, 0.46, 0.14],
        seed: 21,
    };
    let through = Solid { low: [0.26, 0.06, 0.01], high: [0.32, 0.19, 0.05], ..dyed.clone() };
    model.push(
        paper,
        Material::Translucent { reflectance: Texture::Solid(dyed), transmittance: Texture::Solid(through) },
    );
    let wood = Solid {
        pattern: Pattern::Rings,
        size: 0.011,
        low: [0.16, 0.075, 0.03],
        high: [0.30, 0.15, 0.07],
        seed: 5,
    };
    let lids = Mesh::joined([
        cylinder(0.052, 0.012, 72),
        torus(0.046, 0.006, 72, 16).at(dvec3(0.0, 0.0, high + 0.002)),
        torus(0.020, 0.0022, 48, 10).moved(DMat3::from_rotation_x(PI / 2.0), dvec3(0.0, 0.0, 0.176)),
        sweep(
            &[dvec3(-0.046, 0.0, high + 0.002), dvec3(0.046, 0.0, high + 0.002)],
            &strip(0.008, 0.004),
            |_| 1.0,
        ),
    ]);
    model.push(lids, Material::Lambert { reflectance: Texture::Solid(wood) });
    model.push(cylinder(0.017, 0.05, 48).at(dvec3(0.0, 0.0, 0.012)), Material::matt([0.80, 0.76, 0.66]));
    model
}

/// A sole's outline at a place along its length, from heel (0) to toe (1): half width.
fn sole_width(t: f64) -> f64 {
    let heel = 0.026 * (1.0 - (2.0 * (t - 0.16) / 0.32).powi(2)).max(0.0).sqrt();
    let waist = 0.0215 + 0.011 * ((t - 0.12) / 0.6).clamp(0.0, 1.0).powi(2);
    let end = (1.0 - ((t - 0.70) / 0.30).max(0.0).powi(2)).max(0.0).sqrt();
    if t < 0.16 { heel.min(waist) } else { waist * end }
}

fn sandal(mirror: f64) -> [Mesh; 3] {
    let length = 0.2;
    let side =
        |t: f64, sign: f64| dvec2((t - 0.5) * length, sign * sole_width(t) + mirror * 0.005 * (PI * t).sin());
    let there = (0..=48).map(|i| side(f64::from(i) / 48.0, -1.0));
    let back = (1..48).rev().map(|i| side(f64::from(i) / 48.0, 1.0));
    let outline: Vec<_> = there.chain(back).collect();
    let sole = plate(&outline, 0.0135);
    let ribs = (0..34).map(|i| {
        let t = 0.06 + 0.88 * f64::from(i) / 33.0;
        let (from, to) = (side(t, -0.86), side(t, 0.86));
        sweep(&[from.extend(0.0138), to.extend(0.0138)], &circle(0.0012, 6), |_| 1.0)
    });
    let toe = dvec3(0.058, 0.004 * mirror, 0.014);
    let straps = [-1.0, 1.0].map(|sign| {
        let anchor = side(0.40, 0.92 * sign).extend(0.012);
        let over = (toe + anchor) / 2.0 + dvec3(-0.004, 0.008 * sign, 0.024);
        let path = curve(
            &[toe - dvec3(0.0, 0.0, 0.004), toe + dvec3(-0.002, 0.001 * sign, 0.018), over, anchor],
            14,
        );
        sweep(&path, &strip(0.011, 0.0016), |s| 0.45 + 0.75 * s)
    });
    [sole, Mesh::joined(ribs), Mesh::joined(straps)]
}

/// Two rubber sandals, one on the other, with thin straps.
pub fn sandals() -> Model {
    let mut model = Model::default();
    let speckles = Solid {
        pattern: Pattern::Spots,
        size: 0.012,
        low: [0.04, 0.20, 0.42],
        high: [0.75, 0.72, 0.20],
        seed: 8,
    };
    let straps = Material::Translucent {
        reflectance: [0.50, 0.10, 0.14].into(),
        transmittance: [0.36, 0.05, 0.08].into(),
    };
    // The second leans on the first: its heel on the floor, its toe up.
    let flat = (DMat3::from_rotation_z(0.25), dvec3(0.0, -0.035, 0.0));
    let leaning =
        (DMat3::from_rotation_z(0.75) * DMat3::from_rotation_y(-0.20), dvec3(-0.010, 0.034, 0.0205));
    for (mirror, (turn, place)) in [(1.0, flat), (-1.0, leaning)] {
        let [sole, ribs, bands] = sandal(mirror).map(|mesh| mesh.moved(turn, place));
        model.push(
            sole,
            Material::Glossy { reflectance: Texture::Solid(speckles.clone()), alpha: 0.45, ior: 1.45 },
        );
        model.push(ribs, Material::matt([0.05, 0.13, 0.22]));
        model.push(bands, straps.clone());
    }
    model
}

/// A roll of tape on its side: core and wound tape.
fn roll(outer: f64, width: f64) -> [Mesh; 2] {
    let core = outer * 0.62;
    let ring = |inner: f64, outer: f64| {
        lathe(&[[inner, 0.0], [outer, 0.0], [outer, width], [inner, width], [inner, 0.0]], 120)
    };
    [ring(core - 0.003, core), ring(core, outer)]
}

/// Rolls of tape, lying, standing and stacked; one has a long loose end that light shines through.
pub fn tapes() -> Model {
    let mut model = Model::default();
    let card = Material::matt([0.42, 0.30, 0.19]);
    let tape =
        |colour: [f32; 3], alpha: f64| Material::Glossy { reflectance: colour.into(), alpha, ior: 1.5 };
    let lying = [
        (0.048, 0.024, dvec3(-0.040, 0.034, 0.0), [0.62, 0.47, 0.22], 0.12),
        (0.040, 0.019, dvec3(-0.036, 0.030, 0.0241), [0.03, 0.03, 0.035], 0.2),
        (0.034, 0.012, dvec3(0.052, 0.052, 0.0), [0.05, 0.30, 0.10], 0.15),
        (0.030, 0.012, dvec3(0.050, 0.054, 0.0121), [0.70, 0.58, 0.03], 0.15),
    ];
    for (outer, width, place, colour, alpha) in lying {
        let [core, wound] = roll(outer, width);
        model.push(core.at(place), card.clone());
        model.push(wound.at(place), tape(colour, alpha));
    }
    let outer = 0.042;
    let upright = DMat3::from_rotation_z(0.5) * DMat3::from_rotation_x(PI / 2.0);
    let place = dvec3(0.028, -0.030, outer);
    let [core, wound] = roll(outer, 0.022);
    model.push(core.moved(upright, place), card);
    model.push(wound.moved(upright, place), tape([0.55, 0.04, 0.04], 0.1));
    // The loose end leaves the roll's top and falls to the floor in waves.
    let mut draws = Draws::new(6);
    let wave = draws.within(0.0, 1.0);
    let loose = patch(90, 4, |u, v| {
        let x = -0.095 * u;
        let fall = outer * 2.0 * (1.0 - u).powi(2) * (1.0 + 0.5 * u);
        let height = fall + 0.006 * (1.0 - (1.0 - u).powi(3)) * (1.0 + (3.2 * TAU * u + wave).sin());
        dvec3(x, height - outer + 0.0006, 0.022 * v)
    });
    let film = Material::Translucent {
        reflectance: [0.34, 0.05, 0.05].into(),
        transmittance: [0.46, 0.06, 0.06].into(),
    };
    model.push(loose.moved(upright, place), film);
    let pencil =
        sweep(&[dvec3(-0.088, -0.075, 0.0042), dvec3(0.02, -0.094, 0.0042)], &circle(0.0042, 6), |_| 1.0);
    model.push(pencil, tape([0.70, 0.42, 0.03], 0.2));
    let tip =
        sweep(&[dvec3(0.02, -0.094, 0.0042), dvec3(0.036, -0.0968, 0.0042)], &circle(0.0042, 12), |s| {
            1.0 - 0.85 * s
        });
    model.push(tip, Material::matt([0.62, 0.44, 0.26]));
    let ball = sphere(0.0105, 40).at(DVec3::new(0.087, -0.02, 0.0105));
    model.push(
        ball,
        Material::Translucent {
            reflectance: [0.35, 0.40, 0.42].into(),
            transmittance: [0.42, 0.50, 0.52].into(),
        },
    );
    model
}
