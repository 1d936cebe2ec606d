//! Lens and viewpoints from the corners of many views.

use relight_scene::{Image, Intrinsics, Pose};

use super::adjustment::{self, Covariance, View};
use super::board::Board;
use super::detection::{Corner, DetectionError, detect};
use super::frames::compose;
use super::lens::{LENS, Lens};
use super::light::{LightRegistration, Touch, TouchError, register_light};
use super::robust::{self, Fitted, Usable, lengths, mean};
use super::zhang;

/// Fewest views that determine a lens well enough to try.
const FEWEST_VIEWS: usize = 4;
/// Largest standard error of a focal length, as a share of it, in a calibration worth using.
const LARGEST_FOCAL_ERROR: f64 = 0.01;

/// What was seen of the board from a waypoint.
#[derive(Clone, Debug, PartialEq)]
pub struct WaypointView {
    /// The waypoint's number.
    pub label: usize,
    /// Corners in one image, or in several of the same waypoint one after another.
    pub corners: Vec<Corner>,
}

impl WaypointView {
    /// The corners of one or more images that were shot at a waypoint.
    ///
    /// # Errors
    /// If an image's size contradicts its pixels.
    pub fn of_images(label: usize, images: &[Image], board: &Board) -> Result<WaypointView, DetectionError> {
        let corners = images.iter().map(|image| detect(image, board)).collect::<Result<Vec<_>, _>>()?;
        Ok(WaypointView { label, corners: corners.concat() })
    }
}

/// All that a calibration is made from.
#[derive(Clone, Copy, Debug)]
pub struct Measurements<'a> {
    /// The board, measured after printing.
    pub board: &'a Board,
    /// Where the board lies ([`Board::lying_flat`] where it defines the world).
    pub board_to_world: Pose,
    /// Width and height of the images, pixels.
    pub image_size: (u32, u32),
    /// What the camera saw.
    pub views: &'a [WaypointView],
    /// Where the light's arm touched the board; empty to leave the light out.
    pub touches: &'a [Touch],
    /// Base-of-the-light's-arm-to-world rotation if it is declared, not measured; its translation is not used.
    pub declared_alignment: Option<Pose>,
}

/// Lens, camera poses and the light arm's place, with what is known of their errors.
#[derive(Clone, Debug, PartialEq)]
pub struct Calibration {
    /// The board.
    pub board: Board,
    /// Where the board lay.
    pub board_to_world: Pose,
    /// The lens; distortion `k1 k2 p1 p2 k3`.
    pub intrinsics: Intrinsics,
    /// Standard errors of `fx fy cx cy k1 k2 p1 p2 k3`.
    pub intrinsics_errors: [f64; LENS],
    /// Root mean square of all residuals of good waypoints, pixels.
    pub rms_pixels: f64,
    /// Waypoints whose pose is known, in the order of the views.
    pub waypoints: Vec<Waypoint>,
    /// Waypoints without a pose.
    pub left_out: Vec<LeftOut>,
    /// The light's arm, if touches were given.
    pub light: Option<LightRegistration>,
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
    /// Standard error of the camera's centre, metres.
    pub position_error: f64,
    /// Standard error of the camera's direction, radians.
    pub rotation_error: f64,
    /// Its residuals are far above the others': blurred, moved or wrongly read. It took no part in the lens; shoot it again.
    pub is_bad: bool,
}

/// A waypoint that gave no pose.
#[derive(Clone, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub struct LeftOut {
    /// The waypoint's number.
    pub label: usize,
    /// Why.
    pub reason: String,
}

/// Why there is no calibration.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum CalibrationError {
    /// Too few views show enough of the board.
    #[error(
        "{usable} of {views} views show enough of the board, but a calibration needs {FEWEST_VIEWS}; shoot more views of the whole \
         board from different directions{}", list(.left_out)
    )]
    TooFewViews {
        /// Views given.
        views: usize,
        /// Those that could be used.
        usable: usize,
        /// The others.
        left_out: Vec<LeftOut>,
    },
    /// The views do not determine the lens.
    #[error(
        "the views do not determine the lens ({reason}); the camera must look at the board from several directions, tilted by 20 \
         degrees and more, not only from straight ahead, and corners should fill the image"
    )]
    Undetermined {
        /// What went wrong.
        reason: String,
    },
    /// A waypoint was given twice.
    #[error("waypoint {0} was given twice; put all its corners in one view")]
    TwiceGiven(usize),
    /// A corner that the board does not have, or a position that is no number.
    #[error("waypoint {label}: corner {id} at {x}, {y} is none of this board; was another board detected?")]
    NoSuchCorner {
        /// The waypoint.
        label: usize,
        /// The corner's number.
        id: u32,
        /// Pixels.
        x: f64,
        /// Pixels.
        y: f64,
    },
    /// The images have no size.
    #[error("images of {0}x{1} pixels cannot be calibrated")]
    NoImage(u32, u32),
    /// The light's arm could not be registered.
    #[error(transparent)]
    Touch(#[from] TouchError),
}

fn list(left_out: &[LeftOut]) -> String {
    left_out.iter().map(|l| format!("; waypoint {}: {}", l.label, l.reason)).collect()
}

/// Calibrates the lens and all viewpoints together, and registers the light's arm.
///
/// Focal lengths begin with Zhang's method, viewpoints with homographies; then everything is refined by least squares on
/// the pixels with Huber's loss. Waypoints whose residuals are far above the others' are named, take no part in the lens, and
/// keep a pose of their own.
///
/// # Errors
/// If the views or touches do not determine what they should; the message says what is missing.
pub fn calibrate(measurements: &Measurements) -> Result<Calibration, CalibrationError> {
    let Measurements { board, board_to_world, image_size: (width, height), views, .. } = *measurements;
    if width == 0 || height == 0 {
        return Err(CalibrationError::NoImage(width, height));
    }
    check_views(views, board)?;
    let mut left_out = Vec::new();
    let mut usable = Vec::new();
    for view in views {
        match Usable::of(view, board) {
            Ok(view) => usable.push(view),
            Err(reason) => left_out.push(LeftOut { label: view.label, reason }),
        }
    }
    let undetermined = |reason: &str| CalibrationError::Undetermined { reason: reason.to_owned() };
    let no_answer = || undetermined("the least-squares fit has no one answer");
    let too_few = |usable: usize, left_out: Vec<LeftOut>| CalibrationError::TooFewViews {
        views: views.len(),
        usable,
        left_out,
    };
    if usable.len() < FEWEST_VIEWS {
        return Err(too_few(usable.len(), left_out));
    }
    let mut lens = zhang::first_guess(&robust::good_homographies(&usable), width, height)
        .ok_or_else(|| undetermined("their perspective gives no focal length"))?;
    let mut fitted = Vec::new();
    for view in usable {
        let label = view.label;
        let contradiction = || "its corners contradict a board seen from its printed side".to_owned();
        match view.placed(&lens) {
            Some(view) => fitted.push(view),
            None => left_out.push(LeftOut { label, reason: contradiction() }),
        }
    }
    let enough = |fitted: &[Fitted]| {
        let bad = fitted.iter().filter(|f| f.is_bad);
        let reason = || "its residuals are far above the others'".to_owned();
        let bad: Vec<_> = bad.map(|f| LeftOut { label: f.label, reason: reason() }).collect();
        let good = fitted.len() - bad.len();
        if good < FEWEST_VIEWS { Err(too_few(good, [left_out.clone(), bad].concat())) } else { Ok(()) }
    };
    let threshold = robust::fit(&mut lens, &mut fitted, enough, |_| no_answer())?;
    let good: Vec<View> = fitted.iter().filter(|f| !f.is_bad).map(|f| f.view.clone()).collect();
    let covariance = adjustment::covariance(&lens, &good, threshold).ok_or_else(no_answer)?;
    let errors: [f64; LENS] = covariance.lens.map(|v| v.max(0.0).sqrt()).into();
    let share = (errors[0] / lens.0[0]).max(errors[1] / lens.0[1]);
    if share >= LARGEST_FOCAL_ERROR || share.is_nan() {
        return Err(undetermined(&format!("the focal length is known to {:.1} % only", 100.0 * share)));
    }
    let waypoints = waypoints(&lens, &mut fitted, &covariance, threshold, &board_to_world, &mut left_out);
    let squares: Vec<f64> =
        good.iter().flat_map(|view| lengths(&lens, view)).map(|length| length * length).collect();
    let light = if measurements.touches.is_empty() {
        None
    } else {
        let alignment = measurements.declared_alignment.as_ref();
        Some(register_light(measurements.touches, &board_to_world, alignment)?)
    };
    Ok(Calibration {
        board: *board,
        board_to_world,
        intrinsics: lens.intrinsics(width, height),
        intrinsics_errors: errors,
        rms_pixels: mean(&squares).sqrt(),
        waypoints,
        left_out,
        light,
    })
}

pub(super) fn check_views(views: &[WaypointView], board: &Board) -> Result<(), CalibrationError> {
    for (i, view) in views.iter().enumerate() {
        let label = view.label;
        if views[..i].iter().any(|before| before.label == label) {
            return Err(CalibrationError::TwiceGiven(label));
        }
        for &Corner { id, x, y } in &view.corners {
            if board.corner(id).is_none() || !x.is_finite() || !y.is_finite() {
                return Err(CalibrationError::NoSuchCorner { label, id, x, y });
            }
        }
    }
    Ok(())
}

fn waypoints(
    lens: &Lens,
    fitted: &mut [Fitted],
    covariance: &Covariance,
    threshold: f64,
    board_to_world: &Pose,
    left_out: &mut Vec<LeftOut>,
) -> Vec<Waypoint> {
    let mut good = covariance.viewpoints.iter();
    let mut waypoints = Vec::with_capacity(fitted.len());
    for Fitted { label, view, is_bad, .. } in fitted {
        let block =
            if *is_bad { adjustment::adjust_viewpoint(lens, view, threshold) } else { good.next().copied() };
        let Some(block) = block else {
            let reason = "its corners fit no viewpoint".to_owned();
            left_out.push(LeftOut { label: *label, reason });
            continue;
        };
        let residuals = view.sightings.iter().filter_map(|s| view.viewpoint.residual(lens, s));
        let squares: Vec<(f64, f64)> = residuals
            .map(|r| {
                (r.pixels.norm_squared(), r.pixels.norm_squared() * (r.depth / lens.focal_length()).powi(2))
            })
            .collect();
        let [pixels, metres] = [0, 1].map(|k| {
            mean(&squares.iter().map(|s| if k == 0 { s.0 } else { s.1 }).collect::<Vec<_>>()).sqrt()
        });
        let error = |from: usize| (from..from + 3).map(|i| block[(i, i)]).sum::<f64>().sqrt();
        waypoints.push(Waypoint {
            label: *label,
            pose: compose(board_to_world, &view.viewpoint.pose()),
            corners: view.sightings.len(),
            rms_pixels: pixels,
            worst_pixels: squares.iter().map(|s| s.0).fold(0.0, f64::max).sqrt(),
            rms_metres: metres,
            position_error: error(3),
            rotation_error: error(0),
            is_bad: *is_bad,
        });
    }
    waypoints
}
