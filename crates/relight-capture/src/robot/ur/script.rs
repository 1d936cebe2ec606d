//! The programs that move and stop an arm (UR, "The URScript Programming Language").

use super::super::planned_motion::PlannedMotion;

/// Slows all joints down at 2 rad/s^2.
pub(super) const STOP: &str = "def relight_stop():\n  stopj(2.0)\nend\n";

/// A program that goes along `motion`. `movej` goes straight in joint space, its speed and acceleration are those of the
/// leading axis, in radians.
pub(super) fn movej(motion: &PlannedMotion) -> String {
    let joints = motion.to().map(|q| format!("{q:.9}")).join(", ");
    let speed = motion.speed();
    format!(
        "def relight_move():\n  movej([{joints}], a={:.6}, v={:.6})\nend\n",
        speed.acceleration, speed.speed
    )
}
