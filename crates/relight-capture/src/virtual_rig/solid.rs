//! Patterns in space: the colour of a point is a function of where it is.

use glam::Vec3A;

use super::random::{hash, uniform};

/// A pattern in space, between two linear-light colours.
#[derive(Clone, Debug)]
pub struct Solid {
    /// How the two colours alternate.
    pub pattern: Pattern,
    /// Size of the pattern: one period, cell or patch, metres.
    pub size: f32,
    /// The pattern's first colour.
    pub low: [f32; 3],
    /// The pattern's second colour.
    pub high: [f32; 3],
    /// Which of many patterns of the kind.
    pub seed: u64,
}

/// Kinds of patterns in space.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Pattern {
    /// Cubes of one colour, then the other.
    Checks,
    /// Wavering stripes across the x axis.
    Stripes,
    /// Year rings about the z axis.
    Rings,
    /// Smooth patches over five octaves.
    Clouds,
    /// Fine veins, as in marble.
    Veins,
    /// Round spots, here and there.
    Spots,
}

impl Solid {
    pub(super) fn at(&self, position: Vec3A) -> Vec3A {
        let p = position / self.size;
        let share = match self.pattern {
            Pattern::Checks => {
                let c = p.floor();
                (c.x + c.y + c.z).rem_euclid(2.0)
            }
            Pattern::Stripes => {
                let waver = 0.35 * self.clouds(p * 0.6);
                step(0.42, 0.58, 0.5 + 0.5 * (std::f32::consts::TAU * (p.x + waver)).sin())
            }
            Pattern::Rings => {
                let radius = p.x.hypot(p.y) + 0.3 * self.noise(p * Vec3A::new(0.7, 0.7, 0.15));
                let ring = radius.rem_euclid(1.0);
                0.8 * ring * ring + 0.2 * (0.5 + 0.5 * self.noise(p * Vec3A::new(9.0, 9.0, 0.8)))
            }
            Pattern::Clouds => 0.5 + 0.8 * self.clouds(p),
            Pattern::Veins => {
                let v = (std::f32::consts::PI * (p.x + p.y + 2.6 * self.clouds(p))).sin().abs();
                1.0 - step(0.0, 0.28, v)
            }
            Pattern::Spots => self.spots(p),
        };
        Vec3A::from_array(self.low).lerp(Vec3A::from_array(self.high), share.clamp(0.0, 1.0))
    }

    /// Value noise between -1 and 1, smooth, of unit cells.
    fn noise(&self, p: Vec3A) -> f32 {
        let cell = p.floor();
        let f = p - cell;
        let w = f * f * (3.0 - 2.0 * f);
        let corner = |k: i64| {
            let [x, y, z] = [cell.x as i64 + (k & 1), cell.y as i64 + (k >> 1 & 1), cell.z as i64 + (k >> 2)];
            2.0 * uniform(hash(&[self.seed, x as u64, y as u64, z as u64])) - 1.0
        };
        let mix = |a: f32, b: f32, t: f32| a + (b - a) * t;
        let along = |k: i64| mix(corner(k), corner(k + 1), w.x);
        mix(mix(along(0), along(2), w.y), mix(along(4), along(6), w.y), w.z)
    }

    fn clouds(&self, p: Vec3A) -> f32 {
        (0..5).map(|octave| self.noise(p * 2.03f32.powi(octave)) * 0.5f32.powi(octave + 1)).sum()
    }

    /// One spot in each cell, of varying size.
    fn spots(&self, p: Vec3A) -> f32 {
        let cell = p.floor();
        let mut most = 0.0f32;
        for k in 0..27i64 {
            let near = cell + Vec3A::new((k % 3 - 1) as f32, (k / 3 % 3 - 1) as f32, (k / 9 - 1) as f32);
            let [x, y, z] = [near.x, near.y, near.z].map(|v| v as i64 as u64);
            let draw = |axis: u64| uniform(hash(&[self.seed, x, y, z, axis]));
            let centre = near + Vec3A::new(draw(1), draw(2), draw(3));
            let radius = 0.18 + 0.25 * draw(4);
            most = most.max(1.0 - step(radius - 0.05, radius + 0.05, p.distance(centre)));
        }
        most
    }
}

/// 0 below `low`, 1 above `high`, smooth between.
fn step(low: f32, high: f32, x: f32) -> f32 {
    let t = ((x - low) / (high - low)).clamp(0.0, 1.0);
    t * t * (3.0 - 2.0 * t)
}
