//! Adam (Kingma and Ba 2015), for the networks densely and for single grid entries.

/// Decay of the first moment.
pub const BETA1: f32 = 0.9;
/// Decay of the second moment; torch's default, as the paper says.
pub const BETA2: f32 = 0.999;
/// Keeps the division finite; torch-ngp's value.
pub const EPSILON: f32 = 1e-15;

/// `1 / (1 - beta1^n)` and `1 / (1 - beta2^n)` for the `n`-th update, computed once: grid entries each have their
/// own `n`.
pub struct BiasCorrection {
    table: Vec<(f32, f32)>,
}

impl BiasCorrection {
    /// Updates after which both corrections differ from 1 by less than single precision shows.
    const LENGTH: i32 = 1 << 14;

    /// Corrections of update `n`, counted from 1.
    pub fn at(&self, n: u32) -> (f32, f32) {
        self.table.get(n as usize - 1).copied().unwrap_or((1.0, 1.0))
    }
}

impl Default for BiasCorrection {
    fn default() -> Self {
        let correction = |beta: f32, n: i32| (1.0 / (1.0 - f64::from(beta).powi(n))) as f32;
        Self { table: (1..=Self::LENGTH).map(|n| (correction(BETA1, n), correction(BETA2, n))).collect() }
    }
}

/// Additions, multiplications, roots and divisions of an update.
pub const UPDATE_OPERATIONS: usize = 15;

/// One update of one weight.
#[inline(always)]
pub fn update(weight: &mut f32, m: &mut f32, v: &mut f32, g: f32, rate: f32, (c1, c2): (f32, f32)) {
    *m = BETA1 * *m + (1.0 - BETA1) * g;
    *v = BETA2 * *v + (1.0 - BETA2) * g * g;
    *weight -= rate * (*m * c1) / ((*v * c2).sqrt() + EPSILON);
}

/// Moments of a network's weights.
#[derive(Clone, Default)]
pub struct Moments {
    /// First moments.
    pub m: Vec<f32>,
    /// Second moments.
    pub v: Vec<f32>,
    /// Updates so far.
    pub updates: u32,
}

impl Moments {
    /// Zero moments of `n` weights.
    pub fn new(n: usize) -> Self {
        Self { m: vec![0.0; n], v: vec![0.0; n], updates: 0 }
    }

    /// One update of all weights.
    pub fn step<'a>(
        &mut self,
        weights: impl Iterator<Item = &'a mut f32>,
        gradient: &[f32],
        rate: f32,
        correction: &BiasCorrection,
    ) {
        self.updates = self.updates.saturating_add(1);
        let c = correction.at(self.updates);
        let moments = self.m.iter_mut().zip(&mut self.v);
        for ((w, &g), (m, v)) in weights.zip(gradient).zip(moments) {
            update(w, m, v, g, rate, c);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use relight_field::random::Random;

    #[test]
    fn moments_step_like_plain_adam() {
        const WEIGHTS: usize = 7;
        let (random, rate, correction) = (Random::new(1, 0), 0.01, BiasCorrection::default());
        let mut weights: Vec<f32> = (0..WEIGHTS as u64).map(|i| random.uniform_at(i) - 0.5).collect();
        let mut moments = Moments::new(WEIGHTS);
        let mut plain: Vec<[f64; 3]> = weights.iter().map(|&w| [f64::from(w), 0.0, 0.0]).collect();
        for step in 1..=30 {
            // Magnitudes from 1e-9 to 1e3: Adam's step depends on none of them.
            let gradient: Vec<f32> = (0..WEIGHTS)
                .map(|i| (random.uniform_at((100 * step + i) as u64) - 0.4) * 10f32.powi(2 * i as i32 - 9))
                .collect();
            moments.step(weights.iter_mut(), &gradient, rate, &correction);
            for ([w, m, v], &g) in plain.iter_mut().zip(&gradient) {
                let g = f64::from(g);
                *m = 0.9 * *m + 0.1 * g;
                *v = 0.999 * *v + 0.001 * g * g;
                let (m, v) = (*m / (1.0 - 0.9f64.powi(step as i32)), *v / (1.0 - 0.999f64.powi(step as i32)));
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
        let correction = BiasCorrection::default();
        let (c1, c2) = correction.at(1);
        assert!((c1 - 10.0).abs() < 1e-4 && (c2 - 1000.0).abs() < 0.1, "{c1} {c2}");
        let last = correction.at(1 << 14);
        assert!((last.0 - 1.0).abs() < 1e-6 && (last.1 - 1.0).abs() < 1e-6, "{last:?}");
        assert_eq!(correction.at(u32::MAX), (1.0, 1.0));
    }
}
