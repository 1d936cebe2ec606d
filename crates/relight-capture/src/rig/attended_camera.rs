//! A camera, and somebody who holds things before it.

use super::arms_rig::{Eye, Stance};
use crate::camera::{Camera, CameraError, Frame};
use crate::session::{RigFault, Target};

/// A camera that takes photographs wherever it was brought. `show` is told what it is to see, and returns once that is there.
pub struct AttendedCamera<'a> {
    camera: Box<dyn Camera>,
    show: Box<dyn FnMut(Target) -> Result<(), RigFault> + 'a>,
}

impl<'a> AttendedCamera<'a> {
    /// A camera that somebody attends to.
    pub fn new(
        camera: Box<dyn Camera>,
        show: Box<dyn FnMut(Target) -> Result<(), RigFault> + 'a>,
    ) -> AttendedCamera<'a> {
        AttendedCamera { camera, show }
    }
}

impl Eye for AttendedCamera<'_> {
    fn shoot(&mut self, _: &Stance) -> Result<Frame, CameraError> {
        self.camera.shoot()
    }

    fn expose(&mut self, multiple: f64) -> Result<(), CameraError> {
        self.camera.expose(multiple)
    }

    fn show(&mut self, target: Target) -> Result<(), RigFault> {
        (self.show)(target)
    }
}
