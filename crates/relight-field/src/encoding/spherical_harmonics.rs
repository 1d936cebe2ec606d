//! The direction code `zeta`: the first 16 real spherical harmonics, bands 0 to 3.

use crate::architecture::HARMONICS;
use crate::real::Real;

/// `zeta` of a unit direction `[x, y, z]`, in the order and with the signs of tiny-cuda-nn's and torch-ngp's degree 4
/// (Condon-Shortley phase; band by band, order -l to l).
pub fn encode<R: Real>([x, y, z]: [R; 3]) -> [R; HARMONICS] {
    let c = R::from_f64;
    let (xx, yy, zz) = (x * x, y * y, z * z);
    [
        c(0.282_094_791_773_878_14),
        c(-0.488_602_511_902_919_87) * y,
        c(0.488_602_511_902_919_87) * z,
        c(-0.488_602_511_902_919_87) * x,
        c(1.092_548_430_592_079_2) * x * y,
        c(-1.092_548_430_592_079_2) * y * z,
        c(0.946_174_695_757_56) * zz - c(0.315_391_565_252_52),
        c(-1.092_548_430_592_079_2) * x * z,
        c(0.546_274_215_296_039_6) * (xx - yy),
        c(0.590_043_589_926_643_5) * y * (yy - c(3.0) * xx),
        c(2.890_611_442_640_554) * x * y * z,
        c(0.457_045_799_464_465_7) * y * (R::ONE - c(5.0) * zz),
        c(0.373_176_332_590_115_4) * z * (c(5.0) * zz - c(3.0)),
        c(0.457_045_799_464_465_7) * x * (R::ONE - c(5.0) * zz),
        c(1.445_305_721_320_277) * z * (xx - yy),
        c(0.590_043_589_926_643_5) * x * (c(3.0) * yy - xx),
    ]
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Real spherical harmonics are orthonormal over the sphere: `integral of Y_i Y_j = [i = j]`.
    #[test]
    fn harmonics_are_orthonormal() {
        // Midpoints in height and angle are an equal-area rule, exact in the angle for these degrees.
        let (heights, angles) = (400, 16);
        let mut gram = [[0.0; HARMONICS]; HARMONICS];
        for i in 0..heights {
            let z = (2.0 * f64::from(i) + 1.0) / f64::from(heights) - 1.0;
            let rim = (1.0 - z * z).sqrt();
            for j in 0..angles {
                let phi = std::f64::consts::TAU * f64::from(j) / f64::from(angles);
                let code = encode([rim * phi.cos(), rim * phi.sin(), z]);
                for (row, a) in gram.iter_mut().zip(code) {
                    for (cell, b) in row.iter_mut().zip(code) {
                        *cell += a * b * 4.0 * std::f64::consts::PI / f64::from(heights * angles);
                    }
                }
            }
        }
        for (i, row) in gram.iter().enumerate() {
            for (j, &cell) in row.iter().enumerate() {
                let expected = f64::from(u8::from(i == j));
                assert!((cell - expected).abs() < 1e-4, "{i} {j} {cell}");
            }
        }
    }
}
