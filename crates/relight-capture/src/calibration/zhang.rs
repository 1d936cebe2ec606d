//! A first guess of the lens from homographies.

use nalgebra::{Matrix2, Matrix3, Vector2};

use super::lens::Lens;

/// The least ratio of the eigenvalues of the equations for the focal lengths: below, the views do not determine them.
const UNDETERMINED: f64 = 1e-9;

/// Focal lengths from homographies of one plane: the images of its axes are of equal length and at right angles (Zhang, A
/// Flexible New Technique for Camera Calibration, 2000), solved by least squares with the principal point in the image's middle
/// and no distortion. `None` if the homographies do not determine them: views from straight ahead say nothing.
pub(super) fn first_guess(homographies: &[Matrix3<f64>], width: u32, height: u32) -> Option<Lens> {
    let (cx, cy) = ((f64::from(width) - 1.0) / 2.0, (f64::from(height) - 1.0) / 2.0);
    // Focal lengths in units of the image's size keep the numbers near one.
    let unit = f64::from(width.max(height));
    let to_middle = Matrix3::new(1.0 / unit, 0.0, -cx / unit, 0.0, 1.0 / unit, -cy / unit, 0.0, 0.0, 1.0);
    let (mut normal, mut slope) = (Matrix2::zeros(), Vector2::zeros());
    for homography in homographies {
        let h = to_middle * homography;
        let h = h / h.column(0).norm();
        let (a, b) = (h.column(0), h.column(1));
        let orthogonal = (Vector2::new(a.x * b.x, a.y * b.y), a.z * b.z);
        let equal = (Vector2::new(a.x * a.x - b.x * b.x, a.y * a.y - b.y * b.y), a.z * a.z - b.z * b.z);
        for (row, known) in [orthogonal, equal] {
            normal += row * row.transpose();
            slope -= row * known;
        }
    }
    let eigenvalues = normal.symmetric_eigenvalues();
    if eigenvalues.min() <= UNDETERMINED * eigenvalues.max() {
        return None;
    }
    let inverse_squares = normal.try_inverse()? * slope;
    let [fx, fy] = [0, 1].map(|i| unit / inverse_squares[i].sqrt());
    (fx.is_finite() && fy.is_finite()).then(|| Lens::pinhole(fx, fy, cx, cy))
}
