use crate::vector::{norm, sub};
use crate::{Pose, PoseFault};

use super::{SMALL, rows};

fn matrix(pose: &Pose) -> [f64; 16] {
    std::array::from_fn(|i| rows(pose)[i / 4][i % 4])
}

#[test]
fn points_go_to_the_world_and_back() {
    let pose = SMALL.camera(2);
    let p = [0.3, -0.2, 0.7];
    assert!(norm(sub(pose.inverse_transform(pose.transform(p)), p)) < 1e-12);
    assert!(norm(sub(pose.inverse().transform(p), pose.inverse_transform(p))) < 1e-12);
    assert_eq!(pose.transform([0.0; 3]), pose.position());
    assert_eq!(pose.row_major_f32()[3], pose.position()[0] as f32);
    assert_eq!(pose.row_major_f32()[11], pose.position()[2] as f32);
}

#[test]
fn looking_at_a_point_puts_it_ahead_and_up_is_up() {
    let pose = Pose::look_at([1.0, 2.0, 3.0], [0.0, 0.0, 0.5]);
    let seen = pose.inverse_transform([0.0, 0.0, 0.5]);
    assert!(seen[0].abs() < 1e-12 && seen[1].abs() < 1e-12 && seen[2] > 0.0);
    assert!(pose.axis(1)[2] < 0.0, "+Y of a camera points down");
    assert_eq!(Pose::from_matrix(&matrix(&pose)), Ok(pose));
    let straight_down = Pose::look_at([0.0, 0.0, 1.0], [0.0; 3]);
    assert!(Pose::from_matrix(&matrix(&straight_down)).is_ok());
}

#[test]
fn every_way_not_to_be_a_pose_is_told() {
    let good = matrix(&SMALL.camera(1));
    let with = |change: &dyn Fn(&mut [f64; 16])| {
        let mut matrix = good;
        change(&mut matrix);
        Pose::from_matrix(&matrix).unwrap_err()
    };
    assert_eq!(with(&|m| m[5] = f64::NAN), PoseFault::NotFinite);
    assert_eq!(with(&|m| m[15] = 2.0), PoseFault::LastRow);
    assert_eq!(with(&|m| *m = std::array::from_fn(|i| good[i % 4 * 4 + i / 4])), PoseFault::Transposed);
    assert_eq!(with(&|m| (0..3).for_each(|row| m[4 * row] *= -1.0)), PoseFault::Mirrored);
    assert_eq!(with(&|m| m[3] = 1e300), PoseFault::TooFar);
    assert!(matches!(with(&|m| m[0] += 0.2), PoseFault::NotOrthonormal(error) if error > 0.01));
    assert!(matches!(with(&|m| *m = [0.0; 16]), PoseFault::LastRow));
    let scaled = with(&|m| (0..12).filter(|i| i % 4 < 3).for_each(|i| m[i] *= 0.25));
    assert!(matches!(scaled, PoseFault::Scaled(scale) if (scale - 0.25).abs() < 1e-9));
}
