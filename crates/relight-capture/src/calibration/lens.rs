//! A pinhole with OpenCV's five-coefficient lens, and how its pixels move with its parameters.

use nalgebra::{SMatrix, SVector, Vector2, Vector3};
use relight_scene::Intrinsics;

/// Number of parameters of the lens.
pub(super) const LENS: usize = 9;

/// `fx fy cx cy k1 k2 p1 p2 k3`: pixels, then OpenCV's distortion coefficients in its order.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Lens(pub(super) SVector<f64, LENS>);

/// Where a point of the camera's frame appears, and the derivatives of that.
pub(super) struct Projection {
    pub(super) pixel: Vector2<f64>,
    pub(super) by_point: SMatrix<f64, 2, 3>,
    pub(super) by_lens: SMatrix<f64, 2, LENS>,
}

impl Lens {
    /// A lens without distortion.
    pub(super) fn pinhole(fx: f64, fy: f64, cx: f64, cy: f64) -> Lens {
        Lens(SVector::from([fx, fy, cx, cy, 0.0, 0.0, 0.0, 0.0, 0.0]))
    }

    /// `None` if there are more coefficients than this lens has.
    pub(super) fn of(intrinsics: &Intrinsics) -> Option<Lens> {
        let Intrinsics { fx, fy, cx, cy, ref distortion, .. } = *intrinsics;
        let mut lens = Lens::pinhole(fx, fy, cx, cy);
        for (i, coefficient) in distortion.iter().enumerate() {
            *lens.0.get_mut(4 + i)? = *coefficient;
        }
        Some(lens)
    }

    pub(super) fn intrinsics(&self, width: u32, height: u32) -> Intrinsics {
        let [fx, fy, cx, cy, k1, k2, p1, p2, k3] = self.0.into();
        Intrinsics { width, height, fx, fy, cx, cy, distortion: vec![k1, k2, p1, p2, k3] }
    }

    /// The mean of both focal lengths, pixels.
    pub(super) fn focal_length(&self) -> f64 {
        (self.0[0] + self.0[1]) / 2.0
    }

    /// `None` behind the camera.
    pub(super) fn project(&self, p: &Vector3<f64>) -> Option<Projection> {
        if p.z <= 0.0 {
            return None;
        }
        let [fx, fy, cx, cy, k1, k2, p1, p2, k3] = self.0.into();
        let (x, y) = (p.x / p.z, p.y / p.z);
        let r2 = x * x + y * y;
        let radial = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3));
        let by_r2 = k1 + r2 * (2.0 * k2 + r2 * 3.0 * k3);
        let bent = Vector2::new(
            x * radial + 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x),
            y * radial + p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y,
        );
        let cross = 2.0 * x * y * by_r2 + 2.0 * p1 * x + 2.0 * p2 * y;
        let by_x = [radial + 2.0 * x * x * by_r2 + 2.0 * p1 * y + 6.0 * p2 * x, cross];
        let by_y = [cross, radial + 2.0 * y * y * by_r2 + 6.0 * p1 * y + 2.0 * p2 * x];
        let focal = [fx, fy];
        let by_point = SMatrix::from_fn(|i, j| {
            focal[i]
                * match j {
                    0 => by_x[i] / p.z,
                    1 => by_y[i] / p.z,
                    _ => -(by_x[i] * x + by_y[i] * y) / p.z,
                }
        });
        let (r4, r6) = (r2 * r2, r2 * r2 * r2);
        let xy = 2.0 * x * y;
        #[rustfmt::skip]
        let by_lens = SMatrix::from_row_slice(&[
            bent.x, 0.0, 1.0, 0.0, fx * x * r2, fx * x * r4, fx * xy, fx * (r2 + 2.0 * x * x), fx * x * r6,
            0.0, bent.y, 0.0, 1.0, fy * y * r2, fy * y * r4, fy * (r2 + 2.0 * y * y), fy * xy, fy * y * r6,
        ]);
        let pixel = Vector2::new(fx * bent.x + cx, fy * bent.y + cy);
        pixel.iter().all(|v| v.is_finite()).then_some(Projection { pixel, by_point, by_lens })
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn lens() -> Lens {
        Lens(SVector::from([2321.0, 2388.0, 868.0, 454.0, -0.11, 0.14, 0.0011, -0.0007, 0.05]))
    }

    proptest! {
        #[test]
        fn it_projects_as_the_scene_does(x in -0.4..0.4f64, y in -0.4..0.4f64, z in 0.3..2.0f64) {
            let pixel = lens().project(&Vector3::new(x * z, y * z, z)).unwrap().pixel;
            let same = lens().intrinsics(1440, 1080).project([x * z, y * z, z]).unwrap();
            prop_assert!((pixel - Vector2::from(same)).norm() < 1e-9);
        }

        #[test]
        fn derivatives_are_those_of_differences(x in -0.3..0.3f64, y in -0.3..0.3f64, z in 0.4..1.0f64) {
            let point = Vector3::new(x, y, z);
            let at = lens().project(&point).unwrap();
            let slope = |ahead: Projection, behind: Projection, step: f64| (ahead.pixel - behind.pixel) / (2.0 * step);
            for i in 0..3 {
                let mut step = Vector3::zeros();
                step[i] = 1e-6;
                let seen = slope(lens().project(&(point + step)).unwrap(), lens().project(&(point - step)).unwrap(), 1e-6);
                prop_assert!((at.by_point.column(i) - seen).norm() < 1e-4 * (1.0 + seen.norm()), "point {i}");
            }
            for i in 0..LENS {
                let mut step = SVector::zeros();
                step[i] = 1e-4;
                let seen = slope(
                    Lens(lens().0 + step).project(&point).unwrap(),
                    Lens(lens().0 - step).project(&point).unwrap(),
                    1e-4,
                );
                prop_assert!((at.by_lens.column(i) - seen).norm() < 1e-4 * (1.0 + seen.norm()), "lens {i}");
            }
        }
    }

    #[test]
    fn nothing_is_seen_behind_the_camera() {
        assert!(lens().project(&Vector3::new(0.0, 0.0, -1.0)).is_none());
        assert!(lens().project(&Vector3::new(0.1, 0.0, 0.0)).is_none());
    }
}
