//! Inverse kinematics in closed form.
//!
//! Three axes are parallel and the last three do not meet, so the shoulder is found first (the wrist stays at `d4` beside
//! the arm's plane), then the last two joints from how the flange leans out of that plane, then the elbow as a triangle
//! in it: 2 x 2 x 2 solutions (Hawkins 2013, "Analytic Inverse Kinematics for the Universal Robots UR-5/UR-10 Arms").

use std::f64::consts::PI;

use glam::{DAffine3, DVec2, DVec3};
use relight_scene::{Pose, PoseFault};

use super::limits::normalised;
use super::rigid::{checked, from_pose};
use super::{ArmModel, Joints, LimitFault};

/// How far beyond its reach rounding may put a wrist that just reaches, metres.
const ROUNDING: f64 = 1e-10;
/// How far along its way past the base's axis a wrist still counts as beside it, metres: that misses it by 1e-13 m.
const BESIDE: f64 = 1e-7;
/// Sine of the fifth joint under which the fourth and sixth axes are one and the sixth joint is free.
const SINGULAR: f64 = 1e-10;
/// Solutions nearer to each other than this in every joint are one, radians: at a shoulder or elbow singularity the square
/// root makes 1e-8 of a rounding of 1e-16.
const DISTINCT: f64 = 1e-6;

/// Why no joints bring the flange to a pose.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum Unreachable {
    /// It is no rigid pose.
    #[error("not a rigid pose: {0}")]
    Pose(#[from] PoseFault),
    /// The wrist would be farther from the shoulder than the stretched arm reaches.
    #[error(
        "too far: the wrist would be {distance:.3} m from the shoulder, and the stretched arm reaches {reach:.3} m"
    )]
    TooFar {
        /// From the second axis to the fourth, metres.
        distance: f64,
        /// The most that can be, metres.
        reach: f64,
    },
    /// The wrist would be nearer to the shoulder than the folded arm brings it.
    #[error(
        "too near: the wrist would be {distance:.3} m from the shoulder, and the folded arm leaves {least:.3} m"
    )]
    TooNear {
        /// From the second axis to the fourth, metres.
        distance: f64,
        /// The least that can be, metres.
        least: f64,
    },
    /// The wrist would be nearer to the base's axis than it stands beside the arm's plane.
    #[error(
        "too near the base's axis: the wrist would be {distance:.3} m from it, and cannot come nearer than {least:.3} m"
    )]
    BesideBase {
        /// From the first axis to where the fifth and sixth axes meet, metres.
        distance: f64,
        /// The least that can be, metres.
        least: f64,
    },
    /// All solutions are outside a joint's range.
    #[error(transparent)]
    Limit(#[from] LimitFault),
}

impl ArmModel {
    /// All joint angles that bring the flange to a pose in the base's frame, whatever the joints' ranges: up to eight, each
    /// angle in [-pi, pi], in an order that only depends on the shoulder's, wrist's and elbow's side.
    ///
    /// Fewer exist where two sides are one: shoulder or elbow stretched. Where the wrist is (fourth and sixth axis in
    /// line) infinitely many exist; of those come the ones with the sixth joint as in `near`, or, if the elbow does not
    /// allow that, another. A pose that a text file has rounded is reached as nearly as a rigid pose can be. Less than about 1e-6 from two singularities at once, but
    /// not in them, rounding decides the sixth joint, and solutions may be missed.
    ///
    /// # Errors
    /// If there are none, the reason.
    pub fn inverse(&self, pose: &Pose, near: &Joints) -> Result<Vec<Joints>, Unreachable> {
        checked(pose)?;
        let flange = from_pose(pose);
        let mut solutions: Vec<Joints> = Vec::with_capacity(8);
        let mut reason = None;
        for shoulder in self.shoulders(&flange)? {
            for wrist in self.wrists(&flange, shoulder, near[5] + self.zeros[5]) {
                match self.elbows(&flange, shoulder, wrist) {
                    Ok(found) => {
                        for angles in found {
                            let joints = std::array::from_fn(|i| normalised(angles[i] - self.zeros[i]));
                            if !solutions.iter().any(|other| same(other, &joints)) {
                                solutions.push(joints);
                            }
                        }
                    }
                    Err(fault) => reason = Some(fault),
                }
            }
        }
        match reason {
            Some(fault) if solutions.is_empty() => Err(fault),
            _ => Ok(solutions),
        }
    }

    /// The solutions of [`ArmModel::inverse`] that the joints' ranges allow, each joint turned by whole turns to where it
    /// is nearest to `near`.
    ///
    /// # Errors
    /// If there are none, the reason.
    pub fn inverse_within_limits(&self, pose: &Pose, near: &Joints) -> Result<Vec<Joints>, Unreachable> {
        let (mut allowed, mut fault) = (Vec::new(), None);
        for joints in self.inverse(pose, near)? {
            match self.limits.nearest_turn(&joints, near) {
                Ok(turned) => allowed.push(turned),
                Err(out) => fault = Some(out),
            }
        }
        match fault {
            Some(out) if allowed.is_empty() => Err(out.into()),
            _ => Ok(allowed),
        }
    }

    /// The two first joints that put the wrist at `d4` beside the arm's plane.
    fn shoulders(&self, flange: &DAffine3) -> Result<[f64; 2], Unreachable> {
        let wrist = flange.translation - self.d6 * flange.matrix3.z_axis;
        let distance = wrist.truncate().length();
        if distance < self.d4 - ROUNDING {
            return Err(Unreachable::BesideBase { distance, least: self.d4 });
        }
        // The root makes 1e-8 of rounding; so near to the singularity, its two sides are one as well.
        let root = (distance * distance - self.d4 * self.d4).max(0.0).sqrt();
        let along = if root < BESIDE { 0.0 } else { root };
        let heading = wrist.y.atan2(wrist.x);
        Ok([along, -along].map(|side| heading + self.d4.atan2(side)))
    }

    /// The pairs of fifth and sixth joint; one pair only where the sixth is free.
    fn wrists(&self, flange: &DAffine3, shoulder: f64, free: f64) -> Vec<[f64; 2]> {
        // How the flange's axes lean out of the arm's plane.
        let axes = flange.matrix3;
        let lean = axes.transpose() * DVec3::new(shoulder.sin(), -shoulder.cos(), 0.0);
        let sine = lean.truncate().length();
        if sine >= SINGULAR {
            let fifth = sine.atan2(lean.z);
            return vec![[fifth, (-lean.y).atan2(lean.x)], [-fifth, lean.y.atan2(-lean.x)]];
        }
        let fifth = if lean.z > 0.0 { 0.0 } else { PI };
        // If the elbow does not allow the free angle, one of these does: the fourth axis as near to the shoulder as it can
        // be, or as far.
        let outwards = flange.translation - self.d6 * axes.z_axis - DVec3::new(0.0, 0.0, self.d1);
        let nearest = (-outwards.dot(axes.x_axis)).atan2(-outwards.dot(axes.y_axis));
        let reached = |sixth: &f64| self.elbows(flange, shoulder, [fifth, *sixth]).is_ok();
        let sixth = [free, nearest, nearest + PI].into_iter().find(reached).unwrap_or(free);
        vec![[fifth, sixth]]
    }

    /// All six angles for both sides of the elbow.
    fn elbows(
        &self,
        flange: &DAffine3,
        shoulder: f64,
        [fifth, sixth]: [f64; 2],
    ) -> Result<[Joints; 2], Unreachable> {
        let axes = flange.matrix3;
        let fifth_axis = -(sixth.sin() * axes.x_axis + sixth.cos() * axes.y_axis);
        let wrist = flange.translation - self.d6 * axes.z_axis - self.d5 * fifth_axis;
        // In the arm's plane: horizontally away from the base's axis, and up.
        let heading = DVec2::new(shoulder.cos(), shoulder.sin());
        let target = DVec2::new(heading.dot(wrist.truncate()), wrist.z - self.d1);
        let tilt = heading.dot(fifth_axis.truncate()).atan2(-fifth_axis.z);

        let (reach, least) = ((self.a2 + self.a3).abs(), (self.a2 - self.a3).abs());
        let distance = target.length();
        if distance > reach + ROUNDING {
            return Err(Unreachable::TooFar { distance, reach });
        }
        if distance < least - ROUNDING {
            return Err(Unreachable::TooNear { distance, least });
        }
        // Half-angle formula: exact to the last digits for a nearly stretched arm too, where the cosine is not.
        let square = distance * distance;
        let bend =
            2.0 * (reach * reach - square).max(0.0).sqrt().atan2((square - least * least).max(0.0).sqrt());
        Ok([bend, -bend].map(|third| {
            let second =
                target.y.atan2(target.x) - (self.a3 * third.sin()).atan2(self.a2 + self.a3 * third.cos());
            [shoulder, second, third, tilt - second - third, fifth, sixth]
        }))
    }
}

fn same(a: &Joints, b: &Joints) -> bool {
    a.iter().zip(b).all(|(a, b)| normalised(a - b).abs() < DISTINCT)
}
