//! What is known of each arm: dimensions, limits, and the shape of its links.

use std::f64::consts::{FRAC_PI_2, PI, TAU};

use glam::{DAffine3, DMat3, DVec3};
use relight_scene::Pose;

use super::rigid::to_pose;
use super::{Capsule, JointLimits, Joints};

/// What the links are called, base first; link `i` is moved by joint `i` (counted from 1).
pub const LINK_NAMES: [&str; 7] =
    ["base", "shoulder", "upper arm", "forearm", "first wrist", "second wrist", "third wrist"];

/// A six-axis arm whose second, third and fourth axes are parallel and whose wrist is offset.
///
/// Lengths in metres. In standard Denavit-Hartenberg parameters it has `d` = (d1, 0, 0, d4, d5, d6),
/// `a` = (0, a2, a3, 0, 0, 0), `alpha` = (90, 0, 0, 90, -90, 0) degrees, and joint angles that are the controller's plus
/// `zeros`.
#[derive(Clone, Debug, PartialEq)]
pub struct ArmModel {
    /// The name that the command line knows it by.
    pub name: &'static str,
    /// Height of the shoulder over the base.
    pub d1: f64,
    /// Length of the upper arm, negative.
    pub a2: f64,
    /// Length of the forearm, negative.
    pub a3: f64,
    /// How far the wrist stands to the side of the arm's plane.
    pub d4: f64,
    /// From the fourth axis to the sixth.
    pub d5: f64,
    /// From the fifth axis to the flange.
    pub d6: f64,
    /// What is added to the controller's joint angles, radians.
    pub zeros: Joints,
    /// Joint ranges.
    pub limits: JointLimits,
    /// A configuration in which the arm stands upright, out of the way of whatever is beside it.
    pub upright: Joints,
    /// The room that each link takes, base first, in the link's own frame (+Z along the axis of the joint that moves
    /// it). Capsules are larger than the link.
    pub capsules: [&'static [Capsule]; 7],
}

/// Universal Robots UR5e.
///
/// Dimensions: the vendor's article "DH parameters for calculations of kinematics and dynamics". Ranges: its user manual
/// (all joints +-360 degrees). Capsules: fitted around the collision meshes of ROS-Industrial's `ur_description`; no
/// point of a mesh comes nearer than 0.8 mm to the surface of its capsule.
pub const UR5E: ArmModel = ArmModel {
    name: "ur5e",
    d1: 0.1625,
    a2: -0.425,
    a3: -0.3922,
    d4: 0.1333,
    d5: 0.0997,
    d6: 0.0996,
    zeros: [0.0; 6],
    limits: JointLimits::symmetric([TAU; 6]),
    upright: [0.0, -FRAC_PI_2, 0.0, -FRAC_PI_2, -FRAC_PI_2, 0.0],
    capsules: [
        &[Capsule::new([0.0, 0.0, 0.027], [0.0, 0.0, 0.044], 0.082)],
        &[Capsule::new([0.0, -0.003, -0.007], [0.0, -0.014, 0.0], 0.086)],
        &[Capsule::new([0.0, 0.0, 0.129], [-0.425, 0.0, 0.129], 0.092)],
        &[Capsule::new([0.0, 0.0, 0.028], [-0.388, 0.0, 0.009], 0.068)],
        &[Capsule::new([0.0, 0.0, -0.022], [0.0, 0.0, 0.0], 0.066)],
        &[Capsule::new([0.0, -0.007, -0.003], [0.0, 0.009, 0.0], 0.06)],
        &[Capsule::new([0.0, 0.0, -0.025], [0.0, 0.0, -0.025], 0.046)],
    ],
};

/// Elite Robots EC66.
///
/// Dimensions, ranges (+-360 degrees, the third joint +-160) and meshes: the vendor's own ROS package
/// (`elite_description`). No point of a mesh comes nearer than 0.8 mm to the surface of its capsule.
pub const EC66: ArmModel = ArmModel {
    name: "ec66",
    d1: 0.096,
    a2: -0.418,
    a3: -0.398,
    d4: 0.122,
    d5: 0.098,
    d6: 0.089,
    zeros: [PI, 0.0, 0.0, 0.0, PI, 0.0],
    limits: JointLimits::symmetric([TAU, TAU, 160.0 * PI / 180.0, TAU, TAU, TAU]),
    upright: [0.0, -FRAC_PI_2, 0.0, -FRAC_PI_2, FRAC_PI_2, 0.0],
    capsules: [
        &[Capsule::new([0.0, 0.0, 0.009], [0.0, 0.0, 0.009], 0.077)],
        &[Capsule::new([0.0, -0.005, -0.014], [0.0, -0.013, 0.007], 0.086)],
        &[
            // The shoulder is so low that one capsule for the whole link would always touch the table.
            Capsule::new([0.0, 0.0, 0.097], [0.0, 0.0, 0.193], 0.066),
            Capsule::new([-0.06, 0.0, 0.14], [-0.414, 0.0, 0.135], 0.079),
        ],
        &[Capsule::new([0.0, 0.0, 0.05], [-0.398, 0.0, 0.026], 0.063)],
        &[Capsule::new([0.0, 0.004, -0.007], [0.0, -0.011, -0.003], 0.058)],
        &[Capsule::new([0.0, -0.004, -0.007], [0.0, 0.011, -0.003], 0.058)],
        &[Capsule::new([0.0, 0.0, -0.023], [0.0, 0.0, -0.023], 0.043)],
    ],
};

/// The step from one link's frame to the next, in modified Denavit-Hartenberg parameters.
#[derive(Clone, Copy, Debug)]
pub(super) struct LinkStep {
    /// Sine of the twist about x, exactly -1, 0 or 1.
    pub twist: f64,
    /// Along x, metres.
    pub a: f64,
    /// Along the joint's axis, metres.
    pub d: f64,
}

impl LinkStep {
    fn turned(&self, angle: f64) -> DAffine3 {
        let (sin, cos) = angle.sin_cos();
        let (s, c) = (self.twist, 1.0 - self.twist.abs());
        DAffine3::from_mat3_translation(
            DMat3::from_cols(
                DVec3::new(cos, sin * c, sin * s),
                DVec3::new(-sin, cos * c, cos * s),
                DVec3::new(0.0, -s, c),
            ),
            DVec3::new(self.a, -s * self.d, c * self.d),
        )
    }
}

impl ArmModel {
    pub(super) fn steps(&self) -> [LinkStep; 6] {
        [
            LinkStep { twist: 0.0, a: 0.0, d: self.d1 },
            LinkStep { twist: 1.0, a: 0.0, d: 0.0 },
            LinkStep { twist: 0.0, a: self.a2, d: 0.0 },
            LinkStep { twist: 0.0, a: self.a3, d: self.d4 },
            LinkStep { twist: 1.0, a: 0.0, d: self.d5 },
            LinkStep { twist: -1.0, a: 0.0, d: self.d6 },
        ]
    }

    /// The flange in the base's frame.
    pub fn forward(&self, joints: &Joints) -> Pose {
        to_pose(&self.link_frames(joints)[6])
    }

    /// The frame of each link in the base's frame: the base's own, then for each joint a frame that turns with it, +Z
    /// along the joint's axis. The last is the flange.
    pub(super) fn link_frames(&self, joints: &Joints) -> [DAffine3; 7] {
        let mut frames = [DAffine3::IDENTITY; 7];
        for (i, step) in self.steps().iter().enumerate() {
            frames[i + 1] = frames[i] * step.turned(joints[i] + self.zeros[i]);
        }
        frames
    }
}
