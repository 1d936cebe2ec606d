//! Leaves: jagged, ruffled, and thin enough to let light through.

use std::f64::consts::{PI, TAU};

use glam::{DMat3, DVec3, dvec3};

use super::{Draws, polar};
use crate::virtual_rig::shapes::{circle, curve, lathe, patch, rod, sphere, sweep, upright_to};
use crate::virtual_rig::{Material, Mesh, Model, Pattern, Solid, Texture};

fn leaf_material(reflectance: [f32; 3], transmittance: [f32; 3]) -> Material {
    Material::Translucent { reflectance: reflectance.into(), transmittance: transmittance.into() }
}

/// A flat toothed blade along +x in the plane of x and y, of unit length; `teeth` a side.
fn blade(width: f64, teeth: usize) -> Mesh {
    let count = 2 * teeth + 1;
    let mut mesh = Mesh::default();
    for i in 0..=count {
        let t = i as f64 / count as f64;
        let envelope = (PI * (0.06 + 0.94 * t)).sin().powf(0.7) * width / 2.0;
        let tooth = if i == count {
            0.0
        } else if i % 2 == 1 {
            0.55
        } else {
            1.0
        };
        let side = envelope * tooth;
        let back = if i % 2 == 1 { 0.04 } else { 0.0 };
        let droop = -0.15 * t * t;
        mesh.positions.push(dvec3(t, 0.0, droop));
        mesh.positions.push(dvec3(t - back, side, droop + 0.35 * side));
        mesh.positions.push(dvec3(t - back, -side, droop + 0.35 * side));
    }
    for i in 0..count as u32 {
        let a = 3 * i;
        mesh.triangles.extend([[a, a + 3, a + 4], [a, a + 4, a + 1], [a, a + 5, a + 3], [a, a + 2, a + 5]]);
    }
    mesh
}

/// A fern in a pot: arched fronds, each with two rows of toothed leaflets.
pub fn fern() -> Model {
    let mut draws = Draws::new(4);
    let (mut stems, mut blades) = (Vec::new(), Vec::new());
    let fronds = 13;
    for k in 0..fronds {
        let angle = TAU * (f64::from(k) + draws.within(-0.2, 0.2)) / f64::from(fronds);
        let inner = k % 3 == 0;
        let (reach, rise) =
            if inner { (draws.within(0.025, 0.045), 0.085) } else { (draws.within(0.07, 0.082), 0.065) };
        let start = dvec3(0.0, 0.0, 0.05);
        let path: Vec<DVec3> = (0..=26)
            .map(|i| {
                let s = f64::from(i) / 26.0;
                start + polar(angle, 0.006 + reach * s, rise * 2.2 * s * (1.0 - 0.52 * s))
            })
            .collect();
        stems.push(sweep(&path, &circle(0.0011, 6), |s| 1.2 - s));
        for i in 4..path.len() - 1 {
            let along = (path[i + 1] - path[i - 1]).normalize();
            let side = along.cross(DVec3::Z).normalize();
            let up = side.cross(along);
            let s = i as f64 / 26.0;
            let length = 0.030 * (PI * (0.12 + 0.86 * s)).sin().powf(0.8) * draws.within(0.9, 1.1);
            for sign in [1.0, -1.0] {
                let x = (along * 0.55 + side * sign * 0.85).normalize();
                let y = up.cross(x).normalize();
                let frame =
                    DMat3::from_cols(x, y, x.cross(y)) * DMat3::from_rotation_x(draws.within(-0.4, 0.4));
                blades.push(blade(0.28, 5).stretched(DVec3::splat(length)).moved(frame, path[i]));
            }
        }
    }
    let mut model = Model::default();
    model.push(Mesh::joined(blades), leaf_material([0.06, 0.24, 0.03], [0.08, 0.26, 0.02]));
    model.push(Mesh::joined(stems), Material::matt([0.16, 0.20, 0.05]));
    let pot = [
        [0.0, 0.0],
        [0.028, 0.0],
        [0.036, 0.040],
        [0.040, 0.041],
        [0.040, 0.052],
        [0.034, 0.052],
        [0.033, 0.044],
        [0.0, 0.044],
    ];
    let clay = Solid {
        pattern: Pattern::Clouds,
        size: 0.03,
        low: [0.36, 0.13, 0.06],
        high: [0.58, 0.25, 0.12],
        seed: 3,
    };
    model.push(lathe(&pot, 72), Material::Lambert { reflectance: Texture::Solid(clay) });
    model
}

/// A thistle: a spiny head with a tuft of thin petals, on a stem with spiny leaves.
pub fn thistle() -> Model {
    let mut draws = Draws::new(9);
    let mut model = Model::default();
    let path = curve(
        &[
            dvec3(0.0, 0.0, 0.001),
            dvec3(0.006, 0.003, 0.035),
            dvec3(-0.004, 0.002, 0.075),
            DVec3::new(0.0, 0.0, 0.112),
        ],
        10,
    );
    let stem = sweep(&path, &circle(0.0034, 12), |s| 1.3 - 0.4 * s);
    let centre = dvec3(0.0, 0.0, 0.132);
    let mut green = vec![stem, sphere(0.024, 48).stretched(dvec3(1.0, 1.0, 1.05)).at(centre)];
    let mut spines = Vec::new();
    // Spines on Fibonacci's spiral.
    for k in 0..260 {
        let z = 0.62 - 1.5 * (f64::from(k) + 0.5) / 260.0;
        let out = polar(2.399_963 * f64::from(k), (1.0 - z * z).sqrt(), z);
        let lean = (out + dvec3(0.0, 0.0, 0.45)).normalize();
        let spine = lathe(&[[0.0016, -0.001], [0.0011, 0.004], [0.0, draws.within(0.009, 0.014)]], 5);
        spines.push(spine.moved(upright_to(lean), centre + 0.0235 * out));
    }
    green.push(Mesh::joined(spines));
    model.push(Mesh::joined(green), Material::matt([0.17, 0.26, 0.09]));
    let petals = (0..340).map(|k| {
        let tilt = 0.75 * ((f64::from(k) + 0.5) / 340.0).sqrt();
        let out = polar(2.399_963 * f64::from(k), tilt.sin(), tilt.cos());
        let start = centre + dvec3(0.0, 0.0, 0.008) + 0.011 * out;
        rod(start, start + out * draws.within(0.032, 0.044), 0.00045, 4)
    });
    model.push(Mesh::joined(petals), leaf_material([0.42, 0.08, 0.45], [0.15, 0.03, 0.17]));
    let leaves = (0..9).map(|k| {
        let angle = 2.4 * f64::from(k);
        let height = 0.006 + 0.011 * f64::from(k);
        let length = 0.088 - 0.006 * f64::from(k);
        let frame = DMat3::from_rotation_z(angle) * DMat3::from_rotation_y(-draws.within(0.25, 0.55));
        blade(0.42, 7).stretched(DVec3::splat(length)).moved(frame, dvec3(0.0, 0.0, height))
    });
    let leaves = Mesh::joined(leaves).bent(|p| dvec3(p.x, p.y, p.z.max(0.0004)), 0.3);
    model.push(leaves, leaf_material([0.14, 0.27, 0.11], [0.09, 0.18, 0.05]));
    model
}

/// A cabbage: ruffled leaves, one around the other.
pub fn cabbage() -> Model {
    let mut model = Model::default();
    let layers = [(5, 0.030, 1.45), (6, 0.044, 1.20), (7, 0.058, 0.92), (8, 0.070, 0.62)];
    for (layer, (count, size, opening)) in layers.into_iter().enumerate() {
        let leaves = (0..count).map(|k| {
            let turn = TAU * f64::from(k) / f64::from(count) + 0.5 * layer as f64;
            let phase = 1.7 * f64::from(k) + layer as f64;
            patch(40, 28, |u, v| {
                // From the stalk outwards along a curl, and to both sides around the head.
                let side = (u - 0.5) * 2.0;
                let spread = 0.72 * (PI * (0.12 + 0.80 * v)).sin();
                let ruffle =
                    v.powi(3) * 0.10 * ((13.0 * side + phase).sin() + 0.5 * (29.0 * side - phase).sin());
                let elevation = -0.9 + (opening + 0.75) * v + ruffle;
                let distance = size * (1.0 - 0.10 * side * side + 0.12 * v * v);
                let angle = turn + side * spread + 0.05 * (9.0 * v + phase).sin() * v;
                polar(angle, distance * elevation.cos(), distance * elevation.sin())
            })
        });
        let green = layer as f32 / 3.0;
        let colour = [0.44 - 0.30 * green, 0.52 - 0.19 * green, 0.22 - 0.14 * green];
        let leaves = Mesh::joined(leaves)
            .at(dvec3(0.0, 0.0, 0.0555))
            .bent(|p| dvec3(p.x, p.y, p.z.max(0.0005 * (5 - layer) as f64)), 0.6);
        model.push(leaves, leaf_material(colour, colour.map(|c| 0.6 * c)));
    }
    let heart = sphere(0.026, 40).at(dvec3(0.0, 0.0, 0.058));
    model.push(heart, Material::matt([0.52, 0.56, 0.28]));
    model
}
