//! `exp` in vectors, and what is made of it. The library's is called number by number.

use fearless_simd::{Level, Simd, dispatch};

/// Beyond these, `exp` leaves the normal numbers of single precision.
const LIMITS: (f32, f32) = (-87.0, 88.0);
/// 1.5 * 2^23: numbers so large have no fraction, so what is added to it is rounded.
const ROUNDING: f32 = 12_582_912.0;
/// ln 2, of which the first part has few enough bits for its products with whole numbers to be exact.
const LN_2: [f32; 2] = [0.693_359_4, -2.121_944_4e-4];
/// `exp(r) = 1 + r + r^2 p(r)` where `r` is at most half of ln 2 (Moshier 1992, Cephes), highest power first.
const POLYNOMIAL: [f32; 6] = [1.987_569_1e-4, 1.398_2e-3, 8.333_452e-3, 4.166_579_6e-2, 1.666_666_5e-1, 0.5];

/// `exp(x)` to some 1e-7 of itself, `x` taken to within -87..88; written so that compilers make vectors of it.
#[inline(always)]
fn exp(x: f32) -> f32 {
    let x = x.clamp(LIMITS.0, LIMITS.1);
    let shifted = x.mul_add(std::f32::consts::LOG2_E, ROUNDING);
    let whole = shifted - ROUNDING;
    let r = LN_2.iter().fold(x, |r, part| whole.mul_add(-part, r));
    let p = POLYNOMIAL.iter().fold(0.0, |p: f32, &c| p.mul_add(r, c));
    let of_rest = (p * r).mul_add(r, r) + 1.0;
    // The whole number lies in the lowest bits of `shifted`: to the exponent with it.
    of_rest * f32::from_bits((shifted.to_bits() << 23).wrapping_add(1f32.to_bits()))
}

/// Replaces all numbers by their `exp`.
pub fn exponentials(level: Level, values: &mut [f32]) {
    dispatch!(level, simd => simd.vectorize(
        #[inline(always)]
        || values.iter_mut().for_each(|value| *value = exp(*value)),
    ));
}

/// `results = 1 / (1 + exp(-values))`.
pub fn sigmoid(level: Level, values: &[f32], results: &mut [f32]) {
    dispatch!(level, simd => simd.vectorize(
        #[inline(always)]
        || results.iter_mut().zip(values).for_each(|(result, &x)| *result = 1.0 / (1.0 + exp(-x))),
    ));
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dense::tests::levels;

    /// Numbers of all sizes within the limits, and what lies beyond.
    fn numbers() -> Vec<f32> {
        let within = (-8700..=8800).map(|i| i as f32 / 100.0 + 0.001);
        within.chain([0.0, -0.0, 1e-30, -1e4, 1e30, f32::INFINITY, f32::NEG_INFINITY]).collect()
    }

    #[test]
    fn exponentials_are_the_librarys() {
        for level in levels() {
            let mut results = numbers();
            exponentials(level, &mut results);
            for (x, ours) in numbers().into_iter().zip(results) {
                let plain = f64::from(x.clamp(LIMITS.0, LIMITS.1)).exp();
                assert!(
                    (f64::from(ours) / plain - 1.0).abs() < 3e-7,
                    "{level:?}, {x}: {ours} is not {plain}"
                );
            }
        }
    }

    #[test]
    fn sigmoids_are_the_librarys() {
        for level in levels() {
            let mut results = vec![f32::NAN; numbers().len()];
            sigmoid(level, &numbers(), &mut results);
            for (x, ours) in numbers().into_iter().zip(results) {
                let plain = 1.0 / (1.0 + (-f64::from(x)).exp());
                assert!((f64::from(ours) - plain).abs() < 2e-7, "{level:?}, {x}: {ours} is not {plain}");
            }
        }
    }

    #[test]
    fn what_is_not_a_number_stays_none() {
        for level in levels() {
            let mut values = [f32::NAN; 20];
            exponentials(level, &mut values);
            assert!(values.iter().all(|v| v.is_nan()), "{level:?}");
        }
    }
}
