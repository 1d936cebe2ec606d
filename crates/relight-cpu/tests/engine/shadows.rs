//! Shadow rays against closed forms.

use fearless_simd::Level;
use relight_cpu::density_grid::DensityGrid;
use relight_cpu::march::along;
use relight_cpu::samples::{Jitter, Marcher, SampleBatch};
use relight_cpu::shade::CodedLight;
use relight_cpu::shadow::{self, Shadow};
use relight_cpu::stages::Clock;
use relight_cpu::tile::Workspace;
use relight_field::architecture::V5;
use relight_field::engine::{LightPose, Rays};
use relight_field::random::Random;
use relight_field::sampling::Sampling;
use relight_scene::Frustum;

use crate::common::*;

/// Density of a field whose features are all zero: that of logit zero.
const FOG: f32 = 2.0;

/// Parts of an engine whose field is fog, with a density grid of so many cells an axis that knows of `density`.
fn fog(cells: usize, density: f32) -> Parts {
    let mut parameters = field(V5);
    parameters.table.fill(0.0);
    let grid = DensityGrid::uniform(&BOUNDS, cells, density);
    Parts { density: grid, ..Parts::new(&parameters) }
}

/// Traces the shadow rays to lights from where one or two rays end.
fn transmittance(marcher: &Marcher<'_>, rays: &Rays, lights: &[CodedLight]) -> Vec<f32> {
    let (mut samples, jitter) = (SampleBatch::default(), Jitter(Some(Random::new(1, 0))));
    samples.fill(marcher, rays, Sampling::Guided { samples: 200 }, 2, jitter);
    let mut workspace = Workspace::default();
    workspace.look(marcher.simd, marcher.networks, &samples.tile(marcher, rays, 0));
    let ends = rays.origins.iter().zip(&rays.directions).zip(&workspace.depths);
    let points: Vec<_> = ends.map(|((&o, &d), &depth)| along(o, d, depth)).collect();
    from_points(marcher, &points, lights)
}

/// Traces the shadow rays to lights from points, as many from each.
fn from_points(marcher: &Marcher<'_>, points: &[[f32; 3]], lights: &[CodedLight]) -> Vec<f32> {
    shadows(marcher, points, lights).into_iter().map(|shadow| shadow.transmittance).collect()
}

/// The same, with all that they meet.
fn shadows(marcher: &Marcher<'_>, points: &[[f32; 3]], lights: &[CodedLight]) -> Vec<Shadow> {
    let (mut memory, jitter) = (SampleBatch::default(), Jitter(Some(Random::new(1, 0))));
    shadow::trace(marcher, points, lights, &mut memory, jitter, &mut Clock::default())
}

/// A light at a place.
fn lamp([x, y, z]: [f32; 3]) -> LightPose {
    LightPose([1.0, 0.0, 0.0, x, 0.0, 1.0, 0.0, y, 0.0, 0.0, 1.0, z])
}

/// Share of a lamp that passes through fog to where a ray ends, and the height of that place.
fn through_fog(density: f32, lamp: [f32; 3]) -> (f32, f32) {
    let parts = fog(16, density);
    let marcher = parts.marcher(Level::new());
    // Straight down, into the fog as far as it goes on average.
    let mut rays = Rays::default();
    rays.origins.push([0.1, 0.1, 1.2]);
    rays.directions.push([0.0, 0.0, -1.0]);
    let depth = 0.5 + (1.0 - (-FOG * 0.7f32).exp()) / FOG;
    let point = [0.1, 0.1, 1.2 - depth];
    let light = coded(&[self::lamp(lamp)]);
    (transmittance(&marcher, &rays, &light)[0], point[2])
}

#[test]
fn fog_between_a_surface_and_a_lamp_dims_it() {
    // Shadow rays start one and a half cells of the density grid away from the surface.
    let gap = 1.5 * 0.7 / 16.0;
    // A lamp above the box: the fog ends at its roof.
    let (arrived, height) = through_fog(FOG, [0.1, 0.1, 3.0]);
    let expected = FOG * (0.7 - height - gap);
    assert!((-arrived.ln() / expected - 1.0).abs() < 0.1, "{} {expected}", -arrived.ln());
    // A lamp inside it: only what lies before it counts.
    let (arrived, height) = through_fog(FOG, [0.1, 0.1, 0.5]);
    let expected = FOG * (0.5 - height - gap);
    assert!((-arrived.ln() / expected - 1.0).abs() < 0.2, "{} {expected}", -arrived.ln());
}

#[test]
fn nothing_dims_a_lamp_where_the_density_grid_knows_of_nothing() {
    assert_eq!(through_fog(0.0, [0.1, 0.1, 3.0]).0, 1.0);
}

/// Even fog lies on a ray's way, in the mean, half way to where it ends, or to where no camera looks any more.
#[test]
fn shadows_know_how_far_away_they_are_cast() {
    let mut parts = fog(64, FOG);
    let cell = parts.density.cell_size();
    let light = coded(&[lamp([0.1, 0.1, 3.0])]);
    let met =
        |parts: &Parts, height: f32| shadows(&parts.marcher(Level::new()), &[[0.1, 0.1, height]], &light)[0];
    // The last of its six samples, at the box's face, shades nothing, so the end counts a little less.
    for height in [0.1, 0.4] {
        let (met, expected) = (met(&parts, height), 0.5 * (0.7 - height) / cell - 0.75);
        assert!((0.8..1.0).contains(&(met.away / expected)), "{met:?} {expected}");
    }
    assert_eq!(met(&parts, 0.9), Shadow::NONE);
    // In view up to 0.55 m.
    parts.density.hide_unseen(&parts.cube, &[view([-3.0, 0.1, 0.3], [0.1, 0.1, 0.3], 0.25 / 3.1)]);
    let (met, expected) = (met(&parts, 0.1), 0.5 * 0.45 / cell - 0.75);
    assert!((0.8..1.2).contains(&(met.away / expected)), "{met:?} {expected}");
}

/// Fog that no camera has in view: one looks from the side, up to 0.55 m there where the lamp shines down.
#[test]
fn what_no_photograph_shows_dims_nothing() {
    let point = [0.1, 0.1, 0.3];
    let fog_above = |views: &[Frustum]| {
        let mut parts = fog(16, FOG);
        parts.density.hide_unseen(&parts.cube, views);
        let arrived = from_points(&parts.marcher(Level::new()), &[point], &coded(&[lamp([0.1, 0.1, 3.0])]));
        -arrived[0].ln() / FOG
    };
    let [ahead, up] = [[0.1, 0.1, 0.3], [-3.0, 0.1, 9.0]].map(|at| view([-3.0, 0.1, 0.3], at, 0.25 / 3.1));
    let start = 0.3 + 1.5 * 0.7 / 16.0;
    // A cell counts as in view if a sphere around it is.
    let cell = 0.7 / 16.0;
    let seen = fog_above(&[up, ahead]);
    assert!((0.55 - cell..0.55 + 2.0 * cell).contains(&(start + seen)), "{seen}");
    assert_eq!(fog_above(&[up]), 0.0);
}

/// Two rays that end at different heights, each with a lamp just below the roof and one far above.
#[test]
fn every_probe_of_a_ray_has_a_shadow_ray_of_its_own() {
    let parts = fog(16, FOG);
    let marcher = parts.marcher(Level::new());
    let mut rays = Rays::default();
    // Down from the roof, and from one side to the other at a height of 0.5 m.
    rays.origins.extend([[0.1, 0.1, 1.2], [-1.0, 0.1, 0.5]]);
    rays.directions.extend([[0.0, 0.0, -1.0], [1.0, 0.0, 0.0]]);
    let points =
        [[0.1, 0.1, 0.7 - (1.0 - (-FOG * 0.7f32).exp()) / FOG], [(1.0 - (-FOG).exp()) / FOG - 0.5, 0.1, 0.5]];
    let heights = [0.6, 3.0];
    let lamps = points.iter().flat_map(|p| heights.map(|z| [p[0], p[1], z]));
    let poses: Vec<_> = lamps.map(lamp).collect();
    let transmittance = transmittance(&marcher, &rays, &coded(&poses));
    let gap = 1.5 * 0.7 / 16.0;
    for (probe, pose) in poses.iter().enumerate() {
        let point = points[probe / 2];
        let arrived = transmittance[probe];
        let expected = FOG * (pose.position()[2].min(0.7) - point[2] - gap);
        assert!((-arrived.ln() - expected).abs() < 0.06, "{probe}: {} {expected}", -arrived.ln());
    }
}
