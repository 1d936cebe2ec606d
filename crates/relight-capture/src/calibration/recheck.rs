//! Whether a stored calibration still holds.

use relight_scene::Pose;
use serde::Serialize;

use super::adjustment::{self, View};
use super::calibrate::{CalibrationError, WaypointView, check_views};
use super::frames::compose;
use super::lens::Lens;
use super::result::Calibration;
use super::robust::{FEWEST_CORNERS, lengths, median, sightings};
use super::viewpoint::Viewpoint;

/// Corners farther off than this in a new viewpoint pull no harder, pixels.
const THRESHOLD: f64 = 0.5;

/// How far corners may have shifted before a waypoint counts as moved.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Tolerance {
    /// Median shift in the image, pixels.
    pub pixels: f64,
    /// The same at the board's distance, metres.
    pub metres: f64,
}

impl Default for Tolerance {
    /// Half a pixel, a sixth of a millimetre: some times what an arm's repeatability of 0.03 mm explains.
    fn default() -> Self {
        Self { pixels: 0.5, metres: 0.15e-3 }
    }
}

/// What a re-check has found.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Recheck {
    /// Whether the board was seen from all waypoints that there are photographs of, and none has moved.
    pub holds: bool,
    /// One for each view.
    pub waypoints: Vec<Shift>,
}

/// How a waypoint has shifted since the calibration.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Shift {
    /// The waypoint's number.
    pub label: usize,
    /// Corners that were compared.
    pub corners: usize,
    /// Median distance from where the stored calibration expects each corner, pixels; none where too few corners are seen.
    pub pixels: Option<f64>,
    /// The same at the board's distance, metres.
    pub metres: Option<f64>,
    /// How far the camera's centre has moved, metres, if the corners determine it.
    pub camera_moved: Option<f64>,
    /// Whether that is more than the tolerance.
    pub has_moved: bool,
}

/// Compares new detections at some waypoints with what a stored calibration expects.
///
/// # Errors
/// [`RecheckError`] if a view is of no waypoint of the calibration, or holds corners that its board does not have.
pub fn recheck(
    calibration: &Calibration,
    views: &[WaypointView],
    tolerance: Tolerance,
) -> Result<Recheck, RecheckError> {
    check_views(views, &calibration.board)?;
    let lens = Lens::of(&calibration.intrinsics).ok_or(RecheckError::Lens)?;
    let world_to_board = calibration.board_to_world.inverse();
    let shift = |view: &WaypointView| {
        let known = calibration.waypoints.iter().find(|waypoint| waypoint.label == view.label);
        let stored = known.ok_or(RecheckError::UnknownWaypoint(view.label))?.pose;
        Ok(shift(calibration, &lens, view, &compose(&world_to_board, &stored), tolerance))
    };
    let waypoints = views.iter().map(shift).collect::<Result<Vec<_>, RecheckError>>()?;
    let holds = !waypoints.is_empty() && waypoints.iter().all(|w| w.pixels.is_some() && !w.has_moved);
    Ok(Recheck { holds, waypoints })
}

/// Why a re-check is not possible.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum RecheckError {
    /// The calibration has no such waypoint.
    #[error("the calibration has no waypoint {0}; re-check waypoints that it has, or calibrate anew")]
    UnknownWaypoint(usize),
    /// The stored lens has coefficients that calibrations do not have.
    #[error("the calibration's lens has more than five distortion coefficients")]
    Lens,
    /// The views are wrong in themselves.
    #[error(transparent)]
    Views(#[from] CalibrationError),
}

fn shift(
    calibration: &Calibration,
    lens: &Lens,
    view: &WaypointView,
    camera_to_board: &Pose,
    tolerance: Tolerance,
) -> Shift {
    let mut now = View {
        viewpoint: Viewpoint::of_pose(camera_to_board),
        sightings: sightings(view, &calibration.board),
    };
    let corners = now.sightings.len();
    if corners < FEWEST_CORNERS {
        return Shift {
            label: view.label,
            corners,
            pixels: None,
            metres: None,
            camera_moved: None,
            has_moved: false,
        };
    }
    let pixels = median(lengths(lens, &now));
    let before = now.viewpoint.centre;
    let middle = calibration.board.size().map(|side| side / 2.0);
    let distance = (before.x - middle[0]).hypot(before.y - middle[1]).hypot(before.z);
    let metres = pixels * distance / lens.focal_length();
    let camera_moved = adjustment::adjust_viewpoint(lens, &mut now, THRESHOLD);
    Shift {
        label: view.label,
        corners,
        pixels: Some(pixels),
        metres: Some(metres),
        camera_moved: camera_moved.map(|_| (now.viewpoint.centre - before).norm()),
        has_moved: pixels > tolerance.pixels || metres > tolerance.metres,
    }
}
