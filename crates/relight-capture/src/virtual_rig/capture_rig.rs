//! The virtual rig as a session drives it.

use relight_scene::{Camera, Intrinsics, Light};

use super::VirtualRig;
use super::card::grey_card;
use crate::camera::{CameraError, Frame};
use crate::session::{Rig, RigFault, Target};

/// Takes the place of arms, lamp and camera. All lights of a view are photographed at once, when the first of them is asked
/// for.
pub struct CaptureRig {
    rig: VirtualRig,
    cameras: Vec<Camera>,
    lights: Vec<Light>,
    view: usize,
    light: usize,
    /// Photographs of the view, by light; none before the first is asked for.
    photographs: Vec<Frame>,
    is_raw: bool,
    /// What is before the camera, and how many frames were shot of it if it is not the scene.
    target: Target,
    frames: usize,
    /// The same before a grey card, while that is shown.
    card: Option<VirtualRig>,
}

impl CaptureRig {
    /// A rig whose views and lights stand where these do.
    pub fn new(rig: VirtualRig, cameras: Vec<Camera>, lights: Vec<Light>) -> CaptureRig {
        let (photographs, target) = (Vec::new(), Target::Scene);
        CaptureRig {
            rig,
            cameras,
            lights,
            view: 0,
            light: 0,
            photographs,
            is_raw: false,
            target,
            frames: 0,
            card: None,
        }
    }

    /// The rig with a camera that gives [raw frames](VirtualRig::raw).
    pub fn raw(self) -> CaptureRig {
        CaptureRig { is_raw: true, ..self }
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
        self.photograph(camera, &[light]).pop().ok_or_else(|| CameraError::Failed {
            problem: "the path tracer made no picture".to_owned(),
            mend: "Ask for one light at least.",
        })
    }

    /// A photograph of what is held before the camera, whose lens is this; none if that is the scene.
    pub fn shoot_target(&mut self, lens: &Intrinsics) -> Option<Frame> {
        let is_white = match self.target {
            Target::Scene | Target::Card(_) => return None,
            Target::Dark => false,
            Target::Flat => true,
        };
        self.frames += 1;
        Some(self.rig.raw_target(lens, is_white, self.frames))
    }

    fn photograph(&self, camera: &Camera, lights: &[Light]) -> Vec<Frame> {
        let rig = self.card.as_ref().unwrap_or(&self.rig);
        if self.is_raw {
            return rig.raw(camera, lights);
        }
        rig.photograph(camera, lights).into_iter().map(Frame::Developed).collect()
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
        if let Some(lens) = self.cameras.get(self.view).map(|camera| camera.intrinsics.clone())
            && let Some(frame) = self.shoot_target(&lens)
        {
            return Ok(frame);
        }
        if self.photographs.is_empty()
            && let Some(camera) = self.cameras.get(self.view)
        {
            self.photographs = self.photograph(camera, &self.lights);
        }
        let photograph = self.photographs.get(self.light).ok_or_else(|| CameraError::Failed {
            problem: format!("there is no view {} under light {}", self.view, self.light),
            mend: "The session's plan is not that of its rig.",
        })?;
        Ok(photograph.clone())
    }

    fn show(&mut self, target: Target) -> Result<(), RigFault> {
        self.card = match target {
            Target::Card(at) => {
                Some(grey_card(at).and_then(|card| self.rig.before(&card)).map_err(|error| {
                    CameraError::Failed {
                        problem: error.to_string(),
                        mend: "Lay the card elsewhere (card-metres).",
                    }
                })?)
            }
            _ => None,
        };
        self.photographs.clear();
        (self.target, self.frames) = (target, 0);
        Ok(())
    }
}
