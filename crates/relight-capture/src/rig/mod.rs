//! Two arms and a camera as a session drives them.
//!
//! A [`RigFile`] says where waypoints, arms and controllers are and what takes the photographs. [`Prepared`] plans everything
//! before anything moves: an [`Itinerary`] holds, for each place of the one arm, the [`Roadmap`] of motions that are free for
//! the other. An [`ArmsRig`] goes along them and nowhere else, and is what a session drives; [`walk()`] drives it without a
//! camera, a [`HandRig`] is a camera without arms. An [`AttendedCamera`] has somebody who holds things before it.
//!
//! One arm moves at a time: the camera while the light is at home, the light while the camera stands. A rig is
//! taken up where it stands, at any planned place or where a motion was interrupted.

mod arms_rig;
mod attended_camera;
mod controllers;
mod error;
mod file;
mod hand_rig;
mod itinerary;
mod roadmap;
mod shots;
mod suggestion;
mod walk;
mod whereabouts;

pub use arms_rig::{ArmsRig, Eye, Pace, Stance, Travel};
pub use attended_camera::AttendedCamera;
pub use controllers::{Arms, SimulatedArms, connect};
pub use error::{ArmsFault, SetupError};
pub use file::{Controllers, Developing, MotionSettings, Photographs, RigFile, RoughLens};
pub use hand_rig::HandRig;
pub use itinerary::{CAMERA, Itinerary, LIGHT, station};
pub use roadmap::{HOME, Roadmap};
pub use shots::Prepared;
pub use walk::{NoEye, Walk, walk};
