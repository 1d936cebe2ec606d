//! The point that a set of cameras looks at.

use crate::camera::Camera;
use crate::light::Light;
use crate::vector::{Vector, add, dot, mean, norm, scale, sub, unit};

/// Rounds of reweighting: enough for a few stray lines to lose their say.
const ROUNDS: usize = 15;
/// Pull towards the prior, as a share of what the lines weigh: it decides only what the lines leave open.
const PRIOR: f64 = 1e-4;

/// A half-line in the world.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Sight {
    pub(crate) origin: Vector,
    /// Unit length.
    pub(crate) direction: Vector,
}

impl Sight {
    /// The ray through the middle of a camera's image: unlike the optical axis it is what the camera was aimed by when
    /// the principal point is off centre.
    pub(crate) fn of(camera: &Camera) -> Sight {
        let lens = &camera.intrinsics;
        let middle =
            lens.unproject((f64::from(lens.width) - 1.0) / 2.0, (f64::from(lens.height) - 1.0) / 2.0);
        let direction = unit(camera.pose.rotate(middle)).unwrap_or([0.0, 0.0, 1.0]);
        Sight { origin: camera.pose.position(), direction }
    }

    /// The part of `v` across the line.
    fn across(&self, v: Vector) -> Vector {
        sub(v, scale(self.direction, dot(self.direction, v)))
    }
}

/// The point nearest to all lines: least sum of distances, by iteratively reweighted least squares. What the lines
/// leave open, as along the common direction of parallel ones, `prior` decides.
pub(crate) fn nearest_point(sights: &[Sight], prior: Vector) -> Vector {
    let mut point = prior;
    let mut weights = vec![1.0; sights.len()];
    for _ in 0..ROUNDS {
        let total: f64 = weights.iter().sum();
        let pull = PRIOR * total.max(1e-12);
        let mut matrix = [[pull, 0.0, 0.0], [0.0, pull, 0.0], [0.0, 0.0, pull]];
        let mut right = scale(prior, pull);
        for (sight, &weight) in sights.iter().zip(&weights) {
            for (i, row) in matrix.iter_mut().enumerate() {
                for (j, entry) in row.iter_mut().enumerate() {
                    let identity = if i == j { 1.0 } else { 0.0 };
                    *entry += weight * (identity - sight.direction[i] * sight.direction[j]);
                }
            }
            right = add(right, scale(sight.across(sight.origin), weight));
        }
        let Some(solution) = solve(&matrix, right) else { return prior };
        point = solution;
        let misses: Vec<f64> = sights.iter().map(|s| norm(s.across(sub(point, s.origin)))).collect();
        // Distances below a share of the mean one count alike, or the nearest line would take all.
        let floor = 0.1 * misses.iter().sum::<f64>() / misses.len().max(1) as f64 + 1e-12;
        weights = misses.iter().map(|miss| floor / miss.max(floor)).collect();
    }
    point
}

/// The point that a scene's cameras look at, world frame, metres: the nearest to the rays through the middles of their
/// images; where they leave it open, as one camera does, near the middle of the lights.
pub fn focus(cameras: &[Camera], lights: &[Light]) -> Vector {
    let sights: Vec<Sight> = cameras.iter().map(Sight::of).collect();
    let lit = mean(&lights.iter().map(|light| light.pose.position()).collect::<Vec<_>>());
    let guesses: Vec<Vector> = sights
        .iter()
        .map(|sight| {
            let to_lights = sub(lit, sight.origin);
            let ahead = dot(to_lights, sight.direction).max(0.5 * norm(to_lights));
            add(sight.origin, scale(sight.direction, ahead))
        })
        .collect();
    nearest_point(&sights, mean(&guesses))
}

/// Solves a symmetric positive 3x3 system by Cramer's rule.
fn solve(m: &[[f64; 3]; 3], b: Vector) -> Option<Vector> {
    let determinant = |a: Vector, b: Vector, c: Vector| dot(a, crate::vector::cross(b, c));
    let whole = determinant(m[0], m[1], m[2]);
    // Symmetric: rows are columns.
    let x = [determinant(b, m[1], m[2]), determinant(m[0], b, m[2]), determinant(m[0], m[1], b)];
    let x = scale(x, 1.0 / whole);
    x.iter().all(|v| v.is_finite()).then_some(x)
}
