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
}

impl Rig for CaptureRig {
    fn view(&mut self, view: usize) -> Result<(), RigFault> {
        (self.view, self.photographs) = (view, Vec::new());
        Ok(())
    }

    fn light(&mut self, light: usize) -> Result<(), RigFault> {
        self.light = light;
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
