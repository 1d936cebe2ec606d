//! The virtual camera on an arm: it sees the scene from where both arms really stand.

use relight_scene::{Camera, Intrinsics, Light};

use super::{CaptureRig, VirtualRig};
use crate::camera::{CameraError, Frame};
use crate::kinematics::{Arm, Joints};
use crate::rig::{CAMERA, Eye, LIGHT, Stance};
use crate::session::{Rig, RigFault, Target};

/// Arms that stand this near to where they were foreseen are there, radians: what protocols round away.
const THERE: f64 = 1e-7;

/// A virtual camera. Where arms stand is what the controllers measure; where it is foreseen, all lights of a view are
/// photographed at once, which share the camera's rays.
pub struct VirtualEye {
    rig: CaptureRig,
    intrinsics: Intrinsics,
    arms: [Arm; 2],
    /// Joints by the session's number of the view and of the light.
    foreseen: [Vec<Joints>; 2],
}

impl VirtualEye {
    /// A camera on the first of two arms, a lamp on the second. `foreseen` says where they will come to rest, by the
    /// session's numbers of views and lights; what is missing is photographed alone.
    pub fn new(
        rig: VirtualRig,
        intrinsics: Intrinsics,
        arms: [Arm; 2],
        foreseen: [Vec<Joints>; 2],
    ) -> VirtualEye {
        let camera = |(label, joints): (usize, &Joints)| Camera {
            label,
            intrinsics: intrinsics.clone(),
            pose: arms[CAMERA].tool_pose(joints),
        };
        let light = |(label, joints): (usize, &Joints)| Light { label, pose: arms[LIGHT].tool_pose(joints) };
        let cameras = foreseen[CAMERA].iter().enumerate().map(camera).collect();
        let lights = foreseen[LIGHT].iter().enumerate().map(light).collect();
        VirtualEye { rig: CaptureRig::new(rig, cameras, lights), intrinsics, arms, foreseen }
    }

    /// The camera, giving [raw frames](VirtualRig::raw).
    pub fn raw(self) -> VirtualEye {
        VirtualEye { rig: self.rig.raw(), ..self }
    }

    fn is_foreseen(&self, stance: &Stance) -> bool {
        let numbers = [stance.view, stance.light];
        (0..2).all(|arm| {
            let foreseen = self.foreseen[arm].get(numbers[arm]);
            foreseen.is_some_and(|foreseen| {
                foreseen.iter().zip(&stance.joints[arm]).all(|(a, b)| (a - b).abs() < THERE)
            })
        })
    }
}

impl Eye for VirtualEye {
    fn shoot(&mut self, stance: &Stance) -> Result<Frame, CameraError> {
        if let Some(frame) = self.rig.shoot_target(&self.intrinsics) {
            return Ok(frame);
        }
        if self.is_foreseen(stance) {
            self.rig.turn_to(stance.view, stance.light);
            return self.rig.shoot();
        }
        let camera = Camera {
            label: stance.view,
            intrinsics: self.intrinsics.clone(),
            pose: self.arms[CAMERA].tool_pose(&stance.joints[CAMERA]),
        };
        let light = Light { label: stance.light, pose: self.arms[LIGHT].tool_pose(&stance.joints[LIGHT]) };
        self.rig.shoot_from(&camera, light)
    }

    fn show(&mut self, target: Target) -> Result<(), RigFault> {
        self.rig.show(target)
    }
}

#[cfg(test)]
mod tests {
    use super::super::VirtualCapture;
    use super::*;
    use crate::trajectory::Plan;

    /// Pictures come from where the arms stand, whether that was foreseen or not.
    #[test]
    fn what_was_foreseen_is_a_matter_of_speed_alone() {
        let capture = VirtualCapture {
            object: "wheel".to_owned(),
            views: 2,
            lights: 3,
            width: 24,
            height: 18,
            samples: 4,
            seed: 7,
        };
        let plan = Plan::new(&capture.plan_settings()).unwrap();
        let arms = VirtualCapture::arms().cell(plan.object).unwrap().arms().clone();
        let joints = [&plan.camera, &plan.light].map(|trajectory| trajectory.waypoints.iter());
        let foreseen: [Vec<Joints>; 2] = std::array::from_fn(|arm| {
            let reach = |pose| arms[arm].reach(pose, &arms[arm].model.upright).unwrap()[0];
            joints[arm].clone().map(|waypoint| reach(&waypoint.pose)).collect()
        });
        let mut foreseeing = capture.eye(arms.clone(), foreseen.clone()).unwrap();
        let mut alone = capture.eye(arms, [Vec::new(), Vec::new()]).unwrap();
        let mut seen = Vec::new();
        for (view, light) in [(0, 1), (0, 2), (1, 2), (0, 1)] {
            let there = Stance { view, light, joints: [foreseen[CAMERA][view], foreseen[LIGHT][light]] };
            let mut beside = there;
            beside.joints[LIGHT][0] += 0.02;
            for stance in [there, beside] {
                let picture = foreseeing.shoot(&stance).unwrap();
                assert_eq!(picture, alone.shoot(&stance).unwrap(), "{view} {light}");
                seen.push(picture);
            }
        }
        assert_ne!(seen[0], seen[1], "the lamp has moved");
        assert_ne!(seen[0], seen[2]);
        assert_eq!(seen[0], seen[6]);
    }
}
