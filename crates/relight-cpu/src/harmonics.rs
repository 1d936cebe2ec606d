//! Spherical harmonics of a tile of directions, `zeta` in the paper.

use fearless_simd::{Level, Simd, dispatch, prelude::*};
use relight_field::architecture::HARMONICS;

/// Writes the first 16 real harmonics of the unit vectors `(x, y, z)` to the rows of `out`, `[16][columns]`, in the
/// order and sign of tiny-cuda-nn. `columns` is a multiple of [`crate::dense::COLUMN_ALIGN`].
pub fn spherical_harmonics(level: Level, [x, y, z]: [&[f32]; 3], out: &mut [f32]) {
    let columns = x.len();
    let (y, z, out) = (&y[..columns], &z[..columns], &mut out[..HARMONICS * columns]);
    dispatch!(level, simd => harmonics_simd(simd, x, y, z, out, columns));
}

#[inline(always)]
fn harmonics_simd<S: Simd>(simd: S, x: &[f32], y: &[f32], z: &[f32], out: &mut [f32], columns: usize) {
    let lanes = S::f32s::LEN;
    for c in (0..columns).step_by(lanes) {
        let x = S::f32s::from_slice(simd, &x[c..c + lanes]);
        let y = S::f32s::from_slice(simd, &y[c..c + lanes]);
        let z = S::f32s::from_slice(simd, &z[c..c + lanes]);
        let (xx, yy, zz) = (x * x, y * y, z * z);
        let one = S::f32s::splat(simd, 1.0);
        let values = [
            one * 0.282_094_8,
            y * -0.488_602_5,
            z * 0.488_602_5,
            x * -0.488_602_5,
            x * y * 1.092_548_4,
            y * z * -1.092_548_4,
            zz * 0.946_174_7 - 0.315_391_57,
            x * z * -1.092_548_4,
            (xx - yy) * 0.546_274_2,
            y * (yy - xx * 3.0) * 0.590_043_6,
            x * y * z * 2.890_611_4,
            y * (one - zz * 5.0) * 0.457_045_8,
            z * (zz * 5.0 - 3.0) * 0.373_176_34,
            x * (one - zz * 5.0) * 0.457_045_8,
            z * (xx - yy) * 1.445_305_7,
            x * (yy * 3.0 - xx) * 0.590_043_6,
        ];
        for (value, row) in values.iter().zip(out.chunks_exact_mut(columns)) {
            value.store_slice(&mut row[c..c + lanes]);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dense::tests::levels;
    use relight_field::encoding::spherical_harmonics::encode;
    use relight_field::random::Random;

    #[test]
    fn every_instruction_set_agrees_with_the_reference() {
        const COLUMNS: usize = 48;
        let random = Random::new(3, 0);
        let mut directions: Vec<[f32; 3]> = (0..COLUMNS as u64)
            .map(|i| {
                let v = [0, 1, 2].map(|a| random.uniform_at(3 * i + a) - 0.5);
                let norm = v.iter().map(|x| x * x).sum::<f32>().sqrt();
                v.map(|x| x / norm)
            })
            .collect();
        directions[..3].copy_from_slice(&[[1.0, 0.0, 0.0], [0.0, -1.0, 0.0], [0.0, 0.0, 1.0]]);
        let [x, y, z] = [0, 1, 2].map(|a| directions.iter().map(|d| d[a]).collect::<Vec<f32>>());
        for level in levels() {
            let mut out = vec![f32::NAN; HARMONICS * COLUMNS];
            spherical_harmonics(level, [&x, &y, &z], &mut out);
            for (c, direction) in directions.iter().enumerate() {
                for (i, plain) in encode(direction.map(f64::from)).into_iter().enumerate() {
                    let ours = f64::from(out[i * COLUMNS + c]);
                    assert!((ours - plain).abs() < 1e-6, "{level:?}, {direction:?}, {i}: {ours} {plain}");
                }
            }
        }
    }
}
