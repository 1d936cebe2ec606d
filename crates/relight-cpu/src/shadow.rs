//! Shadow rays: how much of a light reaches a surface through the learnt geometry, and what it meets on the way.

use relight_field::engine::Rays;
use relight_field::sampling::Sampling;

use crate::march::along;
use crate::samples::{Jitter, Marcher, SampleBatch};
use crate::shade::CodedLight;
use crate::stages::{Clock, Stage};
use crate::tile::Workspace;

/// Samples of a shadow ray.
const SAMPLES: usize = 6;
/// Shadow rays a tile.
const TILE_RAYS: usize = 32;
/// Cells of the density grid between a surface and the start of its shadow rays, lest it shade itself.
const CLEARANCE: f32 = 1.5;
/// Transmittances from which on shadows are of another class.
const PASSING: [f32; 3] = [0.1, 0.5, 0.9];
/// Cells of the density grid between the start of a shadow ray and what it meets, from which on that is of another class: what is
/// nearer than the first leaves nine tenths of a colour, what is further than the second half (docs/trials.md).
const AWAY: [f32; 2] = [6.0, 24.0];
/// Transmittance above which a place is as good as lit.
const LIGHT: f32 = 0.99;

/// What a shadow ray met.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Shadow {
    /// Share of the light that passes, as the geometry has it.
    pub transmittance: f32,
    /// How far from the ray's start what lies on its way is, the mean by optical depth, cells of the density grid.
    pub away: f32,
}

impl Shadow {
    /// Of a ray that met nothing.
    pub const NONE: Self = Self { transmittance: 1.0, away: 0.0 };
    /// Number of [classes](Self::class).
    pub const CLASSES: usize = 1 + (PASSING.len() + 1) * (AWAY.len() + 1);

    /// Shadows of one class are about as likely to be real: what stops a ray near its start often is the surface itself,
    /// not quite where it should be. Class 0 is light.
    pub fn class(self) -> usize {
        if self.transmittance > LIGHT {
            return 0;
        }
        let passing = PASSING.iter().filter(|&&limit| self.transmittance >= limit).count();
        let away = AWAY.iter().filter(|&&limit| self.away >= limit).count();
        1 + passing * (AWAY.len() + 1) + away
    }
}

/// Sends shadow rays from `points`, world positions in metres, to `lights`, as many from each and those of one point after
/// the other, and returns what each met. `memory` is reused, `clock` told what it took.
pub fn trace(
    marcher: &Marcher<'_>,
    points: &[[f32; 3]],
    lights: &[CodedLight],
    memory: &mut SampleBatch,
    jitter: Jitter,
    clock: &mut Clock,
) -> Vec<Shadow> {
    let (each, mut shadows) = (lights.len() / points.len().max(1), vec![Shadow::NONE; lights.len()]);
    let cell = marcher.density.cell_size();
    let gap = CLEARANCE * cell;
    let shadow_rays: Vec<_> = lights
        .iter()
        .enumerate()
        .map(|(number, light)| {
            let point = points[number / each];
            let (direction, length) = toward(point, light.position);
            ((along(point, direction, gap), direction), (length - gap).max(0.0))
        })
        .collect();
    let spans = shadow_rays.iter().map(|&(ray, length)| {
        let (near, far) = marcher.cube.clip(ray.0, ray.1);
        (ray, (near, far.min(length)))
    });
    // Most see their light through empty cells: nothing has to be evaluated for those.
    let (mut rays, mut lengths, mut shaded) = (Rays::default(), Vec::new(), Vec::new());
    for (number, clear) in marcher.guide().are_clear(spans).enumerate() {
        let ((origin, direction), length) = shadow_rays[number];
        if !clear {
            rays.origins.push(origin);
            rays.directions.push(direction);
            lengths.push(length);
            shaded.push(number);
        }
    }
    clock.lap(Stage::ShadowLook, 0);
    let sampling = Sampling::Guided { samples: SAMPLES };
    memory.fill(marcher, &rays, sampling, TILE_RAYS.min(shaded.len()).max(1), jitter);
    clock.count(Stage::ShadowMarch, &memory.marched);
    clock.count(Stage::ShadowEncode, &memory.encoded);
    marcher.workspaces.with(Workspace::default, |workspace| {
        for tile in 0..memory.tiles(&rays) {
            let here = memory.tile(marcher, &rays, tile);
            workspace.densities(marcher.simd, marcher.networks, here.features, here.columns);
            for (r, ray) in memory.range(&rays, tile).enumerate() {
                let span = r * here.samples..(r + 1) * here.samples;
                let steps = workspace.density[span.clone()].iter().zip(&here.lengths[span.clone()]);
                let before_light = here.t[span].iter().zip(steps).filter(|(t, _)| **t < lengths[ray]);
                // The last sample is the box's face, which shades nothing.
                let passed = before_light.take(here.samples - 1);
                let (origin, direction) = (rays.origins[ray], rays.directions[ray]);
                // What the field holds elsewhere is chance.
                let known = passed.filter(|(t, _)| marcher.has_in_view(along(origin, direction, **t)));
                let (mut optical, mut distances) = (0.0, 0.0);
                for (t, (density, length)) in known {
                    optical += density * length;
                    distances += density * length * t;
                }
                let away = distances / (optical * cell).max(f32::MIN_POSITIVE);
                shadows[shaded[ray]] = Shadow { transmittance: (-optical).exp(), away };
            }
        }
    });
    let columns = memory.t.len();
    clock.lap(Stage::ShadowGeometry, marcher.networks.geo.density_operations(columns));
    shadows
}

/// Unit direction and distance from one point to another, both in metres.
pub fn toward(from: [f32; 3], to: [f32; 3]) -> ([f32; 3], f32) {
    let way: [f32; 3] = std::array::from_fn(|a| to[a] - from[a]);
    let length = way.iter().map(|v| v * v).sum::<f32>().sqrt().max(1e-6);
    (way.map(|v| v / length), length)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_class_is_of_some_shadow_and_light_is_the_first() {
        let passing = [0.0, 0.05, 0.1, 0.3, 0.5, 0.7, 0.9, 0.95, 0.99];
        let away = [0.0, 5.9, 6.0, 20.0, 24.0, 900.0];
        let shadows =
            passing.iter().flat_map(|&transmittance| away.map(|away| Shadow { transmittance, away }));
        let classes: Vec<usize> = shadows.map(Shadow::class).collect();
        let mut found = classes.clone();
        found.sort_unstable();
        found.dedup();
        assert_eq!(found, (1..Shadow::CLASSES).collect::<Vec<_>>());
        assert!(classes.is_sorted_by_key(|class| (class - 1) / 3), "more light, a later class: {classes:?}");
        let numbers =
            [(0.0, 0.0), (0.099, 5.99), (0.099, 6.0), (0.1, 0.0), (0.5, 24.0), (0.9, 23.9), (0.99, 24.0)];
        let numbers = numbers.map(|(transmittance, away)| Shadow { transmittance, away }.class());
        assert_eq!(numbers, [1, 1, 2, 4, 9, 11, 12]);
        assert_eq!(Shadow::NONE.class(), 0);
        assert_eq!(Shadow { transmittance: 0.991, away: 30.0 }.class(), 0);
    }
}
