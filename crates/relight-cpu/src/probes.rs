//! Probes: every ray under a few more lights, most of which nobody photographed.
//!
//! Photographs teach a field the lights that stood there. Between them it may put thin shadows anywhere, and does. But
//! where a surface is, is soon known, and so is where the shadow of one thing falls on another: a [shadow ray](crate::shadow)
//! from the surface to the light tells. What the surface should look like under a probe is imagined from its photographs under
//! lights nearby that reached it, times what is left of such colours in photographs whose shadow rays met the like: little
//! where those are mostly right, nearly all where they often err. Probes under lights that were photographed tell how much
//! that is, and how far what is imagined can be trusted: see [`crate::experience`].
//!
//! Ours: the paper has nothing like it.

use crate::experience::{Experience, Told};
use crate::shade::CodedLight;
use crate::shadow::{Shadow, toward};

/// Pairs darker than this share of a ray's brightest may lie in shadow, and tell nothing of light.
const LIT: f32 = 0.6;
/// Lights count less by a factor e for each so much of `1 - cos(angle) + (relative distance)^2`: 14 degrees.
const NEARNESS: f32 = 0.03;
/// Nearness, summed over lights, of a colour that is as sure as any.
const SURE: f32 = 0.3;

/// The probes of a tile.
pub struct Probes<'a> {
    /// `[n, probes]`: their lights.
    pub lights: &'a [CodedLight],
    /// `[n, probes]`: what their shadow rays met.
    pub shadows: Vec<Shadow>,
    /// What photographs told so far.
    pub experience: &'a Experience,
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

impl Probes<'_> {
    /// Adds the gradients of the probes of the tile's ray `ray`, which ends at `point`, to `gradients`: what it looks like under
    /// them, `colours`, against what it should, times `scale`. `photographed` are its colours there, NaN where there are
    /// none, `pairs` the positions of its other lights and the colours under them. What the photographs tell is added to `told`.
    #[allow(clippy::too_many_arguments)]
    pub fn compare(
        &self,
        (ray, point): (usize, [f32; 3]),
        colours: &[[f32; 3]],
        photographed: &[[f32; 3]],
        pairs: impl Iterator<Item = ([f32; 3], [f32; 3])> + Clone,
        scale: f32,
        gradients: &mut Vec<[f32; 3]>,
        told: &mut Told,
    ) {
        let (first, lit) = (ray * colours.len(), in_light(point, pairs));
        for (probe, (colour, &photographed)) in (first..).zip(colours.iter().zip(photographed)) {
            let known = photographed.iter().all(|c| c.is_finite());
            let lit = lit_colour(point, self.lights[probe].position, &lit);
            let guess = lit.and_then(|lit| self.imagine(probe, lit));
            if known {
                if let Some(lit) = lit {
                    told.see_light(self.shadows[probe], (lit.colour, lit.certainty), photographed);
                }
                if let Some(guess) = guess {
                    let off = (0..3).map(|c| (guess.colour[c] - photographed[c]).powi(2)).sum::<f32>() / 3.0;
                    told.imagined.see(f64::from(off), f64::from(guess.certainty));
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

    /// What is imagined of a probe that would look like `lit` in its light; `None` where nothing tells.
    fn imagine(&self, probe: usize, lit: Imagined) -> Option<Imagined> {
        let share = self.experience.share(self.shadows[probe])?;
        Some(Imagined { colour: lit.colour.map(|c| c * share), ..lit })
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::experience::{Seen, Share};

    const POINT: [f32; 3] = [0.1, 0.2, 0.0];
    const UNKNOWN: [f32; 3] = [f32::NAN; 3];
    const DARK: Shadow = Shadow { transmittance: 0.0, away: 30.0 };

    /// Two lamps at one place.
    static LIGHTS: [CodedLight; 2] =
        [const { CodedLight { position: [0.1, 0.2, 0.5], code: Vec::new() } }; 2];

    /// Nothing is known, or that a share of 0.3 is left in [`DARK`] and of 0.9 in the light.
    fn experience(known: bool) -> Experience {
        let mut experience = Experience::default();
        if known {
            for (shadow, share) in [(DARK, 0.3), (Shadow::NONE, 0.9)] {
                experience.shares[shadow.class()] =
                    Share { products: 100.0 * share, squares: 100.0, count: 100.0 };
            }
        }
        experience
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

    fn guess(shadow: Shadow, known: bool) -> Option<Imagined> {
        let experience = experience(known);
        let probes = Probes { lights: &LIGHTS[..1], shadows: vec![shadow], experience: &experience };
        probes.imagine(0, lit_colour(POINT, probes.lights[0].position, &in_light(POINT, pairs()))?)
    }

    /// Compares a probe whose colour in the field is black, and returns its gradient and what was told.
    fn compared(shadow: Shadow, known: bool, photographed: [f32; 3]) -> ([f32; 3], Told) {
        let (mut gradients, mut told, experience) = (Vec::new(), Told::default(), experience(known));
        let probes = Probes { lights: &LIGHTS[..1], shadows: vec![shadow], experience: &experience };
        probes.compare((0, POINT), &[[0.0; 3]], &[photographed], pairs(), 2.0, &mut gradients, &mut told);
        (gradients[0], told)
    }

    #[test]
    fn colours_in_the_light_lie_between_those_of_lights_nearby() {
        let wanted = guess(Shadow::NONE, false).unwrap();
        assert!(close(wanted.colour, [0.7, 0.5, 0.3]), "{wanted:?}");
        assert_eq!(wanted.certainty, 1.0);
    }

    #[test]
    fn shadows_leave_what_they_leave_in_photographs() {
        let wanted = guess(DARK, true).unwrap();
        assert!(close(wanted.colour, [0.21, 0.15, 0.09]), "{wanted:?}");
        assert!(close(guess(Shadow::NONE, true).unwrap().colour, [0.63, 0.45, 0.27]));
    }

    #[test]
    fn nothing_is_imagined_without_knowing_shadows_or_lights_nearby() {
        assert_eq!(guess(DARK, false), None);
        assert_eq!(guess(Shadow { away: 1.0, ..DARK }, true), None);
        assert_eq!(lit_colour(POINT, [0.1, 0.2, 0.5], &[]), None);
        let far = lit_colour(POINT, [0.1, 0.2, 0.5], &in_light(POINT, pairs().skip(3)));
        assert!(far.is_none_or(|w| w.certainty < 0.01));
    }

    #[test]
    fn colours_are_pulled_to_photographs_or_else_to_what_is_imagined() {
        let (imagined, told) = compared(DARK, true, UNKNOWN);
        assert!(close(imagined, [-0.42, -0.3, -0.18]), "{imagined:?}");
        assert_eq!(told, Told::default());
        assert_eq!(compared(DARK, false, UNKNOWN).0, [0.0; 3]);
        assert!(close(compared(DARK, true, [0.35, 0.25, 0.15]).0, [-0.7, -0.5, -0.3]));
    }

    /// Of two rays with two probes each, the second.
    #[test]
    fn every_probe_has_the_shadow_of_its_own_ray() {
        let lights: Vec<CodedLight> = (0..4).map(|_| LIGHTS[0].clone()).collect();
        let shadows = vec![Shadow::NONE, Shadow::NONE, DARK, Shadow::NONE];
        let experience = experience(true);
        let probes = Probes { lights: &lights, shadows, experience: &experience };
        let (mut gradients, mut told) = (Vec::new(), Told::default());
        let black = [[0.0; 3]; 2];
        probes.compare((1, POINT), &black, &[UNKNOWN; 2], pairs(), 2.0, &mut gradients, &mut told);
        assert!(close(gradients[0], [-0.42, -0.3, -0.18]), "{gradients:?}");
        assert!(close(gradients[1], [-1.26, -0.9, -0.54]), "{gradients:?}");
    }

    #[test]
    fn what_is_imagined_from_afar_counts_less() {
        let (mut gradients, mut told, experience) = (Vec::new(), Told::default(), experience(false));
        let far = std::iter::once(([0.3, 0.2, 0.5], [0.8, 0.6, 0.4]));
        let certainty = lit_colour(POINT, [0.1, 0.2, 0.5], &in_light(POINT, far.clone())).unwrap().certainty;
        assert!((0.01..0.5).contains(&certainty), "{certainty}");
        let probes = Probes { lights: &LIGHTS, shadows: vec![Shadow::NONE; 2], experience: &experience };
        let photographed = [UNKNOWN, [0.5, 0.6, 0.4]];
        probes.compare((0, POINT), &[[0.0; 3]; 2], &photographed, far, 2.0, &mut gradients, &mut told);
        assert!(close(gradients[0], [-1.6, -1.2, -0.8].map(|g| g * certainty)), "{gradients:?}");
        assert!(close(gradients[1], [-1.0, -1.2, -0.8]), "a photograph is sure: {gradients:?}");
        let imagined = told.imagined;
        assert!((imagined.count - f64::from(certainty)).abs() < 1e-6, "{imagined:?}");
        assert!((imagined.sum - 0.03 * f64::from(certainty)).abs() < 1e-6, "{imagined:?}");
        let light = told.shares[0];
        assert!((light.squares - 1.16 * certainty).abs() < 1e-6 && light.count == certainty, "{light:?}");
    }

    #[test]
    fn photographs_tell_of_shadows_and_of_what_was_imagined() {
        let (_, told) = compared(DARK, true, [0.35, 0.25, 0.15]);
        let shadow = told.shares[DARK.class()];
        assert!((shadow.products / shadow.squares - 0.5).abs() < 1e-4, "{shadow:?}");
        assert_eq!(told.shares.iter().filter(|seen| seen.count > 0.0).count(), 1, "and of no others");
        let off = f64::from(0.14f32.powi(2) + 0.1f32.powi(2) + 0.06f32.powi(2)) / 3.0;
        assert!((told.imagined.sum - off).abs() < 1e-5 && told.imagined.count == 1.0, "{told:?}");
        // What no shadow is known of is learnt of all the same.
        let (_, told) = compared(DARK, false, [0.35, 0.25, 0.15]);
        assert!(told.shares[DARK.class()].count > 0.0 && told.imagined == Seen::default(), "{told:?}");
    }
}
