//! Lens and viewpoints from the corners of many views.

use nalgebra::SMatrix;
use relight_scene::{Image, Pose};

use super::adjustment::{self, Covariance, Knowledge, View};
use super::board::Board;
use super::detection::{Corner, DetectionError, detect};
use super::frames::compose;
use super::lens::Lens;
use super::light::{Touch, TouchError, register_light};
use super::result::{Calibration, LeftOut, LensPhotograph, Waypoint};
use super::robust::{self, Fitted, Role, Usable, lengths, mean};
use super::zhang;

/// Fewest views that determine a lens well enough to try.
const FEWEST_VIEWS: usize = 4;
/// The place of k3 among the lens's numbers, and how many standard errors it must be away from zero to be taken for real: it
/// tells of the corners of the image, where a board seldom is, and noise in it bends them by pixels.
const K3: usize = 8;
const SUPPORTED: f64 = 3.0;
/// What became of a view whose residuals stand out.
const STANDS_OUT: &str = "its residuals are far above the others'";
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
    /// The board anywhere, seen from anywhere: photographs that help to determine the lens, numbered on their own.
    pub lens_views: &'a [WaypointView],
    /// A calibration of the same camera at the same focus: what was known of the lens then counts as if its photographs were
    /// among these.
    pub earlier: Option<&'a Calibration>,
    /// Where the light's arm touched the board; empty to leave the light out.
    pub touches: &'a [Touch],
    /// Base-of-the-light's-arm-to-world rotation if it is declared, not measured; its translation is not used.
    pub declared_alignment: Option<Pose>,
}

/// Why there is no calibration.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum CalibrationError {
    /// Too few views show enough of the board.
    #[error(
        "{usable} of {views} views show enough of the board, but a calibration needs {fewest}; shoot more views of the whole \
         board from different directions{}", list(.left_out)
    )]
    TooFewViews {
        /// Views given.
        views: usize,
        /// Those that could be used.
        usable: usize,
        /// Those that are needed.
        fewest: usize,
        /// The others.
        left_out: Vec<LeftOut>,
    },
    /// The views do not determine the lens.
    #[error(
        "the views do not determine the lens ({reason}); the camera must look at the board from several directions, tilted by 20 \
         degrees and more, not only from straight ahead, and corners should fill the image: photographs for the lens alone, with the \
         camera rolled and the board tilted this way and that, help most"
    )]
    Undetermined {
        /// What went wrong.
        reason: String,
    },
    /// The earlier calibration is of another camera.
    #[error("the earlier calibration is for images of {0}x{1} pixels, not of this size; leave it out")]
    Earlier(u32, u32),
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
/// keep a pose of their own. k3 stays zero unless the views support it.
///
/// # Errors
/// If the views or touches do not determine what they should; the message says what is missing.
pub fn calibrate(measurements: &Measurements) -> Result<Calibration, CalibrationError> {
    let Measurements {
        board, board_to_world, image_size: (width, height), views, lens_views, earlier, ..
    } = *measurements;
    if width == 0 || height == 0 {
        return Err(CalibrationError::NoImage(width, height));
    }
    check_views(views, board)?;
    check_views(lens_views, board)?;
    let mut sorted = Sorted::of(views, lens_views, board);
    let fewest = if earlier.is_some() { 1 } else { FEWEST_VIEWS };
    let too_few = |usable: usize, left_out: Vec<LeftOut>| CalibrationError::TooFewViews {
        views: views.len() + lens_views.len(),
        usable,
        fewest,
        left_out,
    };
    if sorted.usable.len() < fewest {
        return Err(too_few(sorted.usable.len(), sorted.left_out));
    }
    let (mut lens, mut knowledge) = match earlier {
        Some(earlier) => knowledge_of(earlier, (width, height))?,
        None => {
            let guess = zhang::first_guess(&robust::good_homographies(&sorted.usable), width, height);
            let lens = guess.ok_or_else(|| undetermined("their perspective gives no focal length"))?;
            (lens, Knowledge { held: std::array::from_fn(|i| i == K3), earlier: None })
        }
    };
    let mut fitted = sorted.placed(&lens);
    let enough = |fitted: &[Fitted]| {
        let bad = fitted.iter().filter(|f| f.is_bad && f.role == Role::Waypoint);
        let bad = bad.map(|f| LeftOut { label: f.label, reason: STANDS_OUT.to_owned() });
        let good = fitted.iter().filter(|f| !f.is_bad).count();
        let all = || sorted.left_out.iter().cloned().chain(bad).collect();
        if good < fewest { Err(too_few(good, all())) } else { Ok(()) }
    };
    let fit = |lens: &mut Lens, fitted: &mut [Fitted], knowledge: &Knowledge| {
        let threshold = robust::fit(lens, fitted, knowledge, enough, |_| no_answer())?;
        let good = good_views(fitted);
        let covariance = adjustment::covariance(lens, &good, knowledge, threshold).ok_or_else(no_answer)?;
        Ok::<_, CalibrationError>((threshold, covariance))
    };
    let (mut threshold, mut covariance) = fit(&mut lens, &mut fitted, &knowledge)?;
    if earlier.is_none() {
        let (mut freer, mut refitted) = (lens, fitted.clone());
        if let Ok((its_threshold, its_covariance)) = fit(&mut freer, &mut refitted, &Knowledge::nothing())
            && freer.0[K3].powi(2) > SUPPORTED * SUPPORTED * its_covariance.lens[(K3, K3)]
        {
            (lens, fitted, knowledge) = (freer, refitted, Knowledge::nothing());
            (threshold, covariance) = (its_threshold, its_covariance);
        }
    }
    let errors = covariance.lens.diagonal().map(|v| v.max(0.0).sqrt());
    let share = (errors[0] / lens.0[0]).max(errors[1] / lens.0[1]);
    if share >= LARGEST_FOCAL_ERROR || share.is_nan() {
        return Err(undetermined(&format!("the focal length is known to {:.1} % only", 100.0 * share)));
    }
    let waypoints =
        waypoints(&lens, &mut fitted, &covariance, threshold, &board_to_world, &mut sorted.left_out);
    sorted.lens_photographs.extend(fitted.iter().filter(|f| f.role == Role::Lens).map(|f| LensPhotograph {
        label: f.label,
        corners: f.view.sightings.len(),
        rms_pixels: Some(f.rms).filter(|rms| rms.is_finite()),
        problem: f.is_bad.then(|| STANDS_OUT.to_owned()),
    }));
    sorted.lens_photographs.sort_by_key(|photograph| photograph.label);
    let squares: Vec<f64> = good_views(&fitted)
        .iter()
        .flat_map(|view| lengths(&lens, view))
        .map(|length| length * length)
        .collect();
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
        intrinsics_errors: errors.into(),
        lens_information: std::array::from_fn(|i| std::array::from_fn(|j| covariance.information[(i, j)])),
        corner_variance: covariance.variance,
        lens_shift: knowledge.earlier.map(|(earlier, information)| {
            let shift = lens.0 - earlier.0;
            (shift.dot(&(information * shift)) / covariance.variance).max(0.0).sqrt()
        }),
        lens_photographs: sorted.lens_photographs,
        rms_pixels: mean(&squares).sqrt(),
        waypoints,
        left_out: sorted.left_out,
        light,
    })
}

fn undetermined(reason: &str) -> CalibrationError {
    CalibrationError::Undetermined { reason: reason.to_owned() }
}

fn no_answer() -> CalibrationError {
    undetermined("the least-squares fit has no one answer")
}

fn good_views(fitted: &[Fitted]) -> Vec<View> {
    fitted.iter().filter(|f| !f.is_bad).map(|f| f.view.clone()).collect()
}

/// The lens of an earlier calibration, and what was known of it. Numbers that were held then are held again.
fn knowledge_of(
    earlier: &Calibration,
    (width, height): (u32, u32),
) -> Result<(Lens, Knowledge), CalibrationError> {
    let before = &earlier.intrinsics;
    let is_same_size = (before.width, before.height) == (width, height);
    let lens = Lens::of(before).filter(|_| is_same_size);
    let lens = lens.ok_or(CalibrationError::Earlier(before.width, before.height))?;
    let held = earlier.intrinsics_errors.map(|error| error == 0.0);
    let information =
        SMatrix::from_fn(|i, j| if held[i] || held[j] { 0.0 } else { earlier.lens_information[i][j] });
    Ok((lens, Knowledge { held, earlier: Some((lens, information)) }))
}

/// Views that can be used, and those that cannot.
struct Sorted {
    usable: Vec<Usable>,
    left_out: Vec<LeftOut>,
    lens_photographs: Vec<LensPhotograph>,
}

impl Sorted {
    fn of(views: &[WaypointView], lens_views: &[WaypointView], board: &Board) -> Sorted {
        let mut sorted = Sorted { usable: Vec::new(), left_out: Vec::new(), lens_photographs: Vec::new() };
        let waypoints = views.iter().map(|view| (Role::Waypoint, view));
        for (role, view) in waypoints.chain(lens_views.iter().map(|view| (Role::Lens, view))) {
            match Usable::of(view, role, board) {
                Ok(usable) => sorted.usable.push(usable),
                Err(reason) => sorted.leave_out(role, view.label, view.corners.len(), reason),
            }
        }
        sorted
    }

    fn leave_out(&mut self, role: Role, label: usize, corners: usize, reason: String) {
        match role {
            Role::Waypoint => self.left_out.push(LeftOut { label, reason }),
            Role::Lens => {
                let problem = Some(reason);
                self.lens_photographs.push(LensPhotograph { label, corners, rms_pixels: None, problem });
            }
        }
    }

    /// The views at the viewpoints that a first lens gives them.
    fn placed(&mut self, lens: &Lens) -> Vec<Fitted> {
        let mut fitted = Vec::new();
        for view in std::mem::take(&mut self.usable) {
            let (role, label, corners) = (view.role, view.label, view.corners());
            match view.placed(lens) {
                Some(view) => fitted.push(view),
                None => {
                    let reason = "its corners contradict a board seen from its printed side".to_owned();
                    self.leave_out(role, label, corners, reason);
                }
            }
        }
        fitted
    }
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
    for Fitted { label, role, view, is_bad, .. } in fitted {
        let block =
            if *is_bad { adjustment::adjust_viewpoint(lens, view, threshold) } else { good.next().copied() };
        if *role == Role::Lens {
            continue;
        }
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
