//! Motions that a plan has approved: the only ones that an arm takes.

use std::f64::consts::FRAC_PI_6;
use std::time::Duration;

use super::arm::{Joints, largest_difference};
use super::error::ArmError;
use super::trapezoid::Trapezoid;

/// How far an arm may be from where a motion begins, radians: some 5 mm at full stretch, well inside the clearances
/// that a plan keeps.
const AT_START: f64 = 5e-3;

/// How fast the joint that goes farthest may go.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct JointSpeed {
    /// Largest speed, rad/s.
    pub speed: f64,
    /// Largest acceleration, rad/s^2.
    pub acceleration: f64,
}

impl JointSpeed {
    /// The fastest that a plan may ask for: what UR's `movej` does when told nothing. A capture waits for cameras, not
    /// for arms, and somebody may stand beside it.
    pub const FASTEST: JointSpeed = JointSpeed { speed: 1.05, acceleration: 1.4 };

    /// A speed for carrying a camera or a lamp: 30 degrees a second.
    pub const USUAL: JointSpeed = JointSpeed { speed: FRAC_PI_6, acceleration: 0.8 };
}

/// Why there is no plan.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum PlanFault {
    /// A speed is none, or too fast.
    #[error(
        "{what} {value} {unit} is outside 0 to {limit} {unit}; a capture needs no more: choose a slower one"
    )]
    Speed {
        /// Speed or acceleration.
        what: &'static str,
        /// The value asked for.
        value: f64,
        /// The largest allowed.
        limit: f64,
        /// Its unit.
        unit: &'static str,
    },
    /// A joint angle is infinite or not a number.
    #[error("station {station}: joint {} is not a finite number", joint + 1)]
    NotFinite {
        /// Index of the station.
        station: usize,
        /// Index of the joint, from 0.
        joint: usize,
    },
    /// The check found something in the way.
    #[error("the motion from station {} to {}: {reason}", motion, motion + 1)]
    Refused {
        /// Index of the motion, which begins at the station of the same index.
        motion: usize,
        /// What the check said.
        reason: String,
    },
}

/// A straight line between two joint positions, approved by a plan's check. All joints leave and arrive together.
///
/// Only [`MotionPlan`] makes one.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PlannedMotion {
    from: Joints,
    to: Joints,
    speed: JointSpeed,
}

impl PlannedMotion {
    /// Where it begins, radians.
    pub fn from(&self) -> &Joints {
        &self.from
    }

    /// Where it ends, radians.
    pub fn to(&self) -> &Joints {
        &self.to
    }

    /// How fast it goes.
    pub fn speed(&self) -> JointSpeed {
        self.speed
    }

    /// How long it takes.
    pub fn duration(&self) -> Duration {
        let (_, distance) = largest_difference(&self.from, &self.to);
        let profile = Trapezoid::new(distance, self.speed.speed, self.speed.acceleration);
        Duration::try_from_secs_f64(profile.duration()).unwrap_or(Duration::MAX)
    }

    /// Refuses unless the arm at `address` stands where the motion begins.
    pub(super) fn check_start(&self, address: &str, joints: &Joints) -> Result<(), ArmError> {
        let (joint, difference) = largest_difference(joints, &self.from);
        if difference > AT_START {
            return Err(ArmError::NotAtStart { address: address.to_owned(), joint, difference });
        }
        Ok(())
    }
}

/// Motions from station to station, every one of them approved.
#[derive(Clone, Debug, PartialEq)]
pub struct MotionPlan {
    motions: Vec<PlannedMotion>,
}

impl MotionPlan {
    /// The motions through `stations`, one after another, at `speed`.
    ///
    /// `check` sees both ends of each motion and says why the straight line between them in joint space must not be
    /// taken: joint limits, collisions along the way. This is the only gate, so there is no plan without one.
    ///
    /// # Errors
    /// If `speed` is faster than [`JointSpeed::FASTEST`], an angle is not finite, or `check` refuses.
    pub fn through<E: ToString>(
        stations: &[Joints],
        speed: JointSpeed,
        mut check: impl FnMut(&Joints, &Joints) -> Result<(), E>,
    ) -> Result<MotionPlan, PlanFault> {
        let fastest = JointSpeed::FASTEST;
        for (what, value, limit, unit) in [
            ("speed", speed.speed, fastest.speed, "rad/s"),
            ("acceleration", speed.acceleration, fastest.acceleration, "rad/s^2"),
        ] {
            if !(value > 0.0 && value <= limit) {
                return Err(PlanFault::Speed { what, value, limit, unit });
            }
        }
        for (station, joints) in stations.iter().enumerate() {
            if let Some(joint) = joints.iter().position(|q| !q.is_finite()) {
                return Err(PlanFault::NotFinite { station, joint });
            }
        }
        let approved = stations.windows(2).enumerate().filter_map(|(motion, pair)| {
            let [from, to] = pair else { return None };
            Some(match check(from, to) {
                Ok(()) => Ok(PlannedMotion { from: *from, to: *to, speed }),
                Err(reason) => Err(PlanFault::Refused { motion, reason: reason.to_string() }),
            })
        });
        Ok(MotionPlan { motions: approved.collect::<Result<_, _>>()? })
    }

    /// The motions in order: one fewer than there were stations.
    pub fn motions(&self) -> &[PlannedMotion] {
        &self.motions
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn anything(_: &Joints, _: &Joints) -> Result<(), String> {
        Ok(())
    }

    #[test]
    fn a_plan_holds_what_its_check_approved() {
        let stations = [[0.0; 6], [0.1; 6], [0.3; 6]];
        let mut seen = Vec::new();
        let plan = MotionPlan::through(&stations, JointSpeed::USUAL, |a, b| {
            seen.push((*a, *b));
            Ok::<_, String>(())
        });
        let plan = plan.unwrap();
        assert_eq!(seen, [(stations[0], stations[1]), (stations[1], stations[2])]);
        assert_eq!(plan.motions().len(), 2);
        assert_eq!((plan.motions()[1].from(), plan.motions()[1].to()), (&stations[1], &stations[2]));
        let refusal = MotionPlan::through(&stations, JointSpeed::USUAL, |_, b| {
            if b[0] > 0.2 { Err("the table is in the way") } else { Ok(()) }
        });
        let reason = "the table is in the way".to_owned();
        assert_eq!(refusal.unwrap_err(), PlanFault::Refused { motion: 1, reason });
    }

    #[test]
    fn speeds_that_are_none_or_too_fast_are_refused() {
        let JointSpeed { speed, acceleration } = JointSpeed::FASTEST;
        assert!(MotionPlan::through(&[[0.0; 6]; 2], JointSpeed::FASTEST, anything).is_ok());
        for bad in [0.0, -1.0, f64::NAN, f64::INFINITY, 1.5] {
            for asked in [JointSpeed { speed: bad, acceleration }, JointSpeed { speed, acceleration: bad }] {
                let fault = MotionPlan::through(&[[0.0; 6]; 2], asked, anything).unwrap_err();
                assert!(matches!(fault, PlanFault::Speed { .. }), "{fault}");
            }
        }
    }

    #[test]
    fn angles_that_are_no_numbers_are_refused() {
        let mut stations = [[0.0; 6]; 3];
        stations[1][4] = f64::NAN;
        let fault = MotionPlan::through(&stations, JointSpeed::USUAL, anything).unwrap_err();
        assert_eq!(fault, PlanFault::NotFinite { station: 1, joint: 4 });
    }

    #[test]
    fn a_motion_begins_where_the_arm_is() {
        let plan = MotionPlan::through(&[[0.1; 6], [0.5; 6]], JointSpeed::USUAL, anything).unwrap();
        let motion = plan.motions()[0];
        assert!(motion.check_start("arm", &[0.104; 6]).is_ok());
        let mut joints = [0.1; 6];
        joints[3] = 0.106;
        let error = motion.check_start("arm", &joints).unwrap_err();
        assert!(matches!(error, ArmError::NotAtStart { joint: 3, .. }), "{error}");
        assert!(error.to_string().contains("joint 4"), "{error}");
        joints[3] = f64::NAN;
        assert!(motion.check_start("arm", &joints).is_err());
    }
}
