mod partition;
mod picture;
mod plan;
mod waypoints;

use std::f64::consts::{PI, TAU};

use proptest::prelude::*;

use super::{PlanSettings, Region};

/// A region in degrees.
fn region(colatitude: [f64; 2], azimuth: [f64; 2]) -> Region {
    Region::new(colatitude.map(f64::to_radians), azimuth.map(f64::to_radians)).unwrap()
}

/// Regions of every kind: thin and wide, with a pole and without, wedges and whole circles.
fn any_region() -> impl Strategy<Value = Region> {
    let range = |most: f64| {
        let thin = (0.0..1.0f64, -5.0..0.0f64).prop_map(|(at, exponent)| (at, 10f64.powf(exponent)));
        prop_oneof![(0.0..0.9f64, 0.01..1.0f64), thin].prop_map(move |(at, share)| {
            let lo = at * most * (1.0 - 1e-5);
            [lo, (lo + share * most).min(most)]
        })
    };
    let colatitude = prop_oneof![
        3 => range(PI),
        1 => (0.01..PI).prop_map(|hi| [0.0, hi]),
        1 => (0.0..3.1f64).prop_map(|lo| [lo, PI]),
        1 => Just([0.0, PI]),
    ];
    let azimuth = prop_oneof![
        2 => (range(TAU), -TAU..TAU).prop_map(|([lo, hi], turn)| [lo + turn, hi + turn]),
        1 => (-TAU..TAU).prop_map(|lo| [lo, lo + TAU]),
    ];
    (colatitude, azimuth).prop_map(|(colatitude, azimuth)| Region::new(colatitude, azimuth).unwrap())
}

/// The paper's rig, smaller.
fn small() -> PlanSettings {
    let mut settings = PlanSettings::default();
    settings.camera.waypoints = 12;
    settings.light.waypoints = 9;
    settings
}
