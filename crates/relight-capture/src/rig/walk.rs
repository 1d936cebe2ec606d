//! A session without photographs: arms go through all waypoints.

use std::ops::ControlFlow;

use super::arms_rig::{ArmsRig, Travel};
use crate::camera::{CameraError, Frame};
use crate::session::{Progress, Rig, RigFault, Shots, Target};

use super::arms_rig::{Eye, Stance};
use super::error::ArmsFault;

/// No camera at all.
pub struct NoEye;

impl Eye for NoEye {
    fn shoot(&mut self, _: &Stance) -> Result<Frame, CameraError> {
        Err(CameraError::Failed {
            problem: "the rig was set up without one".to_owned(),
            mend: "Shoot with the camera of the rig file.",
        })
    }

    fn show(&mut self, _: Target) -> Result<(), RigFault> {
        Err(RigFault::NoTarget)
    }
}

/// How far a walk came.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Walk {
    /// All waypoints were visited; how far the arms went for each view, in the order of visit, and then home.
    Complete(Vec<Travel>),
    /// It was told to stop.
    Stopped,
}

/// Takes the arms through every view under every light as a session would, and home.
///
/// # Errors
/// If an arm does not arrive.
pub fn walk(
    rig: &mut ArmsRig,
    shots: &Shots,
    progress: &mut dyn FnMut(Progress) -> ControlFlow<()>,
) -> Result<Walk, RigFault> {
    let total = shots.view_order.len() * shots.light_order.len();
    let (mut done, mut travels) = (0, Vec::with_capacity(shots.view_order.len() + 1));
    let mut before = rig.travel();
    let mut leg = |rig: &ArmsRig| {
        let now = rig.travel();
        let motions = [0, 1].map(|arm| now.motions[arm] - before.motions[arm]);
        travels.push(Travel { motions, time: now.time.saturating_sub(before.time) });
        before = now;
    };
    for (i, &view) in shots.view_order.iter().enumerate() {
        for (j, light) in shots.lights_of(i).into_iter().enumerate() {
            if progress(Progress { done, resumed: 0, total }).is_break() {
                return Ok(Walk::Stopped);
            }
            if j == 0 {
                rig.view(view)?;
            }
            rig.light(light)?;
            done += 1;
        }
        leg(rig);
    }
    let parked = rig.park().map_err(|fault: ArmsFault| RigFault::Motion(Box::new(fault)));
    parked?;
    leg(rig);
    // Nothing is left to be stopped.
    let _ = progress(Progress { done, resumed: 0, total });
    Ok(Walk::Complete(travels))
}
