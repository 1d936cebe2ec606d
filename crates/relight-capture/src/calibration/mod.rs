//! Where camera and light were: a ChArUco board for the camera, touches of the board for the light.
//!
//! A [`Board`] is printed ([`Sheet`]), laid in the middle of the rig, and [`detect`]ed in an image from every waypoint;
//! [`calibrate`] fits one lens and all viewpoints together, and registers the light's arm by its touches. Photographs for the
//! lens alone, from [`lens_viewpoints`], tell apart what waypoints under one tilt cannot. The [`Calibration`] is [`store`]d, and
//! a later [`recheck`] says whether it still holds.

mod adjustment;
mod board;
mod board_file;
mod calibrate;
mod detection;
mod dictionary;
pub(crate) mod frames;
mod homography;
mod lens;
mod lens_viewpoints;
mod light;
mod recheck;
mod recovery;
mod report;
mod result;
mod robust;
mod saddle;
mod session_folder;
mod sheet;
mod store;
mod viewpoint;
mod zhang;

pub use board::{Board, BoardError};
pub use board_file::{BoardFile, BoardFileError, BoardSettings};
pub use calibrate::{CalibrationError, Measurements, WaypointView, calibrate};
pub use detection::{Corner, DetectionError, detect};
pub use dictionary::{Dictionary, UnknownDictionary};
pub use lens_viewpoints::lens_viewpoints;
pub use light::{LightRegistration, Touch, TouchError, register_light};
pub use recheck::{Recheck, RecheckError, Shift, Tolerance, recheck};
pub use result::{
    CENTRE_ACCURACY, Calibration, DIRECTION_ACCURACY, LARGEST_LENS_SHIFT, LeftOut, LensPhotograph, Waypoint,
};
pub use session_folder::{
    BOARD, CALIBRATION, LENS_VIEWS, RECHECK, ShootError, VIEWS, photograph_name, shoot_board,
};
pub use sheet::Sheet;
pub(crate) use store::StoredIntrinsics;
pub use store::{FORMAT, StoreError, load, store};
