//! An arm that does not exist.

use std::time::Duration;

use super::arm::{Arm, ArmState, ArmStatus, Joints};
use super::error::ArmError;
use super::planned_motion::PlannedMotion;

/// An arm that goes nowhere, checks what a real one would check, and keeps a record.
#[derive(Clone, Debug)]
pub struct DryRun {
    name: String,
    joints: Joints,
    record: Vec<PlannedMotion>,
}

impl DryRun {
    /// An arm called `name` in errors, at `joints` (rad).
    pub fn new(name: impl Into<String>, joints: Joints) -> Self {
        Self { name: name.into(), joints, record: Vec::new() }
    }

    /// The motions that it was given, in order.
    pub fn record(&self) -> &[PlannedMotion] {
        &self.record
    }

    /// How long they would have taken.
    pub fn duration(&self) -> Duration {
        self.record.iter().fold(Duration::ZERO, |sum, motion| sum.saturating_add(motion.duration()))
    }
}

impl Arm for DryRun {
    fn state(&mut self) -> Result<ArmState, ArmError> {
        Ok(ArmState { joints: self.joints, status: ArmStatus::Idle })
    }

    fn move_while(
        &mut self,
        motion: &PlannedMotion,
        go_on: &mut dyn FnMut() -> Result<(), ArmError>,
    ) -> Result<ArmState, ArmError> {
        motion.check_start(&self.name, &self.joints)?;
        go_on()?;
        self.record.push(*motion);
        self.joints = *motion.to();
        self.state()
    }

    fn stop(&mut self) -> Result<(), ArmError> {
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::super::planned_motion::{JointSpeed, MotionPlan};
    use super::*;

    #[test]
    fn it_records_and_checks_but_does_not_wait() {
        let stations = [[0.0; 6], [1.0; 6], [-1.0; 6]];
        let speed = JointSpeed { speed: 0.5, acceleration: 1.0 };
        let plan = MotionPlan::through(&stations, speed, |_, _| Ok::<_, String>(())).unwrap();
        let mut arm = DryRun::new("camera arm", stations[0]);
        let error = arm.move_along(&plan.motions()[1]).unwrap_err();
        assert!(error.to_string().contains("camera arm"), "{error}");
        for motion in plan.motions() {
            arm.move_along(motion).unwrap();
        }
        assert_eq!(arm.state().unwrap().joints, stations[2]);
        assert_eq!(arm.record(), plan.motions());
        // Two seconds at half a radian a second and half a second of ramps; then twice as far.
        assert!((arm.duration().as_secs_f64() - (2.5 + 4.5)).abs() < 1e-9);
    }
}
