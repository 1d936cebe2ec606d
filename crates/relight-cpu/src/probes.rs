//! Probes: every ray under a few more lights, most of which nobody photographed.
//!
//! Photographs teach a field the lights that stood there. Between them it may put thin shadows anywhere, and does. But
//! where a surface is, is soon known, and so is where the shadow of one thing falls on another: a shadow ray from the
//! surface to the light tells. What the surface should look like under a probe is imagined from its photographs under
//! lights nearby that reached it, darkened where the shadow ray is stopped by as much as shadows are in photographs.
//! Probes under lights that were photographed tell how much that is, and how far what is imagined can be trusted: see
//! [`crate::experience`].
//!
//! Ours: the paper has nothing like it.

use relight_field::engine::Rays;
use relight_field::sampling::Sampling;

use crate::experience::Seen;
use crate::march::along;
use crate::samples::{Jitter, Marcher, SampleBatch};
use crate::shade::CodedLight;
use crate::stages::{Clock, Stage};
use crate::tile::Workspace;

/// Samples of a shadow ray.
const SHADOW_SAMPLES: usize = 6;
/// Shadow rays a tile.
const TILE_RAYS: usize = 32;
/// Cells of the density grid between a surface and the start of its shadow rays, lest it shade itself.
const CLEARANCE: f32 = 1.5;
/// Pairs darker than this share of a ray's brightest may lie in shadow, and tell nothing of light.
const LIT: f32 = 0.6;
/// Lights count less by a factor e for each so much of `1 - cos(angle) + (relative distance)^2`: 14 degrees.
const NEARNESS: f32 = 0.03;
/// Nearness, summed over lights, of a colour that is as sure as any.
const SURE: f32 = 0.3;
/// Transmittance of a shadow ray above which a place is as good as lit.
const LIGHT: f32 = 0.99;
/// Transmittance of a shadow ray below which a photograph shows what shadow looks like.
const DARK: f32 = 0.1;

/// The probes of a tile.
pub struct Probes<'a> {
    /// `[n, probes]`: their lights.
    pub lights: &'a [CodedLight],
    /// `[n, probes]`: share of each light that reaches its ray's surface, as the geometry has it.
    pub transmittance: Vec<f32>,
    /// How dark shadows are, where that is known.
    shadow: Option<f32>,
}

/// How a point looks under a light that seems to have reached it.
struct Photograph {
    /// Unit vector to the light.
    direction: [f32; 3],
    /// How far the light is, metres.
    distance: f32,
    /// sRGB in 0..1.
    colour: [f32; 3],
}

/// A colour that nobody photographed.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Imagined {
    /// sRGB in 0..1.
    colour: [f32; 3],
    /// How sure it is, 0..1.
    certainty: f32,
}

impl<'a> Probes<'a> {
    /// Traces the shadow rays to `lights` from `points`, where the rays of a tile end: as many from each. `shadow` is how
    /// dark shadows are, `shadows` is memory.
    pub fn trace(
        marcher: &Marcher<'_>,
        points: &[[f32; 3]],
        lights: &'a [CodedLight],
        shadow: Option<f32>,
        shadows: &mut SampleBatch,
        jitter: Jitter,
        clock: &mut Clock,
    ) -> Self {
        let (each, mut transmittance) = (lights.len() / points.len().max(1), vec![1.0; lights.len()]);
        // Most see their light through empty cells: nothing has to be evaluated for those.
        let gap = CLEARANCE * marcher.density.cell_size();
        let shadow_rays: Vec<_> = lights
            .iter()
            .enumerate()
            .map(|(probe, light)| {
                let point = points[probe / each];
                let (direction, length) = toward(point, light.position);
                ((along(point, direction, gap), direction), (length - gap).max(0.0))
            })
            .collect();
        let spans = shadow_rays.iter().map(|&(ray, length)| {
            let (near, far) = marcher.cube.clip(ray.0, ray.1);
            (ray, (near, far.min(length)))
        });
        let (mut rays, mut lengths, mut shaded) = (Rays::default(), Vec::new(), Vec::new());
        for (probe, clear) in marcher.guide().are_clear(spans).enumerate() {
            let ((origin, direction), length) = shadow_rays[probe];
            if !clear {
                rays.origins.push(origin);
                rays.directions.push(direction);
                lengths.push(length);
                shaded.push(probe);
            }
        }
        clock.lap(Stage::ShadowLook, 0);
        let sampling = Sampling::Guided { samples: SHADOW_SAMPLES };
        shadows.fill(marcher, &rays, sampling, TILE_RAYS.min(shaded.len()).max(1), jitter);
        clock.count(Stage::ShadowMarch, &shadows.marched);
        clock.count(Stage::ShadowEncode, &shadows.encoded);
        marcher.workspaces.with(Workspace::default, |workspace| {
            for tile in 0..shadows.tiles(&rays) {
                let here = shadows.tile(marcher, &rays, tile);
                workspace.densities(marcher.simd, marcher.networks, here.features, here.columns);
                for (r, ray) in shadows.range(&rays, tile).enumerate() {
                    let span = r * here.samples..(r + 1) * here.samples;
                    let steps = workspace.density[span.clone()].iter().zip(&here.lengths[span.clone()]);
                    let before_light = here.t[span].iter().zip(steps).filter(|(t, _)| **t < lengths[ray]);
                    // The last sample is the box's face, which shades nothing.
                    let passed = before_light.take(here.samples - 1);
                    let (origin, direction) = (rays.origins[ray], rays.directions[ray]);
                    // What the field holds elsewhere is chance.
                    let known = passed.filter(|(t, _)| marcher.has_in_view(along(origin, direction, **t)));
                    let optical: f32 = known.map(|(_, (density, length))| density * length).sum();
                    transmittance[shaded[ray]] = (-optical).exp();
                }
            }
        });
        let columns = shadows.t.len();
        clock.lap(Stage::ShadowGeometry, marcher.networks.geo.density_operations(columns));
        Self { lights, transmittance, shadow }
    }

    /// Adds the gradients of the probes of the tile's ray `ray`, which ends at `point`, to `gradients`: what it looks like under
    /// them, `colours`, against what it should, times `scale`. `photographed` are its colours there, NaN where there are
    /// none, `pairs` the positions of its other lights and the colours under them. What the photographs tell is added to
    /// `shadow` and `imagined`, see [`Experience`](crate::experience::Experience).
    #[allow(clippy::too_many_arguments)]
    pub fn compare(
        &self,
        (ray, point): (usize, [f32; 3]),
        colours: &[[f32; 3]],
        photographed: &[[f32; 3]],
        pairs: impl Iterator<Item = ([f32; 3], [f32; 3])> + Clone,
        scale: f32,
        gradients: &mut Vec<[f32; 3]>,
        (shadow, imagined): (&mut Seen, &mut Seen),
    ) {
        let (first, lit) = (ray * colours.len(), in_light(point, pairs));
        for (probe, (colour, &photographed)) in (first..).zip(colours.iter().zip(photographed)) {
            let known = photographed.iter().all(|c| c.is_finite());
            let lit = lit_colour(point, self.lights[probe].position, &lit);
            let guess = lit.and_then(|lit| self.imagine(probe, lit));
            if known {
                if let Some(ratio) = lit.and_then(|lit| self.shadow_ratio(probe, lit, photographed)) {
                    shadow.see(f64::from(ratio), 1.0);
                }
                if let Some(guess) = guess {
                    let off = (0..3).map(|c| (guess.colour[c] - photographed[c]).powi(2)).sum::<f32>() / 3.0;
                    imagined.see(f64::from(off), f64::from(guess.certainty));
                }
            }
            let pull = |wanted: [f32; 3], weight: f32| [0, 1, 2].map(|c| weight * (colour[c] - wanted[c]));
            gradients.push(if known {
                pull(photographed, scale)
            } else if let Some(guess) = guess {
                pull(guess.colour, scale * guess.certainty)
            } else {
                [0.0; 3]
            });
        }
    }

    /// What is imagined of a probe that would look like `lit` in its light.
    fn imagine(&self, probe: usize, lit: Imagined) -> Option<Imagined> {
        let transmittance = self.transmittance[probe];
        let share = match self.shadow {
            Some(shadow) => shadow + (1.0 - shadow) * transmittance,
            // In full light it does not matter how dark shadows are.
            None if transmittance > LIGHT => 1.0,
            None => return None,
        };
        Some(Imagined { colour: lit.colour.map(|c| c * share), ..lit })
    }

    /// Brightness of a photographed probe beside the same place in its light, if it shows shadow.
    fn shadow_ratio(&self, probe: usize, lit: Imagined, photographed: [f32; 3]) -> Option<f32> {
        let sure = self.transmittance[probe] < DARK && lit.certainty >= 0.5 && brightness(lit.colour) > 0.0;
        // Where the photograph is as bright as it would be in the light, the shadow ray went astray.
        let ratio = brightness(photographed) / brightness(lit.colour);
        (sure && ratio < LIT).then_some(ratio)
    }
}

/// Those colours of a point, `pairs` of a light's position and the colour under it, that are no shadows.
fn in_light(point: [f32; 3], pairs: impl Iterator<Item = ([f32; 3], [f32; 3])> + Clone) -> Vec<Photograph> {
    let brightest = pairs.clone().map(|(_, colour)| brightness(colour)).fold(0.0, f32::max);
    let lit = pairs.filter(|&(_, colour)| brightness(colour) >= LIT * brightest);
    lit.map(|(position, colour)| {
        let (direction, distance) = toward(point, position);
        Photograph { direction, distance, colour }
    })
    .collect()
}

/// Colour of a point in the light of a lamp at `light`, from its colours under others, and how sure that is, 0..1; `None`
/// without any.
fn lit_colour(point: [f32; 3], light: [f32; 3], others: &[Photograph]) -> Option<Imagined> {
    let (direction, length) = toward(point, light);
    let (mut sum, mut total) = ([0.0; 3], 0.0);
    for other in others {
        let cos: f32 = direction.iter().zip(other.direction).map(|(a, b)| a * b).sum();
        let nearness = (-(1.0 - cos + (other.distance / length - 1.0).powi(2)) / NEARNESS).exp();
        total += nearness;
        sum.iter_mut().zip(other.colour).for_each(|(s, c)| *s += nearness * c);
    }
    (total > 1e-9).then(|| Imagined { colour: sum.map(|s| s / total), certainty: (total / SURE).min(1.0) })
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

    /// Two lamps at one place.
    static LIGHTS: [CodedLight; 2] =
        [const { CodedLight { position: [0.1, 0.2, 0.5], code: Vec::new() } }; 2];

    fn probes(transmittance: f32, shadow: Option<f32>) -> Probes<'static> {
        Probes { lights: &LIGHTS[..1], transmittance: vec![transmittance], shadow }
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

    fn guess(transmittance: f32, shadow: Option<f32>) -> Option<Imagined> {
        let probes = probes(transmittance, shadow);
        probes.imagine(0, lit_colour(POINT, probes.lights[0].position, &in_light(POINT, pairs()))?)
    }

    /// Compares a probe whose colour in the field is black, and returns its gradient and what was seen.
    fn compared(transmittance: f32, shadow: Option<f32>, photographed: [f32; 3]) -> ([f32; 3], Seen, Seen) {
        let (mut gradients, mut dark, mut imagined) = (Vec::new(), Seen::default(), Seen::default());
        probes(transmittance, shadow).compare(
            (0, POINT),
            &[[0.0; 3]],
            &[photographed],
            pairs(),
            2.0,
            &mut gradients,
            (&mut dark, &mut imagined),
        );
        (gradients[0], dark, imagined)
    }

    #[test]
    fn colours_in_the_light_lie_between_those_of_lights_nearby() {
        let wanted = guess(1.0, Some(0.3)).unwrap();
        assert!(close(wanted.colour, [0.7, 0.5, 0.3]), "{wanted:?}");
        assert_eq!(wanted.certainty, 1.0);
    }

    #[test]
    fn shadows_are_as_dark_as_photographed_ones() {
        let wanted = guess(0.0, Some(0.3)).unwrap();
        assert!(close(wanted.colour, [0.21, 0.15, 0.09]), "{wanted:?}");
        let half = guess(0.5, Some(0.3)).unwrap();
        assert!(close(half.colour, [0.455, 0.325, 0.195]), "{half:?}");
    }

    #[test]
    fn nothing_is_imagined_without_knowing_shadows_or_lights_nearby() {
        assert_eq!(guess(0.0, None), None);
        // In full light it does not matter.
        assert!(close(guess(1.0, None).unwrap().colour, [0.7, 0.5, 0.3]));
        assert_eq!(lit_colour(POINT, [0.1, 0.2, 0.5], &[]), None);
        let far = lit_colour(POINT, [0.1, 0.2, 0.5], &in_light(POINT, pairs().skip(3)));
        assert!(far.is_none_or(|w| w.certainty < 0.01));
    }

    #[test]
    fn colours_are_pulled_to_photographs_or_else_to_what_is_imagined() {
        let (imagined, dark, seen) = compared(0.0, Some(0.3), UNKNOWN);
        assert!(close(imagined, [-0.42, -0.3, -0.18]), "{imagined:?}");
        assert_eq!((dark, seen), (Seen::default(), Seen::default()));
        assert_eq!(compared(0.0, None, UNKNOWN).0, [0.0; 3]);
        assert!(close(compared(0.0, Some(0.3), [0.35, 0.25, 0.15]).0, [-0.7, -0.5, -0.3]));
    }

    #[test]
    fn what_is_imagined_from_afar_counts_less() {
        let (mut gradients, mut dark, mut imagined) = (Vec::new(), Seen::default(), Seen::default());
        let far = std::iter::once(([0.3, 0.2, 0.5], [0.8, 0.6, 0.4]));
        let certainty = lit_colour(POINT, [0.1, 0.2, 0.5], &in_light(POINT, far.clone())).unwrap().certainty;
        assert!((0.01..0.5).contains(&certainty), "{certainty}");
        let probes = Probes { lights: &LIGHTS, transmittance: vec![1.0; 2], shadow: Some(0.3) };
        let photographed = [UNKNOWN, [0.5, 0.6, 0.4]];
        let seen = (&mut dark, &mut imagined);
        probes.compare((0, POINT), &[[0.0; 3]; 2], &photographed, far, 2.0, &mut gradients, seen);
        assert!(close(gradients[0], [-1.6, -1.2, -0.8].map(|g| g * certainty)), "{gradients:?}");
        assert!(close(gradients[1], [-1.0, -1.2, -0.8]), "a photograph is sure: {gradients:?}");
        assert!((imagined.count - f64::from(certainty)).abs() < 1e-6, "{imagined:?}");
        assert!((imagined.sum - 0.03 * f64::from(certainty)).abs() < 1e-6, "{imagined:?}");
    }

    #[test]
    fn photographs_tell_of_shadows_and_of_what_was_imagined() {
        let (_, dark, imagined) = compared(0.0, Some(0.3), [0.35, 0.25, 0.15]);
        assert!((dark.sum - 0.5).abs() < 1e-4 && dark.count == 1.0, "{dark:?}");
        let off = f64::from(0.14f32.powi(2) + 0.1f32.powi(2) + 0.06f32.powi(2)) / 3.0;
        assert!((imagined.sum - off).abs() < 1e-5 && imagined.count == 1.0, "{imagined:?}");
        // In the light, or as bright as that, nothing is learnt of shadows.
        assert_eq!(compared(1.0, Some(0.3), [0.35, 0.25, 0.15]).1, Seen::default());
        assert_eq!(compared(0.0, Some(0.3), [0.65, 0.45, 0.3]).1, Seen::default());
    }
}
