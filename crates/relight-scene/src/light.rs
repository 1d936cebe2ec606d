//! A point light somewhere in the world.

use crate::pose::Pose;

/// A light of a scene.
#[derive(Clone, Debug, PartialEq)]
pub struct Light {
    /// The light's number in the folder (ReNe's light index: 7 for `lset007`).
    pub label: usize,
    /// Light-to-world. It shines all round, but looks along its +Z axis at what the cameras look at: where only its position
    /// is told, it is turned so ([`focus`](crate::focus())), for model V1 is given the rotation too.
    pub pose: Pose,
}
