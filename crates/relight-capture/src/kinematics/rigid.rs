//! Rigid poses as `glam` takes them.

use glam::{DAffine3, DMat3, DVec3};
use relight_scene::{Pose, PoseFault};

/// The rigid transform next to a pose that a text file may have rounded.
pub fn from_pose(pose: &Pose) -> DAffine3 {
    let [x, y, z, t] = std::array::from_fn(|column| DVec3::from_array(pose.0.map(|row| row[column])));
    DAffine3::from_mat3_translation(nearest_rotation(DMat3::from_cols(x, y, z)), t)
}

pub fn to_pose(rigid: &DAffine3) -> Pose {
    let rows = rigid.matrix3.transpose();
    let row = |i: usize| {
        let r = rows.col(i);
        [r.x, r.y, r.z, rigid.translation[i]]
    };
    Pose([row(0), row(1), row(2)])
}

/// Undoes a rigid transform; without the rounding of a general inverse.
pub fn inverse(rigid: &DAffine3) -> DAffine3 {
    let back = rigid.matrix3.transpose();
    DAffine3::from_mat3_translation(back, -(back * rigid.translation))
}

/// The rotation next to a matrix that is one but for the rounding of a text file, by Newton's iteration for the polar
/// decomposition (Higham 1986). It converges quadratically: from the 1e-3 that [`Pose::from_matrix`] lets through, four
/// steps reach the last digit.
fn nearest_rotation(matrix: DMat3) -> DMat3 {
    (0..4).fold(matrix, |m, _| (m + m.inverse().transpose()) * 0.5)
}

/// Refuses what is no rigid pose: a [`Pose`] can be written down unchecked.
pub fn checked(pose: &Pose) -> Result<(), PoseFault> {
    let mut matrix = [0.0; 16];
    for (i, row) in pose.0.iter().enumerate() {
        matrix[4 * i..4 * i + 4].copy_from_slice(row);
    }
    matrix[15] = 1.0;
    Pose::from_matrix(&matrix).map(|_| ())
}
