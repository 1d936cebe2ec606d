//! What a session asks of an arm.

use std::fmt;

use super::error::ArmError;
use super::planned_motion::PlannedMotion;
pub use crate::kinematics::Joints;

/// What keeps an arm from moving, or that nothing does.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ArmStatus {
    /// At rest and ready.
    Idle,
    /// In motion.
    Running,
    /// Paused in the middle of a motion.
    Paused,
    /// Stopped by the controller because of a force or a collision.
    ProtectiveStop,
    /// An emergency stop is pressed.
    EmergencyStop,
    /// The controller does not take orders over the network.
    NotInRemote,
    /// Anything else that keeps it from moving, in words.
    Fault(&'static str),
}

impl fmt::Display for ArmStatus {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Idle => "at rest",
            Self::Running => "in motion already; wait until it rests",
            Self::Paused => "paused; go on or stop on the pendant",
            Self::ProtectiveStop => {
                "in protective stop; find what it touched or carries, then release it on the pendant"
            }
            Self::EmergencyStop => {
                "in emergency stop; make the cell safe, release the button, then power on at the pendant"
            }
            Self::NotInRemote => "not in remote control; switch it to remote on the pendant",
            Self::Fault(what) => return write!(f, "not ready: {what}"),
        })
    }
}

/// An arm at one moment.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ArmState {
    /// Measured joint angles, radians.
    pub joints: Joints,
    /// What it does.
    pub status: ArmStatus,
}

/// A robot arm that goes along planned motions and nowhere else.
pub trait Arm: Send {
    /// Where the arm is and what it does, not older than a time limit of the driver's.
    ///
    /// # Errors
    /// If the link is lost or the controller does not make sense.
    fn state(&mut self) -> Result<ArmState, ArmError>;

    /// Goes along `motion` and returns when the arm rests at its end. `go_on` is asked again and again on the way.
    ///
    /// # Errors
    /// If the arm is not ready, not where the motion begins, or stopped on the way; and that of `go_on`. The arm was then told to
    /// stop; [`ArmError::NotStopped`] says that it may not have heard.
    fn move_while(
        &mut self,
        motion: &PlannedMotion,
        go_on: &mut dyn FnMut() -> Result<(), ArmError>,
    ) -> Result<ArmState, ArmError>;

    /// Goes along `motion`, as [`move_while`](Arm::move_while) does, whatever happens elsewhere.
    ///
    /// # Errors
    /// As [`move_while`](Arm::move_while).
    fn move_along(&mut self, motion: &PlannedMotion) -> Result<ArmState, ArmError> {
        self.move_while(motion, &mut || Ok(()))
    }

    /// Stops the arm and returns when it rests.
    ///
    /// # Errors
    /// If it could not be told, or is not seen to rest.
    fn stop(&mut self) -> Result<(), ArmError>;
}

/// The joint in which two positions differ most, and by how much, radians. A difference that is not a number counts as
/// the largest.
pub(crate) fn largest_difference(a: &Joints, b: &Joints) -> (usize, f64) {
    let mut largest = (0, 0.0);
    for (joint, (a, b)) in a.iter().zip(b).enumerate() {
        let difference = (a - b).abs();
        if difference > largest.1 || difference.is_nan() {
            largest = (joint, if difference.is_nan() { f64::INFINITY } else { difference });
        }
    }
    largest
}
