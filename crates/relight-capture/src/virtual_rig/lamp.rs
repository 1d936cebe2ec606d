//! The lamp: a small sphere that shines evenly all round.

use fearless_simd::{Level, Simd, dispatch, f32x16, prelude::*};

use super::error::{RigError, within};
use super::occlusion::LANES;
use super::random::{hash, stratified, to_disc};

/// A small sphere of even radiance around each light's position. Its irradiance on a surface that faces it is `intensity`
/// over the distance squared, exactly. The lamp itself is not to be seen, neither directly nor in mirrors after a bounce.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Lamp {
    /// Radius of the sphere, metres.
    pub radius: f64,
    /// Radiant intensity of red, green and blue, watts a steradian (or any unit: exposure settles it).
    pub intensity: [f64; 3],
}

impl Default for Lamp {
    /// A warm white ball of 5 mm radius.
    fn default() -> Self {
        Self { radius: 0.005, intensity: [1.0, 0.88, 0.68] }
    }
}

impl Lamp {
    pub(super) fn check(&self) -> Result<(), RigError> {
        within("the lamp's radius", self.radius, [0.0, 0.1], "0 to 0.1 m")?;
        self.intensity.iter().try_for_each(|&i| within("the lamp's intensity", i, [0.0, 1e6], "0 to 1e6"))
    }
}

/// Points on the unit disc, in sets that each are stratified: where on the lamp samples aim. Pixels and lights draw sets.
pub(super) struct AimTable {
    points: Vec<[f32; 2]>,
    samples: usize,
}

const SETS: usize = 256;

impl AimTable {
    pub(super) fn new(samples: usize) -> Self {
        let set = |s: usize| {
            (0..samples).map(move |i| to_disc(stratified(i as u32, hash(&[0x41_49_4D, s as u64]))))
        };
        Self { points: (0..SETS).flat_map(set).collect(), samples }
    }

    /// The set that a hash draws: one point a sample.
    pub(super) fn set(&self, hash: u64) -> &[[f32; 2]] {
        let start = (hash >> 32) as usize % SETS * self.samples;
        &self.points[start..start + self.samples]
    }
}

/// Sixteen shaded points, each with the centre of a lamp and the place on its disc to aim at.
pub(super) struct Aims {
    pub point: [[f32; LANES]; 3],
    pub lamp: [[f32; LANES]; 3],
    pub disc: [[f32; LANES]; 2],
}

/// What a shaded point sees of the lamp.
pub(super) struct Sightings {
    /// Unit vector to the drawn place of the lamp's surface.
    pub direction: [[f32; LANES]; 3],
    /// Distance at which the lamp's sphere begins, metres.
    pub length: [f32; LANES],
    /// Radiance times solid angle, for unit intensity: what scattering and cosine are to be multiplied with.
    pub weight: [f32; LANES],
}

impl Aims {
    /// Draws directions evenly over the solid angle of a lamp of some radius.
    pub(super) fn sight(&self, level: Level, radius: f32) -> Sightings {
        dispatch!(level, simd => simd.vectorize(
            #[inline(always)]
            || self.sight_simd(simd, radius)
        ))
    }

    #[inline(always)]
    fn sight_simd<S: Simd>(&self, simd: S, radius: f32) -> Sightings {
        let load = |values: &[f32; LANES]| f32x16::load_array(simd, *values);
        let one = f32x16::splat(simd, 1.0);
        let [cx, cy, cz] = [0, 1, 2].map(|k| load(&self.lamp[k]) - load(&self.point[k]));
        // Points inside the lamp are as far as its surface: nothing grows without bounds.
        let squared = (cx * cx + cy * cy + cz * cz).max(radius * radius * 1.0001 + 1e-12);
        let inverse = one / squared.sqrt();
        let [nx, ny, nz] = [cx * inverse, cy * inverse, cz * inverse];
        // Half the lamp's angle, and one minus its cosine without cancellation.
        let sine2 = one / squared * (radius * radius);
        let cosine = (one - sine2).max(0.0).sqrt();
        let height = sine2 / (one + cosine);
        let [x, y] = [load(&self.disc[0]), load(&self.disc[1])];
        let fall = (x * x + y * y) * height;
        let spread = (height * (one * 2.0 - fall)).max(0.0).sqrt();
        let along = one - fall;
        let (u, v) = (x * spread, y * spread);
        // Tangents as in `bsdf::tangents`.
        let sign = one.copysign(nz);
        let a = f32x16::splat(simd, -1.0) / (sign + nz);
        let b = nx * ny * a;
        let direction = [
            u * (one + sign * nx * nx * a) + v * b + nx * along,
            u * sign * b + v * (sign + ny * ny * a) + ny * along,
            v * ny * -1.0 - u * sign * nx + nz * along,
        ];
        let length = (squared.sqrt() - radius) * (1.0 - 1e-5);
        let weight = one * 2.0 / (squared * (one + cosine));
        Sightings {
            direction: direction.map(|d| d.to_array()),
            length: length.to_array(),
            weight: weight.to_array(),
        }
    }
}
