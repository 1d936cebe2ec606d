//! Homographies between planes.

use nalgebra::{Matrix3, SMatrix, SVector, SymmetricEigen, Vector2, Vector3};

/// The smallest share of the points' spread that their narrow side must have: below, they lie on a line.
const NARROWEST: f64 = 1e-3;
/// The homography is one answer only if the smallest singular value is this much smaller than the next, and the next is no
/// rounding error of the largest.
const SMALLEST: f64 = 0.3;
const ROUNDING: f64 = 1e-5;

/// The homography that takes each first point of the pairs to its second, by the normalised direct linear transform (Hartley
/// and Zisserman, Multiple View Geometry, algorithm 4.2); least squares in the algebraic error. `None` with fewer than four
/// pairs, points on a line, or no one answer.
pub(super) fn fit(pairs: &[(Vector2<f64>, Vector2<f64>)]) -> Option<Matrix3<f64>> {
    if pairs.len() < 4 {
        return None;
    }
    let from = Normalisation::of(pairs.iter().map(|pair| pair.0))?;
    let to = Normalisation::of(pairs.iter().map(|pair| pair.1))?;
    let mut gram = SMatrix::<f64, 9, 9>::zeros();
    for (a, b) in pairs {
        let (a, b) = (from.apply(*a), to.apply(*b));
        for (row, value) in [(0, b.x), (3, b.y)] {
            let mut equation = SVector::<f64, 9>::zeros();
            for (k, v) in [a.x, a.y, 1.0].into_iter().enumerate() {
                equation[row + k] = v;
                equation[6 + k] = -value * v;
            }
            gram += equation * equation.transpose();
        }
    }
    let eigen = SymmetricEigen::new(gram);
    let mut order: [usize; 9] = std::array::from_fn(|i| i);
    order.sort_by(|&i, &j| eigen.eigenvalues[i].total_cmp(&eigen.eigenvalues[j]));
    let singular = |i: usize| eigen.eigenvalues[order[i]].max(0.0).sqrt();
    if singular(0) >= SMALLEST * singular(1) || singular(1) <= ROUNDING * singular(8) {
        return None;
    }
    let h = eigen.eigenvectors.column(order[0]);
    let h = Matrix3::from_fn(|i, j| h[3 * i + j]);
    let h = to.matrix().try_inverse()? * h * from.matrix();
    let h = h / h.norm();
    h.iter().all(|v| v.is_finite()).then_some(h)
}

/// Where a homography takes a point, and the Jacobian there; `None` at infinity.
pub(super) fn apply(h: &Matrix3<f64>, at: Vector2<f64>) -> Option<(Vector2<f64>, nalgebra::Matrix2<f64>)> {
    let p = h * Vector3::new(at.x, at.y, 1.0);
    let to = Vector2::new(p.x / p.z, p.y / p.z);
    let jacobian = nalgebra::Matrix2::from_fn(|i, j| (h[(i, j)] - to[i] * h[(2, j)]) / p.z);
    (to.iter().chain(jacobian.iter()).all(|v| v.is_finite())).then_some((to, jacobian))
}

/// Moves points to their mean and scales them to a mean square of two.
struct Normalisation {
    mean: Vector2<f64>,
    scale: f64,
}

impl Normalisation {
    /// `None` if the points lie on a line.
    fn of(points: impl Iterator<Item = Vector2<f64>> + Clone) -> Option<Normalisation> {
        let count = points.clone().count() as f64;
        let mean = points.clone().sum::<Vector2<f64>>() / count;
        let spread =
            points.map(|p| (p - mean) * (p - mean).transpose()).sum::<nalgebra::Matrix2<f64>>() / count;
        let values = SymmetricEigen::new(spread).eigenvalues;
        let (narrow, wide) = (values.min().max(0.0), values.max());
        let is_plane = narrow > NARROWEST * NARROWEST * wide;
        is_plane.then(|| Normalisation { mean, scale: (2.0 / (narrow + wide)).sqrt() })
    }

    fn apply(&self, p: Vector2<f64>) -> Vector2<f64> {
        (p - self.mean) * self.scale
    }

    fn matrix(&self) -> Matrix3<f64> {
        let (s, m) = (self.scale, self.mean);
        Matrix3::new(s, 0.0, -s * m.x, 0.0, s, -s * m.y, 0.0, 0.0, 1.0)
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    proptest! {
        #[test]
        fn exact_pairs_give_the_homography_back(
            entries in prop::array::uniform8(-0.4..0.4f64),
            points in prop::collection::vec((-1.0..1.0f64, -1.0..1.0f64), 0..20),
        ) {
            let h = Matrix3::identity()
                + Matrix3::from_fn(|i, j| entries.get(3 * i + j).copied().unwrap_or(0.0) * if i == 2 { 0.5 } else { 1.0 });
            let corners = [(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)];
            let pairs: Vec<_> = points
                .into_iter()
                .chain(corners)
                .map(|(x, y)| (Vector2::new(x, y), apply(&h, Vector2::new(x, y)).unwrap().0))
                .collect();
            prop_assume!(h.determinant().abs() > 0.05);
            let found = fit(&pairs).unwrap();
            for (from, to) in pairs {
                prop_assert!((apply(&found, from).unwrap().0 - to).norm() < 1e-8);
            }
        }
    }

    #[test]
    fn the_jacobian_is_the_derivative() {
        let h = Matrix3::new(1.1, 0.2, 3.0, -0.1, 0.9, 1.0, 0.01, -0.02, 1.0);
        let at = Vector2::new(2.0, -1.0);
        let (_, jacobian) = apply(&h, at).unwrap();
        for axis in 0..2 {
            let mut step = Vector2::zeros();
            step[axis] = 1e-6;
            let slope = (apply(&h, at + step).unwrap().0 - apply(&h, at - step).unwrap().0) / 2e-6;
            assert!((jacobian.column(axis) - slope).norm() < 1e-8);
        }
    }

    #[test]
    fn points_on_a_line_give_none() {
        let pairs: Vec<_> = (0..6)
            .map(|i| (Vector2::new(f64::from(i), 2.0), Vector2::new(f64::from(i) * 2.0, 1.0)))
            .collect();
        assert_eq!(fit(&pairs), None);
        assert_eq!(fit(&pairs[..3]), None);
    }

    #[test]
    fn three_points_of_four_on_a_line_give_none() {
        let points = [(0.0, 0.0), (1.0, 0.0), (2.0, 0.0), (1.0, 1.0)].map(|(x, y)| Vector2::new(x, y));
        assert_eq!(fit(&points.map(|p| (p, p))), None);
    }
}
