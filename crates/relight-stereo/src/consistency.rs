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
            other.pixel(other.project(q)).is_some_and(|pixel| {
                let seen = f64::from(depths[o][pixel]);
                (seen - q[2]).abs() < TOLERANCE * q[2]
            })
        };
        (others.iter().filter(|o| agrees(o)).count() >= least).then_some(point)
    };
    depths[index].iter().enumerate().map(confirm).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use relight_scene::Pose;

    /// Three cameras side by side that look at a wall 2 m away.
    fn views() -> Vec<View> {
        let view = |x: f64| View {
            width: 9,
            height: 7,
            pinhole: [10.0, 10.0, 4.0, 3.0],
            pose: Pose([[1.0, 0.0, 0.0, x], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0]]),
            pixels: Vec::new(),
        };
        [0.0, 0.2, 0.4].map(view).into()
    }

    #[test]
    fn depths_are_kept_if_enough_views_agree() {
        let (views, wall) = (views(), vec![2f32; 63]);
        let mut depths = vec![wall.clone(), wall.clone(), wall];
        let known = |depths: &[Vec<f32>], least| {
            let points = confirmed(&views, depths, 0, &[1, 2], least);
            assert!(points.iter().flatten().all(|p| p[2] == 2.0 || p[2] == 3.0));
            points.iter().flatten().count()
        };
        // A camera 0.2 m to the right sees the wall a pixel further left: the columns at the edge have no partner.
        assert_eq!(known(&depths, 1), 8 * 7);
        assert_eq!(known(&depths, 2), 7 * 7);
        assert_eq!(known(&depths, 3), 0);
        // One wrong, one unknown, and one within the tolerance.
        (depths[0][31], depths[0][32], depths[0][33]) = (3.0, f32::NAN, 2.0);
        (depths[1][32], depths[2][31]) = (2.01, 1.99);
        assert_eq!(known(&depths, 2), 7 * 7 - 2);
        // Views that know nothing confirm nothing.
        depths[2].fill(f32::NAN);
        assert_eq!(known(&depths, 2), 0);
    }
}
