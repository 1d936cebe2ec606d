//! The virtual rig as a session drives it.

use relight_scene::{Camera, Image, Light};

use super::VirtualRig;
use crate::camera::{CameraError, Frame};
use crate::session::{Rig, RigFault};

/// Takes the place of arms, lamp and camera. All lights of a view are photographed at once, when the first of them is asked
/// for.
pub struct CaptureRig {
    rig: VirtualRig,
    cameras: Vec<Camera>,
    lights: Vec<Light>,
    view: usize,
    light: usize,
    /// Photographs of the view, by light; none before the first is asked for.
    photographs: Vec<Image>,
}

impl CaptureRig {
    /// A rig whose views and lights stand where these do.
    pub fn new(rig: VirtualRig, cameras: Vec<Camera>, lights: Vec<Light>) -> CaptureRig {
        CaptureRig { rig, cameras, lights, view: 0, light: 0, photographs: Vec::new() }
    }

    /// Turns to another view or light. Photographs of the same view are kept.
    pub fn turn_to(&mut self, view: usize, light: usize) {
        if view != self.view {
            self.photographs.clear();
        }
        (self.view, self.light) = (view, light);
    }

    /// A photograph from elsewhere, which shares nothing with others.
    pub fn shoot_from(&self, camera: &Camera, light: Light) -> Result<Frame, CameraError> {
        let photograph = self.rig.photograph(camera, &[light]).pop();
        photograph.map(Frame::Developed).ok_or_else(|| CameraError::Failed {
            problem: "the path tracer made no picture".to_owned(),
            mend: "Ask for one light at least.",
        })
    }
}

impl Rig for CaptureRig {
    fn view(&mut self, view: usize) -> Result<(), RigFault> {
        self.turn_to(view, self.light);
        Ok(())
    }

    fn light(&mut self, light: usize) -> Result<(), RigFault> {
        self.turn_to(self.view, light);
        Ok(())
    }

    fn shoot(&mut self) -> Result<Frame, CameraError> {
        if self.photographs.is_empty()
            && let Some(camera) = self.cameras.get(self.view)
        {
            self.photographs = self.rig.photograph(camera, &self.lights);
        }
        let photograph = self.photographs.get(self.light).ok_or_else(|| CameraError::Failed {
            problem: format!("there is no view {} under light {}", self.view, self.light),
            mend: "The session's plan is not that of its rig.",
        })?;
        Ok(Frame::Developed(photograph.clone()))
    }
}
