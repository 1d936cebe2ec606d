//! A rig without arms: somebody brings camera and lamp to their places.

use super::arms_rig::{Eye, Stance};
use crate::camera::{CameraError, Frame};
use crate::session::{Rig, RigFault, Target};

/// Takes photographs of views and lights that somebody else brings about. `place` is told which view and light come next, and
/// returns once they are there.
pub struct HandRig<'a> {
    eye: Box<dyn Eye + 'a>,
    place: Box<dyn FnMut(usize, usize) -> Result<(), RigFault> + 'a>,
    stance: Stance,
}

impl<'a> HandRig<'a> {
    /// A rig whose photographs `eye` takes.
    pub fn new(
        eye: Box<dyn Eye + 'a>,
        place: Box<dyn FnMut(usize, usize) -> Result<(), RigFault> + 'a>,
    ) -> Self {
        HandRig { eye, place, stance: Stance { view: 0, light: 0, joints: [[0.0; 6]; 2] } }
    }
}

impl Rig for HandRig<'_> {
    fn view(&mut self, view: usize) -> Result<(), RigFault> {
        self.stance.view = view;
        Ok(())
    }

    fn light(&mut self, light: usize) -> Result<(), RigFault> {
        self.stance.light = light;
        (self.place)(self.stance.view, light)
    }

    fn shoot(&mut self) -> Result<Frame, CameraError> {
        self.eye.shoot(&self.stance)
    }

    fn expose(&mut self, multiple: f64) -> Result<(), CameraError> {
        self.eye.expose(multiple)
    }

    fn show(&mut self, target: Target) -> Result<(), RigFault> {
        self.eye.show(target)
    }
}
