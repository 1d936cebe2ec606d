//! What a calibration has found.

use relight_scene::{Intrinsics, Pose};

use super::board::Board;
use super::lens::LENS;
use super::light::LightRegistration;

/// An expected error of the camera's centre beyond this makes a waypoint weak, metres.
pub const CENTRE_ACCURACY: f64 = 0.1e-3;
/// The same of its direction, radians.
pub const DIRECTION_ACCURACY: f64 = 0.02 * std::f64::consts::PI / 180.0;
/// A lens that lies farther from an earlier one than this many standard errors of that is another one: over nine numbers, that
/// hardly ever happens by chance.
pub const LARGEST_LENS_SHIFT: f64 = 5.5;

/// Lens, camera poses and the light arm's place, with what is known of their errors.
#[derive(Clone, Debug, PartialEq)]
pub struct Calibration {
    /// The board.
    pub board: Board,
    /// Where the board lay.
    pub board_to_world: Pose,
    /// The lens; distortion `k1 k2 p1 p2 k3`.
    pub intrinsics: Intrinsics,
    /// Standard errors of `fx fy cx cy k1 k2 p1 p2 k3`; 0 where a number was held because the views do not support it.
    pub intrinsics_errors: [f64; LENS],
    /// What the photographs tell of those numbers: the matrix of their normal equations once all viewpoints are eliminated, in
    /// square pixels. A later session can begin with it ([`Measurements::earlier`](super::Measurements::earlier)).
    pub lens_information: [[f64; LENS]; LENS],
    /// Variance of one coordinate of a corner, square pixels.
    pub corner_variance: f64,
    /// How far the lens has come from the earlier one that it began with, in standard errors of that; none without one.
    pub lens_shift: Option<f64>,
    /// Photographs for the lens alone, in the order of the views.
    pub lens_photographs: Vec<LensPhotograph>,
    /// Root mean square of all residuals of good waypoints, pixels.
    pub rms_pixels: f64,
    /// Waypoints whose pose is known, in the order of the views.
    pub waypoints: Vec<Waypoint>,
    /// Waypoints without a pose.
    pub left_out: Vec<LeftOut>,
    /// The light's arm, if touches were given.
    pub light: Option<LightRegistration>,
}

impl Calibration {
    /// Waypoints that are to be shot again.
    pub fn bad(&self) -> Vec<usize> {
        self.waypoints.iter().filter(|w| w.is_bad).map(|w| w.label).collect()
    }

    /// Waypoints whose geometry leaves them too uncertain, however small the residuals: nearly always, because the lens is.
    pub fn weak(&self) -> Vec<usize> {
        self.waypoints.iter().filter(|w| w.is_weak()).map(|w| w.label).collect()
    }

    /// Whether the lens is no longer the earlier one that the calibration began with.
    pub fn is_another_lens(&self) -> bool {
        self.lens_shift.is_some_and(|shift| shift > LARGEST_LENS_SHIFT)
    }
}

/// A photograph that helped to determine the lens, or should have.
#[derive(Clone, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LensPhotograph {
    /// Its number, in the order of the names of files.
    pub label: usize,
    /// Corners that it shows.
    pub corners: usize,
    /// Root mean square of its residuals, pixels, if they fit a viewpoint.
    pub rms_pixels: Option<f64>,
    /// Why it took no part.
    pub problem: Option<String>,
}

/// Where the camera was at a waypoint.
#[derive(Clone, Debug, PartialEq)]
pub struct Waypoint {
    /// The waypoint's number.
    pub label: usize,
    /// Camera-to-world.
    pub pose: Pose,
    /// Corners that were used.
    pub corners: usize,
    /// Root mean square of its residuals, pixels.
    pub rms_pixels: f64,
    /// Its largest residual, pixels.
    pub worst_pixels: f64,
    /// Root mean square of its residuals at the board's distance, across the line of sight, metres.
    pub rms_metres: f64,
    /// Standard error of the camera's centre, the lens's uncertainty included, metres.
    pub position_error: f64,
    /// The same of its orientation, radians.
    pub rotation_error: f64,
    /// Its residuals are far above the others': blurred, moved or wrongly read. It took no part in the lens; shoot it again.
    pub is_bad: bool,
}

impl Waypoint {
    /// Whether its pose is expected to be wrong by more than [`CENTRE_ACCURACY`] or [`DIRECTION_ACCURACY`].
    pub fn is_weak(&self) -> bool {
        self.position_error > CENTRE_ACCURACY || self.rotation_error > DIRECTION_ACCURACY
    }
}

/// A waypoint that gave no pose.
#[derive(Clone, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub struct LeftOut {
    /// The waypoint's number.
    pub label: usize,
    /// Why.
    pub reason: String,
}
