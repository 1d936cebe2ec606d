//! Pictures whose every value is known.

use std::f64::consts::PI;

use glam::{DVec3, dvec3};

use super::super::{Filter, Material, Model, Settings, shapes};
use super::{camera, floor, light, rig, settings, white_lamp};

#[test]
fn a_matt_plane_follows_the_law_of_irradiance() {
    let colour = [0.8, 0.5, 0.2];
    let model = floor(2.0, Material::matt(colour));
    let view = camera(dvec3(0.1, -0.3, 0.5), DVec3::ZERO, [24, 18], 2400.0);
    let place = dvec3(0.12, 0.07, 0.35);
    // A sphere gives what a point gives, whole above the horizon: I cos / d^2, at 5 mm as at 50.
    for (radius, tolerance) in [(0.0, 1e-5), (0.005, 1e-4), (0.05, 2e-3)] {
        let picture = &rig(&model, white_lamp(radius), settings(64)).radiance(&view, &[light(3, place)])[0];
        for (x, y) in [(0, 0), (23, 17), (11, 9), (3, 14)] {
            let ray = DVec3::from_array(view.pose.rotate(view.intrinsics.unproject(x.into(), y.into())));
            let eye = DVec3::from_array(view.pose.position());
            let to_lamp = place - (eye - ray * (eye.z / ray.z));
            let irradiance = to_lamp.z / to_lamp.length().powi(3);
            for (k, value) in picture.at(x, y).into_iter().enumerate() {
                let expected = f64::from(colour[k]) / PI * irradiance;
                assert!((value / expected - 1.0).abs() < tolerance, "{radius} {x} {y}: {value} {expected}");
            }
        }
    }
}

#[test]
fn one_bounce_inside_a_matt_sphere_adds_its_albedo() {
    let albedo = 0.6;
    let mut model = Model::default();
    model.push(shapes::sphere(0.5, 192), Material::matt([albedo; 3]));
    let view = camera(dvec3(0.1, 0.0, 0.05), dvec3(0.2, 0.4, 0.0), [8, 8], 8.0);
    let direct = f64::from(albedo) / PI / 0.25;
    // Radiance on the wall is the same everywhere, so one bounce gives albedo times it, whichever way it goes.
    for share in [1, 3] {
        let settings = Settings { bounce_share: share, ..settings(64) };
        let picture = &rig(&model, white_lamp(0.01), settings).radiance(&view, &[light(7, DVec3::ZERO)])[0];
        let (mean, expected) = (picture.mean(1), direct * (1.0 + f64::from(albedo)));
        assert!((mean / expected - 1.0).abs() < 2e-3, "{share}: {mean} {expected}");
    }
}

#[test]
fn light_through_a_thin_sheet_is_its_transmittance() {
    let mut model = Model::default();
    let sheet = Material::Translucent { reflectance: [0.3; 3].into(), transmittance: [0.4; 3].into() };
    model.push(shapes::quad(dvec3(-1.0, 1.0, 0.0), DVec3::X * 2.0, DVec3::NEG_Y * 2.0), sheet);
    let lamp = light(0, dvec3(0.0, 0.0, 0.4));
    for (side, share) in [(1.0, 0.3), (-1.0, 0.4)] {
        let view = camera(dvec3(0.0, -0.01, 0.5 * side), DVec3::ZERO, [3, 3], 3000.0);
        let value = rig(&model, white_lamp(0.0), settings(16)).radiance(&view, std::slice::from_ref(&lamp))
            [0]
        .at(1, 1)[0];
        let expected = share / PI / 0.16;
        assert!((value / expected - 1.0).abs() < 1e-4, "{side}: {value} {expected}");
    }
}

/// A floor in the shadow of a plate at height `h` that covers x < 0, under a lamp at height `H`, x = `lamp_x`.
fn shadow_row(radius: f64, filter: Filter) -> (Vec<f64>, f64, f64) {
    let (height, lamp_height, lamp_x) = (0.1, 0.4, 0.013);
    let mut model = floor(2.0, Material::matt([0.5; 3]));
    model.push(shapes::quad(dvec3(-1.0, 0.5, height), DVec3::X, DVec3::NEG_Y), Material::matt([0.0; 3]));
    // From below the plate's height, looking at the edge of its shadow: nothing stands before it.
    let edge = lamp_x + (0.0 - lamp_x) * lamp_height / (lamp_height - height);
    let view = camera(dvec3(edge + 0.3, 0.0, 0.06), dvec3(edge, 0.0, 0.0), [41, 41], 4000.0);
    let settings = Settings { filter, ..settings(256) };
    let picture = &rig(&model, white_lamp(radius), settings)
        .radiance(&view, &[light(0, dvec3(lamp_x, 0.0, lamp_height))])[0];
    // The camera looks along -x: rows show lines of constant x.
    let rows = (0..41).map(|y| {
        let row: f64 = (0..41).map(|x| picture.at(x, y)[0]).sum();
        row / 41.0
    });
    let at = |y: f64| {
        let ray = view.pose.rotate(view.intrinsics.unproject(20.0, y));
        edge + 0.3 - ray[0] * 0.06 / ray[2]
    };
    (rows.collect(), at(20.0) - edge, (at(21.0) - at(19.0)) / 2.0)
}

#[test]
fn shadow_edges_lie_where_they_belong() {
    for filter in [Filter::Box, Filter::Tent] {
        let (rows, offset, step) = shadow_row(0.0, filter);
        assert!(offset.abs() < 1e-9 && step > 0.0);
        let lit = rows[40];
        // Rows from dark to bright: their sum tells where the edge is, in rows.
        let bright: f64 = rows.iter().map(|r| r / lit).sum();
        assert!(rows[0] < 0.01 * lit, "{rows:?}");
        // 20.5 rows lie beyond the edge. Brightness itself changes little over them.
        assert!((bright - 20.5).abs() < 0.05, "{bright}");
    }
}

#[test]
fn penumbrae_are_the_covered_share_of_the_lamp() {
    let radius = 0.005;
    let (rows, _, step) = shadow_row(radius, Filter::Box);
    // Seen from the floor, the plate's edge passes over the lamp's disc: half a penumbra is r h / (H - h) wide.
    let half = radius * 0.1 / 0.3;
    for (y, &row) in rows.iter().enumerate() {
        let t = ((y as f64 - 20.0) * step / half).clamp(-1.0, 1.0);
        let share = 0.5 + (t * (1.0 - t * t).sqrt() + t.asin()) / PI;
        let lit = row / rows[40];
        assert!((lit - share).abs() < 0.02, "row {y}: {lit} {share}");
    }
}
