//! What is true of a session of board photographs: where arms came to rest that were told to go somewhere.

use relight_scene::Pose;
use serde::Serialize;

use super::{BoardCapture, BoardCaptureError};
use crate::calibration::frames::compose;
use crate::calibration::{StoredIntrinsics, Touch, lens_viewpoints};
use crate::kinematics::{Arm, Joints};
use crate::rig::{CAMERA, LIGHT, Prepared, SimulatedArms, station};

/// The file of the truth, which only tests and curious people read.
pub const TRUTH: &str = "truth.json";
const FORMAT: &str = "relight-truth-1";
/// Distance of the photographs for the lens, metres.
const DISTANCE: f64 = 0.6;
/// Where everything is.
pub(super) struct Truth {
    /// The arms where they stand.
    pub arms: [Arm; 2],
    /// Joints at the waypoints, by the numbers of the plan's labels.
    pub rests: [Vec<Joints>; 2],
    /// The number of the light that shines on the board.
    pub lamp: usize,
    /// Cameras of the photographs for the lens, held by hand.
    pub lens_cameras: Vec<Pose>,
    /// What somebody reads who brings the light's arm to points of the board.
    pub touches: Vec<Touch>,
}

impl Truth {
    /// What will be: the noise of simulated arms can be foreseen.
    pub fn new(
        capture: &BoardCapture,
        prepared: &Prepared,
        simulated: &SimulatedArms,
    ) -> Result<Truth, BoardCaptureError> {
        let itinerary = &prepared.itinerary;
        let arms = itinerary.cell().arms().clone();
        let rests = [CAMERA, LIGHT].map(|arm| {
            let rest = |&label: &usize| simulated.foresee(arm, itinerary.joints(arm, station(label)));
            prepared.labels[arm].iter().map(rest).collect::<Vec<_>>()
        });
        // The highest: least of the board is in glancing light.
        let height = |joints: &Joints| arms[LIGHT].tool_pose(joints).position()[2];
        let lights = rests[LIGHT].iter().map(height).enumerate();
        let lamp = lights.max_by(|a, b| a.1.total_cmp(&b.1)).map_or(0, |(number, _)| number);
        let touches = touches(capture, &arms[LIGHT], simulated)?;
        let lens_cameras = lens_viewpoints(capture.lens_views, DISTANCE);
        Ok(Truth { arms, rests, lamp, lens_cameras, touches })
    }

    /// Where the lamp is that shines on the board.
    pub fn lamp_pose(&self) -> Pose {
        self.rests[LIGHT].get(self.lamp).map_or(Pose::IDENTITY, |joints| self.arms[LIGHT].tool_pose(joints))
    }

    /// As the file has it.
    pub fn to_json(&self, capture: &BoardCapture, prepared: &Prepared) -> serde_json::Result<String> {
        let itinerary = &prepared.itinerary;
        let numbered = |arm: usize| prepared.labels[arm].iter().zip(&self.rests[arm]);
        let reached = |arm: usize, joints: &Joints| self.arms[arm].tool_pose(joints).to_matrix();
        let cameras = numbered(CAMERA).map(|(&label, joints)| TruePose {
            label,
            planned: itinerary.pose(CAMERA, label).to_matrix(),
            to_world: reached(CAMERA, joints),
        });
        // What the arm is told; it comes to rest beside that.
        let base = itinerary.arm(LIGHT).base.inverse();
        let lights = numbered(LIGHT).map(|(&label, joints)| TrueLight {
            label,
            told_in_base: compose(&base, &itinerary.pose(LIGHT, label)).to_matrix(),
            to_world: reached(LIGHT, joints),
        });
        let by_hand = self.lens_cameras.iter().map(Pose::to_matrix).enumerate();
        serde_json::to_string_pretty(&File {
            format: FORMAT,
            samples: capture.samples,
            seed: capture.seed,
            lens: StoredIntrinsics::from(&capture.intrinsics()),
            cameras: cameras.collect(),
            lens_cameras: by_hand
                .map(|(label, pose)| TruePose { label, planned: pose, to_world: pose })
                .collect(),
            light_base_to_world: self.arms[LIGHT].base.to_matrix(),
            lights: lights.collect(),
        })
    }
}

/// The file of the truth.
#[derive(Serialize)]
struct File {
    format: &'static str,
    samples: u32,
    seed: u64,
    lens: StoredIntrinsics,
    cameras: Vec<TruePose>,
    lens_cameras: Vec<TruePose>,
    light_base_to_world: [f64; 16],
    lights: Vec<TrueLight>,
}

#[derive(Serialize)]
struct TruePose {
    label: usize,
    planned: [f64; 16],
    to_world: [f64; 16],
}

/// A light that its arm was told to bring to a pose of its own frame.
#[derive(Serialize)]
struct TrueLight {
    label: usize,
    told_in_base: [f64; 16],
    to_world: [f64; 16],
}

/// The arm's tip on points of the board, as far round as the board goes. Somebody brings it there, by sight, and it comes to
/// rest as near as it does anywhere.
fn touches(
    capture: &BoardCapture,
    arm: &Arm,
    simulated: &SimulatedArms,
) -> Result<Vec<Touch>, BoardCaptureError> {
    let board = &capture.board;
    let [w, h] = board.size();
    let places =
        [[0.0, 0.0], [w, h], [w, 0.0], [0.0, h], [w / 2.0, 0.0], [w / 2.0, h], [0.0, h / 2.0], [w, h / 2.0]];
    let touch = |&[x, y]: &[f64; 2]| {
        let on_board = [x, y, 0.0];
        let [x, y, z] = board.lying_flat().transform(on_board);
        let from_above = Pose([[1.0, 0.0, 0.0, x], [0.0, -1.0, 0.0, y], [0.0, 0.0, -1.0, z]]);
        let reached = arm.reach(&from_above, &arm.model.upright);
        let joints = reached.map_err(|fault| BoardCaptureError::OutOfReach { at: on_board, fault })?[0];
        let tip = arm.tool_pose(&simulated.foresee(LIGHT, &joints)).position();
        Ok(Touch { on_board, in_arm: arm.base.inverse_transform(tip) })
    };
    places.iter().take(capture.touches).map(touch).collect()
}
