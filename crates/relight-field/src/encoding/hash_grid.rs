//! The position code `h(x)`: a multiresolution hash grid (Mueller et al. 2022).
//!
//! Level `l` has `r` cells an axis. A point of the unit cube lies in one cell, and its features are those of the
//! cell's 8 vertices, interpolated. Vertices are stored densely where the level's share of the table has room for
//! all of them, else at a hash of their coordinates, and collisions are left to training.

use relight_scene::Bounds;

use crate::parameters::{GridConfig, Level};
use crate::real::Real;

/// Factors of the hash, an axis each; the first is 1 so that neighbours along x share cache lines.
const PRIMES: [u32; 3] = [1, 2_654_435_761, 805_459_861];

/// A world point in the grid's coordinates: the box becomes the unit cube, and what lies outside it moves to the
/// nearest face.
pub fn unit<R: Real>(bounds: &Bounds, position: [R; 3]) -> [R; 3] {
    std::array::from_fn(|a| {
        let (lo, hi) = (R::from_f32(bounds.lo[a]), R::from_f32(bounds.hi[a]));
        ((position[a] - lo) / (hi - lo)).max(R::ZERO).min(R::ONE)
    })
}

/// Where the vertex `[i, j, k]` of a level lies in the table, as the number of an entry.
pub fn entry(level: &Level, [i, j, k]: [u32; 3]) -> usize {
    let within = if level.hashed {
        let [x, y, z] = [i.wrapping_mul(PRIMES[0]), j.wrapping_mul(PRIMES[1]), k.wrapping_mul(PRIMES[2])];
        // Hashed levels have a power of two of entries.
        (x ^ y ^ z) as usize & (level.entries - 1)
    } else {
        let side = level.resolution as usize + 1;
        i as usize + side * (j as usize + side * k as usize)
    };
    level.offset + within
}

/// The 8 table entries around the point `x` of the unit cube, with their trilinear weights.
pub fn corners<R: Real>(level: &Level, x: [R; 3]) -> [(usize, R); 8] {
    let resolution = R::from_f64(f64::from(level.resolution));
    // A point on the upper face belongs to the last cell; the cast takes the floor.
    let cell = x.map(|v| ((v * resolution).to_f64() as u32).min(level.resolution - 1));
    let offset: [R; 3] = std::array::from_fn(|a| x[a] * resolution - R::from_f64(f64::from(cell[a])));
    std::array::from_fn(|corner| {
        let mut vertex = cell;
        let mut weight = R::ONE;
        for axis in 0..3 {
            let upper = corner >> axis & 1;
            vertex[axis] += upper as u32;
            weight = weight * if upper == 1 { offset[axis] } else { R::ONE - offset[axis] };
        }
        (entry(level, vertex), weight)
    })
}

/// A grid without its table.
#[derive(Clone, Debug, PartialEq)]
pub struct HashGrid {
    levels: Vec<Level>,
    features: usize,
}

impl HashGrid {
    /// The grid of a configuration.
    pub fn new(config: &GridConfig) -> Self {
        Self { levels: config.level_table(), features: config.features }
    }

    /// `h(x)` of the point `x` of the unit cube, level by level; `table` is `[entries, features]`.
    pub fn encode<R: Real>(&self, table: &[R], x: [R; 3]) -> Vec<R> {
        let mut h = vec![R::ZERO; self.levels.len() * self.features];
        for (level, out) in self.levels.iter().zip(h.chunks_exact_mut(self.features)) {
            for (entry, weight) in corners(level, x) {
                let features = &table[entry * self.features..][..self.features];
                for (o, &f) in out.iter_mut().zip(features) {
                    *o += weight * f;
                }
            }
        }
        h
    }

    /// Adds to `gradient`, of the table's shape, the derivative of a loss of which `d_h` is the derivative by `h(x)`.
    pub fn backward<R: Real>(&self, x: [R; 3], d_h: &[R], gradient: &mut [R]) {
        for (level, d_out) in self.levels.iter().zip(d_h.chunks_exact(self.features)) {
            for (entry, weight) in corners(level, x) {
                let features = &mut gradient[entry * self.features..][..self.features];
                for (g, &d) in features.iter_mut().zip(d_out) {
                    *g += weight * d;
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn config() -> GridConfig {
        GridConfig { levels: 3, features: 2, log2_table: 6, base: 2, finest: 9 }
    }

    /// A dense level that holds a linear function of the vertex interpolates it exactly, up to the upper faces.
    #[test]
    fn dense_levels_interpolate_linear_functions() {
        let config = GridConfig { levels: 1, features: 2, log2_table: 10, base: 5, finest: 5 };
        let level = config.level_table()[0];
        let mut table = vec![0.0f64; config.entries() * 2];
        for k in 0..=5 {
            for j in 0..=5 {
                for i in 0..=5 {
                    let at = entry(&level, [i, j, k]);
                    table[2 * at] = 1.0 + f64::from(i) - 2.0 * f64::from(j) + 0.5 * f64::from(k);
                    table[2 * at + 1] = f64::from(k);
                }
            }
        }
        let grid = HashGrid::new(&config);
        for x in [[0.0, 0.0, 0.0], [1.0, 1.0, 1.0], [0.31, 0.77, 1.0], [0.2, 0.4, 0.6]] {
            let h = grid.encode(&table, x);
            assert!((h[0] - (1.0 + 5.0 * x[0] - 10.0 * x[1] + 2.5 * x[2])).abs() < 1e-12);
            assert!((h[1] - 5.0 * x[2]).abs() < 1e-12);
        }
    }

    #[test]
    fn every_entry_lies_in_its_own_level() {
        for level in config().level_table() {
            let r = level.resolution;
            for vertex in [[0, 0, 0], [r, r, r], [r, 0, 1], [1, r, 0]] {
                let at = entry(&level, vertex);
                assert!((level.offset..level.offset + level.entries).contains(&at));
            }
        }
        assert!(config().level_table().iter().any(|l| l.hashed));
        assert!(config().level_table().iter().any(|l| !l.hashed));
    }

    #[test]
    fn points_outside_the_box_are_moved_to_its_faces() {
        let bounds = Bounds { lo: [-1.0, 0.0, 2.0], hi: [1.0, 1.0, 4.0] };
        assert_eq!(unit(&bounds, [0.5, -3.0, 9.0]), [0.75, 0.0, 1.0]);
        assert_eq!(unit::<f64>(&bounds, [f64::NAN; 3]), [0.0; 3]);
    }

    #[test]
    fn gradient_of_the_table_agrees_with_finite_differences() {
        let config = config();
        let grid = HashGrid::new(&config);
        let random = crate::random::Random::new(3, 0);
        let mut table: Vec<f64> =
            (0..config.entries() as u64 * 2).map(|i| f64::from(random.uniform_at(i))).collect();
        let d_h: Vec<f64> = (0..6).map(|i| f64::from(random.uniform_at(1000 + i)) - 0.5).collect();
        let x = [0.37, 0.92, 0.11];
        let mut gradient = vec![0.0; table.len()];
        grid.backward(x, &d_h, &mut gradient);
        let loss = |table: &[f64]| grid.encode(table, x).iter().zip(&d_h).map(|(h, d)| h * d).sum::<f64>();
        for at in 0..table.len() {
            let value = table[at];
            table[at] = value + 0.5;
            let above = loss(&table);
            table[at] = value - 0.5;
            let below = loss(&table);
            table[at] = value;
            assert!((gradient[at] - (above - below)).abs() < 1e-12);
        }
        assert!(gradient.iter().filter(|g| **g != 0.0).count() > 20);
    }
}
