//! Adam (Kingma and Ba 2015), for the networks densely and for single grid entries.

use fearless_simd::{Level, Simd, dispatch};

use crate::soap::Soap;

/// Decay of the first moment.
pub const BETA1: f32 = 0.9;
/// Keeps the division finite; torch-ngp's value.
pub const EPSILON: f32 = 1e-15;

/// Adam with a decay of the second moment, and `1 / (1 - beta1^n)` and `1 / (1 - beta2^n)` for the `n`-th update,
/// computed once: grid entries each have their own `n`.
pub struct Adam {
    beta2: f32,
    corrections: Vec<(f32, f32)>,
}

impl Adam {
    /// Updates after which both corrections differ from 1 by less than single precision shows.
    const LENGTH: i32 = 1 << 14;

    /// Adam with this `beta2`.
    pub fn new(beta2: f64) -> Self {
        let beta2 = beta2 as f32;
        let correction = |beta: f32, n: i32| (1.0 / (1.0 - f64::from(beta).powi(n))) as f32;
        let corrections = (1..=Self::LENGTH).map(|n| (correction(BETA1, n), correction(beta2, n))).collect();
        Self { beta2, corrections }
    }

    /// Corrections of update `n`, counted from 1.
    pub fn corrections(&self, n: u32) -> (f32, f32) {
        self.corrections.get(n as usize - 1).copied().unwrap_or((1.0, 1.0))
    }

    /// Takes the gradient of one weight into its moments.
    #[inline(always)]
    pub fn gather(&self, [m, v]: [&mut f32; 2], g: f32) {
        *m = BETA1 * *m + (1.0 - BETA1) * g;
        *v = self.beta2 * *v + (1.0 - self.beta2) * g * g;
    }

    /// One update of one weight, with the corrections of its count of updates.
    #[inline(always)]
    pub fn update(&self, weight: &mut f32, [m, v]: [&mut f32; 2], g: f32, rate: f32, (c1, c2): (f32, f32)) {
        self.gather([&mut *m, &mut *v], g);
        *weight -= rate * (*m * c1) / ((*v * c2).sqrt() + EPSILON);
    }
}

/// Additions, multiplications, roots and divisions of an update.
pub const UPDATE_OPERATIONS: usize = 15;

/// Moments of a network's weights.
#[derive(Default)]
pub struct Moments {
    /// First moments.
    pub m: Vec<f32>,
    /// Second moments.
    pub v: Vec<f32>,
    /// Updates so far.
    pub updates: u32,
    /// The bases of every layer, in which its moments are then; none under plain Adam.
    pub bases: Vec<Soap>,
}

impl Moments {
    /// Zero moments of `n` weights.
    pub fn new(n: usize, bases: Vec<Soap>) -> Self {
        Self { m: vec![0.0; n], v: vec![0.0; n], updates: 0, bases }
    }

    /// Operations of an update.
    pub fn operations(&self) -> usize {
        UPDATE_OPERATIONS * self.m.len() + self.bases.iter().map(Soap::operations).sum::<usize>()
    }

    /// One update of all weights, which lie in one array after another; `gradient` is that of all of them.
    pub fn step<'a>(
        &mut self,
        simd: Level,
        weights: impl Iterator<Item = &'a mut [f32]>,
        mut gradient: &[f32],
        rate: f32,
        adam: &Adam,
    ) {
        self.updates = self.updates.saturating_add(1);
        let c = adam.corrections(self.updates);
        let (mut m, mut v) = (&mut self.m[..], &mut self.v[..]);
        for (layer, weights) in (0..).zip(weights) {
            let (g, rest_g) = gradient.split_at(weights.len());
            let (here_m, rest_m) = m.split_at_mut(weights.len());
            let (here_v, rest_v) = v.split_at_mut(weights.len());
            (gradient, m, v) = (rest_g, rest_m, rest_v);
            if let Some(soap) = self.bases.get_mut(layer) {
                let at = (layer as u32, self.updates);
                soap.step(simd, weights, g, [here_m, here_v], at, rate, adam);
                continue;
            }
            dispatch!(simd, simd => simd.vectorize(
                #[inline(always)]
                || {
                    let moments = here_m.iter_mut().zip(here_v);
                    for ((w, &g), (m, v)) in weights.iter_mut().zip(g).zip(moments) {
                        adam.update(w, [m, v], g, rate, c);
                    }
                },
            ));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use relight_field::random::Random;

    #[test]
    fn moments_step_like_plain_adam() {
        for beta2 in [0.99, 0.999] {
            moments_step_with(beta2);
        }
    }

    fn moments_step_with(beta2: f64) {
        const WEIGHTS: usize = 75;
        let (random, rate, adam) = (Random::new(1, 0), 0.01, Adam::new(beta2));
        let mut weights: Vec<f32> = (0..WEIGHTS as u64).map(|i| random.uniform_at(i) - 0.5).collect();
        let mut moments = Moments::new(WEIGHTS, Vec::new());
        let mut plain: Vec<[f64; 3]> = weights.iter().map(|&w| [f64::from(w), 0.0, 0.0]).collect();
        for step in 1..=30 {
            // Magnitudes from 1e-9 to 1e3: Adam's step depends on none of them.
            let gradient: Vec<f32> = (0..WEIGHTS)
                .map(|i| {
                    (random.uniform_at((100 * step + i) as u64) - 0.4) * 10f32.powi(2 * (i % 7) as i32 - 9)
                })
                .collect();
            moments.step(Level::new(), weights.chunks_mut(40), &gradient, rate, &adam);
            for ([w, m, v], &g) in plain.iter_mut().zip(&gradient) {
                let g = f64::from(g);
                *m = 0.9 * *m + 0.1 * g;
                *v = beta2 * *v + (1.0 - beta2) * g * g;
                let (m, v) = (*m / (1.0 - 0.9f64.powi(step as i32)), *v / (1.0 - beta2.powi(step as i32)));
                *w -= f64::from(rate) * m / (v.sqrt() + 1e-15);
            }
        }
        assert_eq!(moments.updates, 30);
        for (ours, [plain, ..]) in weights.iter().zip(&plain) {
            assert!((f64::from(*ours) - plain).abs() < 1e-5, "{ours} {plain}");
        }
    }

    #[test]
    fn corrections_fade_to_one() {
        let adam = Adam::new(0.999);
        let (c1, c2) = adam.corrections(1);
        assert!((c1 - 10.0).abs() < 1e-4 && (c2 - 1000.0).abs() < 0.1, "{c1} {c2}");
        let last = adam.corrections(1 << 14);
        assert!((last.0 - 1.0).abs() < 1e-6 && (last.1 - 1.0).abs() < 1e-6, "{last:?}");
        assert_eq!(adam.corrections(u32::MAX), (1.0, 1.0));
    }
}
