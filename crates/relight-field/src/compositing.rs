//! Volume rendering along one ray (Max 1995; section 4.1 of the paper), and the penalties on where its weight lies.
//!
//! A ray has samples at distances `t_i`, each standing for the interval of length `delta_i` that follows it. Sample
//! `i` absorbs `alpha_i = 1 - exp(-sigma_i delta_i)` of what reaches it; the last sample is opaque, `alpha = 1`, so
//! the weights `w_i = T_i alpha_i` sum to one. Lengths are in metres, densities per metre.

use crate::real::Real;

/// Weights of a ray's samples, and what their backward pass needs.
#[derive(Clone, Debug)]
pub struct Weights<R> {
    /// `w_i`.
    pub weight: Vec<R>,
    /// `T_(i+1) = prod_(j <= i) exp(-sigma_j delta_j)`: what passes sample `i`; without meaning for the last.
    passed: Vec<R>,
}

/// Weights of samples of densities `sigma` that stand for lengths `delta`; the density of the last does not matter.
pub fn weights<R: Real>(sigma: &[R], delta: &[R]) -> Weights<R> {
    let last = sigma.len().saturating_sub(1);
    let mut transmittance = R::ONE;
    let mut result =
        Weights { weight: Vec::with_capacity(sigma.len()), passed: Vec::with_capacity(sigma.len()) };
    for (i, (&sigma, &delta)) in sigma.iter().zip(delta).enumerate() {
        let passed = if i == last { R::ZERO } else { transmittance * (-(sigma * delta)).exp() };
        result.weight.push(transmittance - passed);
        result.passed.push(passed);
        transmittance = passed;
    }
    result
}

/// Derivatives of a loss by the densities; `d_weight` is that by the weights.
///
/// `dw_j / dsigma_i` is `delta_i T_(i+1)` for `j = i`, `-delta_i w_j` for `j > i` and zero before.
pub fn weights_backward<R: Real>(weights: &Weights<R>, delta: &[R], d_weight: &[R]) -> Vec<R> {
    let mut d_sigma = vec![R::ZERO; delta.len()];
    let mut behind = R::ZERO;
    for i in (0..delta.len()).rev() {
        if i + 1 < delta.len() {
            d_sigma[i] = delta[i] * (weights.passed[i] * d_weight[i] - behind);
        }
        behind += weights.weight[i] * d_weight[i];
    }
    d_sigma
}

/// The distortion loss `sum_ij w_i w_j |t_i - t_j| + 1/3 sum_i w_i^2 delta_i` (Barron et al. 2022, equation 15), and
/// its derivatives by the weights. Distances ascend; the loss is in their unit.
pub fn distortion<R: Real>(weight: &[R], t: &[R], delta: &[R]) -> (R, Vec<R>) {
    // sum_j w_j |t_i - t_j| from running sums of w and w t over the samples before i and from i on.
    let (two, third) = (R::from_f64(2.0), R::from_f64(1.0 / 3.0));
    let (mut weight_before, mut moment_before) = (R::ZERO, R::ZERO);
    let mut weight_after: R = weight.iter().copied().sum();
    let mut moment_after: R = weight.iter().zip(t).map(|(&w, &t)| w * t).sum();
    let mut loss = R::ZERO;
    let mut d_weight = Vec::with_capacity(weight.len());
    for ((&w, &t), &delta) in weight.iter().zip(t).zip(delta) {
        let spread = t * weight_before - moment_before + moment_after - t * weight_after;
        loss += w * spread + third * w * w * delta;
        d_weight.push(two * (spread + third * w * delta));
        weight_before += w;
        moment_before += w * t;
        weight_after += -w;
        moment_after += -(w * t);
    }
    (loss, d_weight)
}

/// The penalty `sum_i w_i rho((t_i - depth) / margin)`, `rho(u) = u^2 / (1 + u^2)`, on weight far from an expected
/// `depth`, and its derivatives by the weights. `rho` saturates at 1, so a wrong expectation costs no more than that.
pub fn depth_penalty<R: Real>(weight: &[R], t: &[R], depth: R, margin: R) -> (R, Vec<R>) {
    let rho = |&t: &R| {
        let u = (t - depth) / margin;
        u * u / (R::ONE + u * u)
    };
    let d_weight: Vec<R> = t.iter().map(rho).collect();
    (weight.iter().zip(&d_weight).map(|(&w, &rho)| w * rho).sum(), d_weight)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::Random;

    fn uniform(stream: u64, n: u64) -> Vec<f64> {
        (0..n).map(|i| f64::from(Random::new(1, stream).uniform_at(i))).collect()
    }

    /// Derivative of `f` at `x` by each of its numbers.
    fn numeric(x: &[f64], f: impl Fn(&[f64]) -> f64) -> Vec<f64> {
        let at = |i: usize, h: f64| {
            let mut x = x.to_vec();
            x[i] += h;
            f(&x)
        };
        (0..x.len()).map(|i| (at(i, 1e-6) - at(i, -1e-6)) / 2e-6).collect()
    }

    fn assert_close(a: &[f64], b: &[f64]) {
        assert!(a.iter().zip(b).all(|(a, b)| (a - b).abs() < 1e-8), "{a:?} {b:?}");
    }

    /// A slab of constant density: the weight within depth `s` is `1 - exp(-sigma s)`, in closed form.
    #[test]
    fn constant_density_slab() {
        let (n, sigma, length) = (64, 3.0, 1.5);
        let mut delta = vec![length / n as f64; n];
        delta.push(0.0);
        let weights = weights(&vec![sigma; n + 1], &delta);
        let mut sum = 0.0;
        for (i, w) in weights.weight[..n].iter().enumerate() {
            sum += w;
            let depth = length * (i + 1) as f64 / n as f64;
            assert!((sum - (1.0 - (-sigma * depth).exp())).abs() < 1e-12);
        }
        assert!((weights.weight[n] - (-sigma * length).exp()).abs() < 1e-12);
        assert!((sum + weights.weight[n] - 1.0).abs() < 1e-12);
    }

    #[test]
    fn huge_densities_stop_the_ray_without_nan() {
        let weights = weights(&[1e30f32, 1e30, 0.0], &[0.1, 0.1, 0.0]);
        assert_eq!(weights.weight, [1.0, 0.0, 0.0]);
        assert!(weights_backward(&weights, &[0.1, 0.1, 0.0], &[1.0, 2.0, 3.0]).iter().all(|d| d.is_finite()));
    }

    #[test]
    fn a_ray_without_samples_has_no_weights() {
        assert!(weights::<f64>(&[], &[]).weight.is_empty());
    }

    #[test]
    fn gradient_of_the_weights_agrees_with_finite_differences() {
        let (sigma, delta, d_weight) = (uniform(1, 9), uniform(2, 9), uniform(3, 9));
        let loss = |sigma: &[f64]| {
            weights(sigma, &delta).weight.iter().zip(&d_weight).map(|(w, d)| w * d).sum::<f64>()
        };
        let analytic = weights_backward(&weights(&sigma, &delta), &delta, &d_weight);
        assert_close(&analytic, &numeric(&sigma, loss));
        assert_eq!(analytic[8], 0.0);
    }

    #[test]
    fn distortion_agrees_with_its_definition_and_with_finite_differences() {
        let (weight, delta) = (uniform(4, 8), uniform(5, 8));
        let t: Vec<f64> = delta.iter().scan(0.3, |t, d| Some(std::mem::replace(t, *t + d))).collect();
        let definition = |w: &[f64]| -> f64 {
            let pairs: f64 = (0..8)
                .flat_map(|i| (0..8).map(move |j| (i, j)))
                .map(|(i, j)| w[i] * w[j] * (t[i] - t[j]).abs())
                .sum();
            pairs + (0..8).map(|i| w[i] * w[i] * delta[i]).sum::<f64>() / 3.0
        };
        let (loss, d_weight) = distortion(&weight, &t, &delta);
        assert!((loss - definition(&weight)).abs() < 1e-12);
        assert_close(&d_weight, &numeric(&weight, definition));
    }

    #[test]
    fn depth_penalty_agrees_with_finite_differences_and_vanishes_at_the_depth() {
        let (weight, t) = (uniform(6, 5), uniform(7, 5));
        let penalty = |w: &[f64]| depth_penalty(w, &t, 0.4, 0.1).0;
        assert_close(&depth_penalty(&weight, &t, 0.4, 0.1).1, &numeric(&weight, penalty));
        assert_eq!(depth_penalty(&[1.0], &[0.4], 0.4, 0.1).0, 0.0);
        assert!((depth_penalty(&[1.0], &[0.5], 0.4, 0.1).0 - 0.5).abs() < 1e-12);
    }
}
