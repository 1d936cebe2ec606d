//! The pose code `gamma(R, t)` of a light (section 4.2 of the paper, variant V1).

use crate::architecture::{POSE_CODE, POSE_OCTAVES};
use crate::real::Real;

/// `gamma` of a light's `[R | t]`, row-major, metres: the 12 numbers themselves; then, number by number, the 6 values
/// `sin(2^k v)`, k = 0..5; then all cosines likewise. There is no factor of pi.
pub fn encode<R: Real>(pose: &[R; 12]) -> [R; POSE_CODE] {
    let mut code = [R::ZERO; POSE_CODE];
    let (numbers, waves) = code.split_at_mut(pose.len());
    let (sines, cosines) = waves.split_at_mut(pose.len() * POSE_OCTAVES);
    numbers.copy_from_slice(pose);
    for (n, &v) in pose.iter().enumerate() {
        for k in 0..POSE_OCTAVES {
            let angle = R::from_f64(f64::from(1u32 << k)) * v;
            sines[n * POSE_OCTAVES + k] = angle.sin();
            cosines[n * POSE_OCTAVES + k] = angle.cos();
        }
    }
    code
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_then_sines_then_cosines() {
        let pose: [f64; 12] = std::array::from_fn(|i| 0.1 * i as f64 - 0.4);
        let code = encode(&pose);
        assert_eq!(code[..12], pose);
        // Number 7, octave 5: its sine and its cosine.
        assert_eq!(code[12 + 7 * 6 + 5], (32.0 * pose[7]).sin());
        assert_eq!(code[12 + 72 + 7 * 6 + 5], (32.0 * pose[7]).cos());
    }
}
