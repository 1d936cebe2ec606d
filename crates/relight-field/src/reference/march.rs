//! March: from rays to samples.

use relight_scene::Bounds;

use super::Field;
use super::{encode, networks};
use crate::compositing;
use crate::real::Real;

/// Added to the weights of the first pass, so that every stretch of a ray keeps some chance of a sample.
const WEIGHT_FLOOR: f64 = 1e-5;

/// A ray in the world frame.
#[derive(Clone, Copy, Debug)]
pub struct Ray<R> {
    /// Origin, metres.
    pub origin: [R; 3],
    /// Unit direction, from the camera into the scene.
    pub direction: [R; 3],
}

impl<R: Real> Ray<R> {
    /// The ray from `origin` along the unit vector `direction`.
    pub fn new(origin: [f32; 3], direction: [f32; 3]) -> Self {
        Self { origin: origin.map(R::from_f32), direction: direction.map(R::from_f32) }
    }

    /// The point at distance `t`, metres.
    pub fn at(&self, t: R) -> [R; 3] {
        std::array::from_fn(|a| self.origin[a] + t * self.direction[a])
    }

    /// Distances at which the ray enters and leaves a box, metres; they agree for a ray that misses it.
    pub fn span(&self, bounds: &Bounds) -> (R, R) {
        let (mut near, mut far) = (R::ZERO, R::from_f64(f64::INFINITY));
        for a in 0..3 {
            let (lo, hi) = (R::from_f32(bounds.lo[a]), R::from_f32(bounds.hi[a]));
            if self.direction[a] != R::ZERO {
                let t0 = (lo - self.origin[a]) / self.direction[a];
                let t1 = (hi - self.origin[a]) / self.direction[a];
                near = near.max(t0.min(t1));
                far = far.min(t0.max(t1));
            } else if self.origin[a] < lo || self.origin[a] > hi {
                // Parallel to these faces, and not between them.
                far = R::ZERO;
            }
        }
        if near < far && far.is_finite() { (near, far) } else { (near, near) }
    }
}

/// The samples of one ray.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct RaySamples<R> {
    /// Distances along the ray, ascending, metres; the last is the opaque one.
    pub t: Vec<R>,
    /// Length of the interval that each stands for, metres.
    pub delta: Vec<R>,
}

impl<R: Real> RaySamples<R> {
    /// Samples at the ascending distances `t`, each standing for the interval up to the next, and an opaque one where
    /// the ray leaves the box at `far`.
    pub fn up_to(mut t: Vec<R>, far: R) -> Self {
        t.push(far);
        let mut delta: Vec<R> = t.windows(2).map(|pair| pair[1] - pair[0]).collect();
        delta.push(R::ZERO);
        Self { t, delta }
    }
}

/// One sample in each of `n` equal stretches of `near..far`; `jitter(i)` in 0..1 is its place within stretch `i`.
pub fn stratified<R: Real>((near, far): (R, R), n: usize, jitter: impl Fn(usize) -> R) -> RaySamples<R> {
    let step = (far - near) / R::from_f64(n as f64);
    RaySamples::up_to((0..n).map(|i| near + step * (R::from_f64(i as f64) + jitter(i))).collect(), far)
}

/// `n` distances, ascending, drawn from the weights of `samples` by inversion of their cumulative sum, as if each
/// weight were spread evenly over its interval; `jitter` as for [`stratified`].
pub fn importance<R: Real>(
    samples: &RaySamples<R>,
    weight: &[R],
    n: usize,
    jitter: impl Fn(usize) -> R,
) -> Vec<R> {
    // The opaque sample stands for no interval.
    let intervals = samples.t.len() - 1;
    let floor = R::from_f64(WEIGHT_FLOOR);
    let total: R = weight[..intervals].iter().map(|&w| w + floor).sum();
    let (mut interval, mut below) = (0, R::ZERO);
    (0..n)
        .map(|j| {
            let target = total * (R::from_f64(j as f64) + jitter(j)) / R::from_f64(n as f64);
            while interval + 1 < intervals && below + weight[interval] + floor < target {
                below += weight[interval] + floor;
                interval += 1;
            }
            let fraction = ((target - below) / (weight[interval] + floor)).min(R::ONE);
            samples.t[interval] + fraction * samples.delta[interval]
        })
        .collect()
}

/// The paper's two passes: `coarse` stratified samples, `fine` more drawn from their weights, all of them merged.
/// `jitter(i)` serves the coarse samples, then the fine ones.
pub fn place<R: Real>(
    field: &Field<R>,
    ray: &Ray<R>,
    coarse: usize,
    fine: usize,
    jitter: impl Fn(usize) -> R,
) -> RaySamples<R> {
    let (near, far) = ray.span(&field.parameters.config.bounds);
    let first = stratified((near, far), coarse, &jitter);
    let density = |&t: &R| networks::geometry(field, &encode::position(field, ray.at(t)).h).sigma;
    let sigma: Vec<R> = first.t.iter().map(density).collect();
    let weight = compositing::weights(&sigma, &first.delta).weight;
    let mut t = importance(&first, &weight, fine, |j| jitter(coarse + j));
    t.extend_from_slice(&first.t[..coarse]);
    t.sort_by(|a, b| a.to_f64().total_cmp(&b.to_f64()));
    RaySamples::up_to(t, far)
}

#[cfg(test)]
mod tests {
    use super::*;

    const BOX: Bounds = Bounds { lo: [-1.0, -1.0, 0.0], hi: [1.0, 1.0, 2.0] };

    #[test]
    fn spans_of_rays_through_beside_and_inside_the_box() {
        let span = |origin, direction| Ray::<f64>::new(origin, direction).span(&BOX);
        assert_eq!(span([0.0, 0.0, 5.0], [0.0, 0.0, -1.0]), (3.0, 5.0));
        assert_eq!(span([0.0, 0.0, 1.0], [1.0, 0.0, 0.0]), (0.0, 1.0));
        // On a face and along it; away from the box; beside it; nowhere at all.
        assert_eq!(span([1.0, 0.0, 3.0], [0.0, 0.0, -1.0]), (1.0, 3.0));
        assert_eq!(span([0.0, 0.0, 5.0], [0.0, 0.0, 1.0]), (0.0, 0.0));
        let (near, far) = span([5.0, 0.0, 5.0], [0.6, 0.0, -0.8]);
        assert!(near == far && near.is_finite());
        assert_eq!(span([0.0, 0.0, 5.0], [0.0, 0.0, 0.0]), (0.0, 0.0));
        let (near, far) = span([0.0, 1.5, 5.0], [0.0, 0.0, -1.0]);
        assert_eq!(near, far);
    }

    #[test]
    fn stratified_samples_end_in_the_opaque_one() {
        let samples = stratified((1.0, 3.0), 4, |_| 0.5);
        assert_eq!(samples.t, [1.25, 1.75, 2.25, 2.75, 3.0]);
        assert_eq!(samples.delta, [0.5, 0.5, 0.5, 0.25, 0.0]);
    }

    #[test]
    fn importance_samples_gather_where_the_weight_is() {
        let samples = stratified((0.0f64, 1.0), 10, |_| 0.0);
        let mut weight = vec![0.0; 11];
        weight[3] = 0.75;
        weight[7] = 0.25;
        let t = importance(&samples, &weight, 400, |_| 0.5);
        assert!(t.is_sorted());
        let within = |lo, hi| t.iter().filter(|t| (lo..hi).contains(*t)).count();
        assert_eq!((within(0.3, 0.4), within(0.7, 0.8)), (300, 100));
    }

    #[test]
    fn importance_samples_of_an_empty_ray_are_even() {
        let samples = stratified((0.0f64, 1.0), 10, |_| 0.0);
        let t = importance(&samples, &[0.0; 11], 20, |_| 0.5);
        assert!(t.iter().enumerate().all(|(j, t)| (t - (j as f64 + 0.5) / 20.0).abs() < 1e-12));
    }
}
