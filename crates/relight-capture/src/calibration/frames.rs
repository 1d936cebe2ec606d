//! Chains of rigid poses.

use relight_scene::Pose;

/// The pose that first applies `inner`, then `outer`.
pub(crate) fn compose(outer: &Pose, inner: &Pose) -> Pose {
    let column = |j: usize| outer.rotate(inner.0.map(|row| row[j]));
    let (columns, position) = ([column(0), column(1), column(2)], outer.transform(inner.position()));
    Pose(std::array::from_fn(|i| [columns[0][i], columns[1][i], columns[2][i], position[i]]))
}
