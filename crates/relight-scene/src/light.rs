//! A point light somewhere in the world.

use crate::pose::Pose;

/// A light of a scene.
#[derive(Clone, Debug, PartialEq)]
pub struct Light {
    /// The light's number in the folder (ReNe's light index: 7 for `lset007`).
    pub label: usize,
    /// Light-to-world; the light looks along its +Z axis, though nothing depends on that: it shines all round.
    pub pose: Pose,
}
