//! Probes: every ray under a few more lights, most of which nobody photographed.
//!
//! Photographs teach a field the lights that stood there. Between them it may put thin shadows anywhere, and does. But
//! where a surface is, is soon known, and so is where the shadow of one thing falls on another: a shadow ray from the
//! surface to the light tells. What the surface should look like under a probe is imagined from its photographs under
//! lights nearby that reached it, darkened where the shadow ray is stopped by as much as shadows are in photographs.
//! Probes under lights that were photographed tell how much that is.
//!
//! Ours: the paper has nothing like it.

use rayon::prelude::*;
use relight_field::engine::{RayBatch, Rays};
use relight_field::sampling::Sampling;

use crate::march::{self, along};
use crate::samples::{Jitter, Marcher, SampleBatch};
use crate::shade::CodedLight;
use crate::tile::Workspace;

/// Samples of a shadow ray.
const SHADOW_SAMPLES: usize = 12;
/// Shadow rays a tile.
const TILE_RAYS: usize = 16;
/// Cells of the density grid between a surface and the start of its shadow rays, lest it shade itself.
const CLEARANCE: f32 = 1.5;
/// Pairs darker than this share of a ray's brightest may lie in shadow, and tell nothing of light.
const LIT: f32 = 0.6;
/// Lights count less by a factor e for each so much of `1 - cos(angle) + (relative distance)^2`: 14 degrees.
const NEARNESS: f32 = 0.03;
/// Nearness, summed over lights, of a colour that is as sure as any.
const SURE: f32 = 0.3;
/// Transmittance of a shadow ray below which a photograph shows what shadow looks like.
const DARK: f32 = 0.1;
/// Photographs of shadows that must have been seen before any is imagined.
const ENOUGH: f32 = 8.0;
/// Share that a step leaves of what was seen before.
const MEMORY: f32 = 0.999;

/// How bright shadows are beside the same place in the light, from photographs.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ShadowLevel {
    /// Sum of ratios, fading.
    pub sum: f32,
    /// Number of ratios, fading.
    pub count: f32,
}

impl ShadowLevel {
    /// The ratio, 0..1, if enough shadows were seen.
    pub fn ratio(self) -> Option<f32> {
        (self.count >= ENOUGH).then(|| (self.sum / self.count).clamp(0.0, 1.0))
    }

    /// Takes in the ratios of one step.
    pub fn observe(&mut self, sum: f64, count: f64) {
        self.sum = MEMORY * self.sum + sum as f32;
        self.count = MEMORY * self.count + count as f32;
    }
}

/// The probes of a batch.
pub struct Probes {
    /// `[n, probes]`: their lights.
    pub lights: Vec<CodedLight>,
    /// `[n, probes]`: share of each light that reaches its ray's surface, as the geometry has it.
    transmittance: Vec<f32>,
    /// How dark shadows are, where that is known.
    shadow: Option<f32>,
}

/// What a probe is compared with.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Wanted {
    /// The colour, sRGB in 0..1.
    pub colour: [f32; 3],
    /// How sure it is, 0..1.
    pub certainty: f32,
    /// Brightness beside the same place in the light, where a photograph shows shadow.
    pub shadow: Option<f32>,
}

impl Probes {
    /// Traces the shadow rays of a batch. `samples` are those of its rays, `shadows` is memory.
    pub fn trace(
        marcher: &Marcher<'_>,
        batch: &RayBatch,
        samples: &SampleBatch,
        lights: Vec<CodedLight>,
        level: ShadowLevel,
        shadows: &mut SampleBatch,
        jitter: Jitter,
    ) -> Self {
        let points = surfaces(marcher, &batch.rays, samples);
        let (each, mut transmittance) = (lights.len() / points.len().max(1), vec![1.0; lights.len()]);
        // Most see their light through empty cells: nothing has to be evaluated for those.
        let gap = CLEARANCE * marcher.density.cell_size();
        let stopped = |(probe, light): (usize, &CodedLight)| {
            let point = points[probe / each];
            let (direction, length) = toward(point, light.position);
            let (origin, length) = (along(point, direction, gap), (length - gap).max(0.0));
            let (near, far) = marcher.cube.clip(origin, direction);
            let span = (near, far.min(length));
            let clear = march::is_clear(marcher.density, &marcher.cube, (origin, direction), span);
            (!clear).then_some((origin, direction, length))
        };
        let found: Vec<_> = lights.par_iter().enumerate().with_min_len(32).map(stopped).collect();
        let (mut rays, mut lengths, mut shaded) = (Rays::default(), Vec::new(), Vec::new());
        for (i, (origin, direction, length)) in
            found.into_iter().enumerate().filter_map(|(i, f)| Some((i, f?)))
        {
            rays.origins.push(origin);
            rays.directions.push(direction);
            lengths.push(length);
            shaded.push(i);
        }
        let sampling = Sampling::Guided { samples: SHADOW_SAMPLES };
        shadows.fill(marcher, &rays, sampling, TILE_RAYS, jitter);
        let shadows = &*shadows;
        let (lengths, rays) = (&lengths, &rays);
        let stopped: Vec<f32> = (0..shadows.tiles(rays))
            .into_par_iter()
            .flat_map_iter(|tile| {
                marcher.workspaces.with(Workspace::default, |workspace| {
                    let here = shadows.tile(marcher, rays, tile);
                    workspace.composite(marcher.simd, marcher.networks, &here);
                    let through = |(r, ray): (usize, usize)| {
                        let span = r * here.samples..(r + 1) * here.samples;
                        let passed = here.t[span.clone()].iter().zip(&workspace.optical[span]);
                        let before_light = passed.filter(|(t, _)| **t < lengths[ray]);
                        // The last sample is the box's face, which shades nothing.
                        let optical: f32 = before_light.take(here.samples - 1).map(|(_, o)| o).sum();
                        (-optical).exp()
                    };
                    shadows.range(rays, tile).enumerate().map(through).collect::<Vec<f32>>()
                })
            })
            .collect();
        for (i, t) in shaded.into_iter().zip(stopped) {
            transmittance[i] = t;
        }
        Self { lights, transmittance, shadow: level.ratio() }
    }

    /// Adds the gradients of the probes of ray `ray`, which ends at `point`, to `gradients`: what it looks like under
    /// them, `colours`, against what it should, times `scale`. `photographed` are its colours there, NaN where there are
    /// none, `pairs` the positions of its other lights and the colours under them. Returns the sum and the number of
    /// ratios for [`ShadowLevel::observe`].
    pub fn compare(
        &self,
        (ray, point): (usize, [f32; 3]),
        colours: &[[f32; 3]],
        photographed: &[[f32; 3]],
        pairs: impl Iterator<Item = ([f32; 3], [f32; 3])> + Clone,
        scale: f32,
        gradients: &mut Vec<[f32; 3]>,
    ) -> (f64, f64) {
        let (mut sum, mut count) = (0.0, 0.0);
        let first = ray * colours.len();
        for (probe, (colour, &photographed)) in (first..).zip(colours.iter().zip(&photographed[first..])) {
            let wanted = self.wanted(probe, point, photographed, pairs.clone());
            gradients.push(wanted.map_or([0.0; 3], |wanted| {
                let weight = scale * wanted.certainty;
                std::array::from_fn(|c| weight * (colour[c] - wanted.colour[c]))
            }));
            if let Some(ratio) = wanted.and_then(|wanted| wanted.shadow) {
                sum += f64::from(ratio);
                count += 1.0;
            }
        }
        (sum, count)
    }

    /// What a ray, which ends at `point`, should look like under probe `probe` of the batch. `photographed` is its
    /// colour there, NaN where there is none; `pairs` are positions of lights and colours under them. `None` if nothing
    /// can be told.
    pub fn wanted(
        &self,
        probe: usize,
        point: [f32; 3],
        photographed: [f32; 3],
        pairs: impl Iterator<Item = ([f32; 3], [f32; 3])> + Clone,
    ) -> Option<Wanted> {
        let lit = lit_colour(point, self.lights[probe].position, pairs);
        let transmittance = self.transmittance[probe];
        if photographed.iter().all(|c| c.is_finite()) {
            // Where the photograph is as bright as it would be in the light, the shadow ray went astray.
            let shadow = lit
                .filter(|&(lit, certainty)| transmittance < DARK && certainty >= 0.5 && brightness(lit) > 0.0)
                .map(|(lit, _)| brightness(photographed) / brightness(lit))
                .filter(|&ratio| ratio < LIT);
            return Some(Wanted { colour: photographed, certainty: 1.0, shadow });
        }
        let (lit, certainty) = lit?;
        let shadow = self.shadow?;
        let share = shadow + (1.0 - shadow) * transmittance;
        Some(Wanted { colour: lit.map(|c| c * share), certainty, shadow: None })
    }
}

/// Where the rays of a batch end, world frame.
fn surfaces(marcher: &Marcher<'_>, rays: &Rays, samples: &SampleBatch) -> Vec<[f32; 3]> {
    (0..samples.tiles(rays))
        .into_par_iter()
        .flat_map_iter(|tile| {
            marcher.workspaces.with(Workspace::default, |workspace| {
                let here = samples.tile(marcher, rays, tile);
                workspace.composite(marcher.simd, marcher.networks, &here);
                let ends = here.origins.iter().zip(here.directions).zip(&workspace.depths);
                ends.map(|((&o, &d), &depth)| along(o, d, depth)).collect::<Vec<_>>()
            })
        })
        .collect()
}

/// Colour of a point in the light of a lamp at `light`, from its colours under others that seem to have reached it, and
/// how sure that is, 0..1; `None` without any.
fn lit_colour(
    point: [f32; 3],
    light: [f32; 3],
    pairs: impl Iterator<Item = ([f32; 3], [f32; 3])> + Clone,
) -> Option<([f32; 3], f32)> {
    let brightest = pairs.clone().map(|(_, colour)| brightness(colour)).fold(0.0, f32::max);
    let (direction, length) = toward(point, light);
    let (mut sum, mut total) = ([0.0; 3], 0.0);
    for (position, colour) in pairs {
        if brightness(colour) < LIT * brightest {
            continue;
        }
        let (other, distance) = toward(point, position);
        let cos: f32 = direction.iter().zip(other).map(|(a, b)| a * b).sum();
        let nearness = (-(1.0 - cos + (distance / length - 1.0).powi(2)) / NEARNESS).exp();
        total += nearness;
        sum.iter_mut().zip(colour).for_each(|(s, c)| *s += nearness * c);
    }
    (total > 1e-9).then(|| (sum.map(|s| s / total), (total / SURE).min(1.0)))
}

fn brightness(colour: [f32; 3]) -> f32 {
    colour.iter().sum()
}

/// Unit direction and distance from one point to another.
fn toward(from: [f32; 3], to: [f32; 3]) -> ([f32; 3], f32) {
    let way: [f32; 3] = std::array::from_fn(|a| to[a] - from[a]);
    let length = way.iter().map(|v| v * v).sum::<f32>().sqrt().max(1e-6);
    (way.map(|v| v / length), length)
}

#[cfg(test)]
mod tests {
    use super::*;

    const POINT: [f32; 3] = [0.1, 0.2, 0.0];
    const UNKNOWN: [f32; 3] = [f32::NAN; 3];

    fn probes(transmittance: f32, shadow: Option<f32>) -> Probes {
        let lights = vec![CodedLight { position: [0.1, 0.2, 0.5], code: Vec::new() }];
        Probes { lights, transmittance: vec![transmittance], shadow }
    }

    /// Two lights as far from the probe's on either side, a dark one in between, and one far away.
    fn pairs() -> impl Iterator<Item = ([f32; 3], [f32; 3])> + Clone {
        [
            ([0.15, 0.2, 0.5], [0.8, 0.6, 0.4]),
            ([0.05, 0.2, 0.5], [0.6, 0.4, 0.2]),
            ([0.1, 0.2, 0.5], [0.1, 0.1, 0.1]),
            ([0.1, 9.0, 0.5], [0.5, 0.5, 0.5]),
        ]
        .into_iter()
    }

    fn close(a: [f32; 3], b: [f32; 3]) -> bool {
        a.iter().zip(b).all(|(a, b)| (a - b).abs() < 1e-4)
    }

    #[test]
    fn colours_in_the_light_lie_between_those_of_lights_nearby() {
        let wanted = probes(1.0, Some(0.3)).wanted(0, POINT, UNKNOWN, pairs()).unwrap();
        assert!(close(wanted.colour, [0.7, 0.5, 0.3]), "{wanted:?}");
        assert_eq!((wanted.certainty, wanted.shadow), (1.0, None));
    }

    #[test]
    fn shadows_are_as_dark_as_photographed_ones() {
        let wanted = probes(0.0, Some(0.3)).wanted(0, POINT, UNKNOWN, pairs()).unwrap();
        assert!(close(wanted.colour, [0.21, 0.15, 0.09]), "{wanted:?}");
        let half = probes(0.5, Some(0.3)).wanted(0, POINT, UNKNOWN, pairs()).unwrap();
        assert!(close(half.colour, [0.455, 0.325, 0.195]), "{half:?}");
    }

    #[test]
    fn nothing_is_imagined_without_knowing_shadows_or_lights_nearby() {
        assert_eq!(probes(0.0, None).wanted(0, POINT, UNKNOWN, pairs()), None);
        assert_eq!(probes(0.0, Some(0.3)).wanted(0, POINT, UNKNOWN, std::iter::empty()), None);
        let far = pairs().skip(3);
        assert!(probes(0.0, Some(0.3)).wanted(0, POINT, UNKNOWN, far).is_none_or(|w| w.certainty < 0.01));
    }

    #[test]
    fn photographs_are_taken_as_they_are_and_tell_of_shadows() {
        let photograph = [0.35, 0.25, 0.15];
        let lit = probes(1.0, None).wanted(0, POINT, photograph, pairs()).unwrap();
        assert_eq!((lit.colour, lit.certainty, lit.shadow), (photograph, 1.0, None));
        let dark = probes(0.0, None).wanted(0, POINT, photograph, pairs()).unwrap();
        assert!((dark.shadow.unwrap() - 0.5).abs() < 1e-4, "{dark:?}");
        let astray = probes(0.0, None).wanted(0, POINT, [0.65, 0.45, 0.3], pairs()).unwrap();
        assert_eq!(astray.shadow, None);
    }

    #[test]
    fn the_shadow_level_waits_and_forgets() {
        let mut level = ShadowLevel::default();
        level.observe(2.0, 4.0);
        assert_eq!(level.ratio(), None);
        level.observe(2.1, 4.1);
        assert!((level.ratio().unwrap() - 0.506).abs() < 1e-3);
        for _ in 0..5000 {
            level.observe(0.25, 1.0);
        }
        assert!((level.ratio().unwrap() - 0.25).abs() < 0.01);
    }
}
