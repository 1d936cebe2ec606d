//! Joint limits, and the whole turns that they leave open.

use std::f64::consts::TAU;

use super::Joints;

/// Rounding that a joint at its very limit may show, radians.
const ROUNDING: f64 = 1e-9;

/// The range of each joint, radians.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct JointLimits {
    /// Least angles.
    pub lower: Joints,
    /// Greatest angles.
    pub upper: Joints,
}

/// A joint that would have to leave its range.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
#[error(
    "joint {} would stand at {:.1} degrees, outside its range of {:.0} to {:.0} degrees",
    .joint + 1, .angle.to_degrees(), .lower.to_degrees(), .upper.to_degrees()
)]
pub struct LimitFault {
    /// Which joint, from 0.
    pub joint: usize,
    /// Where it would have to stand, radians; of all turns the one nearest to the last configuration.
    pub angle: f64,
    /// The least angle of its range, radians.
    pub lower: f64,
    /// The greatest angle of its range, radians.
    pub upper: f64,
}

impl JointLimits {
    /// The same range to both sides for every joint, radians.
    pub const fn symmetric(range: Joints) -> Self {
        let mut lower = range;
        let mut joint = 0;
        while joint < 6 {
            lower[joint] = -range[joint];
            joint += 1;
        }
        Self { lower, upper: range }
    }

    /// Whether every joint is inside its range.
    ///
    /// # Errors
    /// The first joint that is not; one that is not a number is not.
    pub fn check(&self, joints: &Joints) -> Result<(), LimitFault> {
        let inside = |joint: usize| {
            let range = self.lower[joint] - ROUNDING..=self.upper[joint] + ROUNDING;
            range.contains(&joints[joint])
        };
        match (0..6).find(|&joint| !inside(joint)) {
            None => Ok(()),
            Some(joint) => Err(self.fault(joint, joints[joint])),
        }
    }

    /// The same configuration with each joint turned by whole turns to where it is nearest to `near` within its range.
    ///
    /// # Errors
    /// The first joint that no turn brings into its range.
    pub fn nearest_turn(&self, joints: &Joints, near: &Joints) -> Result<Joints, LimitFault> {
        let mut turned = *joints;
        for (joint, angle) in turned.iter_mut().enumerate() {
            let (lower, upper) = (self.lower[joint], self.upper[joint]);
            let wanted = *angle + TAU * ((near[joint] - *angle) / TAU).round();
            let up = wanted + TAU * ((lower - ROUNDING - wanted) / TAU).ceil().max(0.0);
            let nearest = up - TAU * ((up - upper - ROUNDING) / TAU).ceil().max(0.0);
            if !(lower - ROUNDING..=upper + ROUNDING).contains(&nearest) {
                return Err(self.fault(joint, wanted));
            }
            *angle = nearest.clamp(lower, upper);
        }
        Ok(turned)
    }

    fn fault(&self, joint: usize, angle: f64) -> LimitFault {
        LimitFault { joint, angle, lower: self.lower[joint], upper: self.upper[joint] }
    }
}

/// The same angle in [-pi, pi].
pub(super) fn normalised(angle: f64) -> f64 {
    angle - TAU * (angle / TAU).round()
}

#[cfg(test)]
mod tests {
    use std::f64::consts::PI;

    use proptest::prelude::*;

    use super::*;

    const TWO_TURNS: JointLimits = JointLimits::symmetric([TAU; 6]);

    #[test]
    fn a_joint_at_its_very_limit_is_inside_and_one_beyond_is_named() {
        let limits = JointLimits::symmetric([TAU, TAU, 2.79, TAU, TAU, TAU]);
        let at = [TAU, -TAU, 2.79, 0.0, 0.0, 0.0];
        assert_eq!(limits.check(&at), Ok(()));
        assert_eq!(limits.nearest_turn(&at, &at), Ok(at));
        let fault = limits.nearest_turn(&[0.0, 0.0, 3.0, 0.0, 0.0, 0.0], &at).unwrap_err();
        assert_eq!((fault.joint, fault.angle), (2, 3.0));
        assert!(fault.to_string().starts_with("joint 3 would stand at 171.9 degrees"), "{fault}");
        assert_eq!(limits.check(&[0.0, f64::NAN, 0.0, 0.0, 0.0, 0.0]).unwrap_err().joint, 1);
        assert_eq!(limits.nearest_turn(&[f64::NAN; 6], &at).unwrap_err().joint, 0);
    }

    proptest! {
        #[test]
        fn the_nearest_turn_is_the_nearest_of_all(angle in -PI..PI, near in -8.0..8.0f64) {
            let turned = TWO_TURNS.nearest_turn(&[angle; 6], &[near; 6]).unwrap()[0];
            let all = [-1.0, 0.0, 1.0].map(|turns| angle + turns * TAU);
            let best = all.into_iter().filter(|q| q.abs() <= TAU).map(|q| (q - near).abs()).fold(f64::MAX, f64::min);
            prop_assert!(((turned - near).abs() - best).abs() < 1e-12, "{turned}");
            prop_assert!((normalised(turned) - angle).abs() < 1e-12);
        }
    }
}
