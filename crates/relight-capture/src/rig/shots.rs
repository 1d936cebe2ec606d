//! What a session with arms shoots, and where its cameras and lights are taken to be.

use std::collections::HashMap;

use relight_scene::{Intrinsics, Pose};

use super::error::SetupError;
use super::file::RigFile;
use super::itinerary::{CAMERA, Itinerary, LIGHT};
use crate::calibration::Calibration;
use crate::kinematics::ArmsSettings;
use crate::session::Shots;
use crate::trajectory::{Plan, PlanSettings, Waypoint};

/// A calibrated camera farther than this from its waypoint is that of another plan, metres: bases are measured to some
/// centimetres. So is a light's arm.
const FARTHEST: f64 = 0.1;
/// One that looks elsewhere by more than this likewise, radians.
const ASKEW: f64 = 0.2;

/// Everything about a session that is known before an arm moves.
#[derive(Clone, Debug)]
pub struct Prepared {
    /// The plan, with the reasons of what is not reached.
    pub plan: Plan,
    /// All motions.
    pub itinerary: Itinerary,
    /// Labels of the waypoints that are shot, by the number of the view or light in the scene. They differ where waypoints were
    /// left out, since a scene counts its views without gaps.
    pub labels: [Vec<usize>; 2],
}

impl Prepared {
    /// Plans waypoints and motions.
    ///
    /// # Errors
    /// If the rig cannot be, or nothing is reached.
    pub fn new(settings: &PlanSettings, arms: &ArmsSettings) -> Result<Prepared, SetupError> {
        let mut plan = Plan::new(settings)?;
        let cell = arms.cell(plan.object)?;
        let itinerary = Itinerary::plan(cell, &arms.homes(), &mut plan)?;
        let labels = [CAMERA, LIGHT].map(|arm| {
            let mut labels = itinerary.order(arm).to_vec();
            labels.sort_unstable();
            labels
        });
        for (labels, what) in labels.iter().zip(["view", "light"]) {
            if labels.is_empty() {
                return Err(SetupError::Nothing(what));
            }
        }
        Ok(Prepared { plan, itinerary, labels })
    }

    /// The waypoints that are left out, each with the reason.
    pub fn left_out(&self) -> Vec<String> {
        let reasons = |what, waypoints: &[Waypoint]| -> Vec<String> {
            let reason = |w: &Waypoint| {
                Some(format!("{what} waypoint {} is left out: {}", w.label, w.unreachable.as_ref()?))
            };
            waypoints.iter().filter_map(reason).collect()
        };
        [reasons("camera", &self.plan.camera.waypoints), reasons("light", &self.plan.light.waypoints)]
            .concat()
    }

    /// The session's shots: views and lights stand where `poses` says for an arm and a waypoint's label.
    pub fn shots(
        &self,
        file: &RigFile,
        intrinsics: Intrinsics,
        poses: impl Fn(usize, usize) -> Pose,
    ) -> Shots {
        let posed = |arm: usize| self.labels[arm].iter().map(|&label| poses(arm, label)).collect();
        let order = |arm: usize| {
            let numbers: HashMap<usize, usize> =
                self.labels[arm].iter().enumerate().map(|(number, &label)| (label, number)).collect();
            self.itinerary.order(arm).iter().filter_map(|label| numbers.get(label).copied()).collect()
        };
        Shots {
            intrinsics,
            cameras: posed(CAMERA),
            lights: posed(LIGHT),
            view_order: order(CAMERA),
            light_order: order(LIGHT),
            development: file.development(),
        }
    }

    /// Where a calibration says that cameras and lights are, by arm and label. Without registered touches the light's arm
    /// is taken to stand where the rig file says.
    ///
    /// # Errors
    /// If the calibration is of another plan: a view is not in it, or nowhere near its waypoint.
    pub fn calibrated(
        &self,
        calibration: &Calibration,
    ) -> Result<impl Fn(usize, usize) -> Pose + use<>, SetupError> {
        let mut poses: [HashMap<usize, Pose>; 2] = Default::default();
        for &label in &self.labels[CAMERA] {
            let found = calibration.waypoints.iter().find(|waypoint| waypoint.label == label);
            let found =
                found.ok_or_else(|| SetupError::Calibration(format!("it has no camera waypoint {label}")))?;
            self.compare(
                &format!("camera waypoint {label}"),
                &found.pose,
                &self.itinerary.pose(CAMERA, label),
            )?;
            poses[CAMERA].insert(label, found.pose);
        }
        let arm = self.itinerary.arm(LIGHT);
        let mut light = arm.clone();
        if let Some(registered) = &calibration.light {
            self.compare("the base of the light's arm", &registered.base_to_world, &arm.base)?;
            light.base = registered.base_to_world;
        }
        for &label in &self.labels[LIGHT] {
            let joints = self.itinerary.joints(LIGHT, super::station(label));
            poses[LIGHT].insert(label, light.tool_pose(joints));
        }
        Ok(move |arm: usize, label: usize| poses[arm].get(&label).copied().unwrap_or(Pose::IDENTITY))
    }

    /// Refuses a calibrated pose that cannot be that of a planned one.
    fn compare(&self, what: &str, calibrated: &Pose, planned: &Pose) -> Result<(), SetupError> {
        let (a, b) = (calibrated.position(), planned.position());
        let far = a.iter().zip(b).map(|(a, b)| (a - b) * (a - b)).sum::<f64>().sqrt();
        // The angle of the rotation between them, from its trace.
        let trace: f64 = (0..3)
            .flat_map(|i| (0..3).map(move |j| (i, j)))
            .map(|(i, j)| calibrated.0[i][j] * planned.0[i][j])
            .sum();
        let angle = ((trace - 1.0) / 2.0).clamp(-1.0, 1.0).acos();
        if far <= FARTHEST && angle <= ASKEW {
            return Ok(());
        }
        Err(SetupError::Calibration(format!(
            "it has {what} {:.0} mm and {:.1} degrees from where the plan has it",
            far * 1e3,
            angle.to_degrees()
        )))
    }
}
