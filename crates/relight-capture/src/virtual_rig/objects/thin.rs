//! Thin things: frames, wires and spokes.

use std::f64::consts::{PI, TAU};

use glam::{DMat3, DVec3, dvec3};

use super::polar;
use crate::virtual_rig::shapes::{circle, cylinder, lathe, rod, sphere, strip, sweep, torus, upright_to};
use crate::virtual_rig::{Material, Mesh, Model};

/// A cube of square rods, one corner down, on a small foot.
pub fn wire_cube() -> Model {
    let (edge, rod_width) = (0.098, 0.0062);
    let rods = (0..12).map(|k| {
        let (axis, a, b) = (k / 4, k & 1, k >> 1 & 1);
        let mut start = [0.0; 3];
        start[(axis + 1) % 3] = edge * f64::from(a as u8);
        start[(axis + 2) % 3] = edge * f64::from(b as u8);
        let along = DVec3::AXES[axis];
        let start = DVec3::from_array(start);
        let half = along * (rod_width / 2.0);
        sweep(&[start - half, start + along * edge + half], &strip(rod_width, rod_width), |_| 1.0)
    });
    let stand = DMat3::from_rotation_z(0.35) * upright_to(DVec3::ONE).transpose();
    let frame = Mesh::joined(rods).moved(stand, dvec3(0.0, 0.0, 0.006));
    let mut model = Model::default();
    model.push(frame, Material::plastic([0.68, 0.09, 0.02], 0.25));
    let foot = lathe(&[[0.0, 0.0], [0.026, 0.0], [0.027, 0.002], [0.008, 0.009], [0.0, 0.009]], 48);
    model.push(foot, Material::plastic([0.03, 0.03, 0.035], 0.2));
    model
}

/// A domed cage of wires with a bird on a swing.
pub fn birdcage() -> Model {
    let (radius, wall) = (0.072, 0.115);
    let wires = 22;
    let bars = (0..wires).map(|k| {
        let angle = TAU * f64::from(k) / f64::from(wires);
        let mut path = vec![polar(angle, radius, 0.008), polar(angle, radius, wall)];
        path.extend((1..=10).map(|i| {
            let t = PI / 2.0 * f64::from(i) / 10.0;
            polar(angle, radius * t.cos() + 1e-4, wall + 0.058 * t.sin())
        }));
        sweep(&path, &circle(0.0011, 7), |_| 1.0)
    });
    let rings = [0.03, 0.072, 0.115].map(|height| torus(radius, 0.0015, 72, 8).at(dvec3(0.0, 0.0, height)));
    let ring = torus(0.010, 0.0016, 32, 8).moved(DMat3::from_rotation_x(PI / 2.0), dvec3(0.0, 0.0, 0.184));
    let mut model = Model::default();
    let wire = Mesh::joined(bars.chain(rings).chain([ring]));
    model.push(wire, Material::metal([0.90, 0.72, 0.38], 0.22));
    model.push(cylinder(radius + 0.006, 0.010, 72), Material::plastic([0.05, 0.16, 0.15], 0.25));
    let swing = Mesh::joined([
        rod(dvec3(-0.028, 0.0, 0.062), dvec3(0.028, 0.0, 0.062), 0.0022, 10),
        rod(dvec3(-0.028, 0.0, 0.062), dvec3(-0.004, 0.0, 0.172), 0.0009, 6),
        rod(dvec3(0.028, 0.0, 0.062), dvec3(0.004, 0.0, 0.172), 0.0009, 6),
    ]);
    model.push(swing, Material::matt([0.36, 0.19, 0.08]));
    let body = sphere(1.0, 40).stretched(dvec3(0.016, 0.026, 0.018));
    let feathers = Mesh::joined([
        body.moved(DMat3::from_rotation_x(-0.5), dvec3(0.0, 0.0, 0.083)),
        sphere(0.0125, 32).at(dvec3(0.0, -0.018, 0.106)),
        sphere(1.0, 24)
            .stretched(dvec3(0.006, 0.024, 0.0025))
            .moved(DMat3::from_rotation_x(0.6), dvec3(0.0, 0.034, 0.066)),
    ]);
    model.push(feathers, Material::matt([0.85, 0.62, 0.04]));
    let beak = lathe(&[[0.0035, 0.0], [0.0, 0.009]], 16);
    model.push(
        beak.moved(DMat3::from_rotation_x(PI / 2.0), dvec3(0.0, -0.029, 0.105)),
        Material::plastic([0.75, 0.25, 0.03], 0.3),
    );
    model
}

/// A spoked wheel that leans on its axle's stand.
pub fn wheel() -> Model {
    let (rim, hub) = (0.074, 0.010);
    let spokes = (0..36).map(|k| {
        let angle = TAU * f64::from(k) / 36.0;
        // Crossed in pairs, from both flanges.
        let lean = if k % 2 == 0 { 1.1 } else { -1.1 };
        let flange = if k % 4 < 2 { 0.009 } else { -0.009 };
        rod(polar(angle + lean, hub, flange), polar(angle, rim, 0.0), 0.0007, 6)
    });
    let metal = Mesh::joined(spokes.chain([
        torus(rim, 0.0032, 120, 12),
        lathe(
            &[
                [0.0, -0.014],
                [0.004, -0.014],
                [0.011, -0.010],
                [0.006, -0.006],
                [0.006, 0.006],
                [0.011, 0.010],
                [0.004, 0.014],
                [0.0, 0.014],
            ],
            40,
        ),
    ]));
    let stand = DMat3::from_rotation_z(0.5) * DMat3::from_rotation_x(PI / 2.0 - 0.12);
    let place = dvec3(0.0, 0.0, 0.0897);
    let mut model = Model::default();
    model.push(metal.moved(stand, place), Material::metal([0.86, 0.87, 0.88], 0.12));
    let knobs = (0..90).map(|k| {
        let angle = TAU * f64::from(k) / 90.0;
        sphere(0.0022, 8).at(polar(angle, 0.0868, if k % 2 == 0 { 0.003 } else { -0.003 }))
    });
    let tyre = Mesh::joined([torus(0.0805, 0.0075, 120, 24)].into_iter().chain(knobs));
    model.push(tyre.moved(stand, place), Material::plastic([0.025, 0.025, 0.028], 0.5));
    let axle = stand * DVec3::Z;
    let legs = [-1.0, 1.0].map(|side| {
        let top = place + axle * (0.021 * side);
        let foot = dvec3(axle.x, axle.y, 0.0) * (0.06 * side);
        let across = dvec3(-axle.y, axle.x, 0.0).normalize() * 0.045;
        Mesh::joined([
            rod(foot + across + dvec3(0.0, 0.0, 0.003), top, 0.003, 12),
            rod(foot - across + dvec3(0.0, 0.0, 0.003), top, 0.003, 12),
        ])
    });
    let bar = rod(place - axle * 0.023, place + axle * 0.023, 0.0035, 14);
    model.push(Mesh::joined(legs.into_iter().chain([bar])), Material::plastic([0.06, 0.22, 0.55], 0.2));
    model
}
