//! Adam (Kingma and Ba 2015): the update of one number, whoever's it is.

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

#[cfg(test)]
mod tests {
    use super::*;

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
