//! Smooth motion through given poses.

use glam::{DMat3, DQuat, DVec3};
use relight_scene::Pose;

/// The pose at `u` in `0..=n - 1`, where pose number `i` of the `n` is passed at `u = i`: rotations by slerp, positions
/// by the centripetal Catmull-Rom spline (Yuksel et al. 2011), which neither loops nor overshoots between close poses.
/// `None` if there are no poses.
pub(crate) fn interpolate(poses: &[Pose], u: f64) -> Option<Pose> {
    let last = poses.len().checked_sub(1)?;
    let from = (u.max(0.0) as usize).min(last.saturating_sub(1));
    let to = (from + 1).min(last);
    let t = (u - from as f64).clamp(0.0, 1.0);
    let (p1, p2) = (position(&poses[from]), position(&poses[to]));
    // Beyond the ends the path goes on straight.
    let p0 = if from > 0 { position(&poses[from - 1]) } else { 2.0 * p1 - p2 };
    let p3 = if to < last { position(&poses[to + 1]) } else { 2.0 * p2 - p1 };
    let rotation = rotation(&poses[from]).slerp(rotation(&poses[to]), t);
    Some(pose(rotation, catmull_rom([p0, p1, p2, p3], t)))
}

/// The point at `t` in 0..=1 between the inner two of four points, by the pyramid of Barry and Goldman (1988).
fn catmull_rom([p0, p1, p2, p3]: [DVec3; 4], t: f64) -> DVec3 {
    let knot = |a: DVec3, b: DVec3| a.distance(b).sqrt();
    let inner = knot(p1, p2);
    if inner == 0.0 {
        return p1;
    }
    // A pose held for a while has no direction to come from or go to: there the path starts and ends straight.
    let p0 = if p0 == p1 { 2.0 * p1 - p2 } else { p0 };
    let p3 = if p3 == p2 { 2.0 * p2 - p1 } else { p3 };
    let (k0, k1, k2, k3) = (-knot(p0, p1), 0.0, inner, inner + knot(p2, p3));
    let x = t * inner;
    let mix = |a: DVec3, b: DVec3, from: f64, to: f64| a.lerp(b, (x - from) / (to - from));
    let (a1, a2, a3) = (mix(p0, p1, k0, k1), mix(p1, p2, k1, k2), mix(p2, p3, k2, k3));
    mix(mix(a1, a2, k0, k2), mix(a2, a3, k1, k3), k1, k2)
}

/// The rotation part of a pose.
pub(crate) fn rotation(pose: &Pose) -> DQuat {
    let [x, y, z] = pose.0.map(|row| DVec3::new(row[0], row[1], row[2]));
    DQuat::from_mat3(&DMat3::from_cols(x, y, z).transpose())
}

/// The pose of a rotation and a position.
pub(crate) fn pose(rotation: DQuat, position: DVec3) -> Pose {
    let rows = DMat3::from_quat(rotation).transpose();
    let row = |axis: DVec3, t: f64| [axis.x, axis.y, axis.z, t];
    Pose([row(rows.x_axis, position.x), row(rows.y_axis, position.y), row(rows.z_axis, position.z)])
}

fn position(pose: &Pose) -> DVec3 {
    DVec3::from_array(pose.position())
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn poses() -> impl Strategy<Value = Vec<Pose>> {
        let coordinate = || prop_oneof![Just(0.0), -1.0..1.0f64];
        let pose = (proptest::array::uniform3(coordinate()), proptest::array::uniform3(-1.0..1.0f64))
            .prop_map(|(position, target)| Pose::look_at(position, target));
        proptest::collection::vec(pose, 1..6)
    }

    fn distance(a: &Pose, b: &Pose) -> f64 {
        a.0.iter().flatten().zip(b.0.iter().flatten()).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max)
    }

    proptest! {
        #[test]
        fn passes_through_every_pose_and_stays_rigid(poses in poses(), u in 0.0..1.0f64) {
            for (i, pose) in poses.iter().enumerate() {
                prop_assert!(distance(&interpolate(&poses, i as f64).unwrap(), pose) < 1e-9);
            }
            let between = interpolate(&poses, u * (poses.len() - 1) as f64).unwrap();
            let [p, q] = [[1.0, 2.0, 3.0], [-2.0, 0.5, 1.0]].map(|v| between.rotate(v));
            let dot: f64 = p.iter().zip(q).map(|(p, q)| p * q).sum();
            prop_assert!((dot - 2.0).abs() < 1e-9, "angles and lengths are kept");
            prop_assert!(between.position().iter().all(|c| c.abs() < 3.0));
        }

        #[test]
        fn moves_without_jumps(poses in poses(), u in 0.0..1.0f64) {
            let u = u * (poses.len() - 1) as f64;
            let step = distance(&interpolate(&poses, u).unwrap(), &interpolate(&poses, u + 1e-7).unwrap());
            prop_assert!(step < 1e-4, "{step}");
        }
    }

    #[test]
    fn equal_steps_along_a_line_stay_on_it() {
        let poses: Vec<Pose> =
            (0..4).map(|i| Pose::look_at([f64::from(i), 0.0, 1.0], [f64::from(i), 5.0, 1.0])).collect();
        let middle = interpolate(&poses, 1.5).unwrap();
        assert!(distance(&middle, &Pose::look_at([1.5, 0.0, 1.0], [1.5, 5.0, 1.0])) < 1e-12);
        assert!(interpolate(&[], 0.0).is_none());
    }
}
