//! Keeps only depths that other views confirm.

use crate::descriptor::View;

/// Relative difference within which two views agree on a depth.
const TOLERANCE: f64 = 0.01;

/// World points of `depths[index]` that at least `least` of the `others` see at the same depth: one entry a pixel,
/// `None` where unconfirmed.
pub fn confirmed(
    views: &[View],
    depths: &[Vec<f32>],
    index: usize,
    others: &[usize],
    least: usize,
) -> Vec<Option<[f64; 3]>> {
    let view = &views[index];
    let confirm = |(p, &depth): (usize, &f32)| {
        if depth.is_nan() {
            return None;
        }
        let direction = view.direction((p % view.width) as f64, (p / view.width) as f64);
        let point = view.pose.transform(direction.map(|v| v * f64::from(depth)));
        let agrees = |&o: &usize| {
            let other = &views[o];
            let q = other.pose.inverse_transform(point);
            if q[2] <= 0.0 {
                return false;
            }
            let [u, v] = other.project(q).map(f64::round);
            let inside = u >= 0.0 && v >= 0.0 && u < other.width as f64 && v < other.height as f64;
            inside && {
                let seen = f64::from(depths[o][v as usize * other.width + u as usize]);
                (seen - q[2]).abs() < TOLERANCE * q[2]
            }
        };
        (others.iter().filter(|o| agrees(o)).count() >= least).then_some(point)
    };
    depths[index].iter().enumerate().map(confirm).collect()
}
