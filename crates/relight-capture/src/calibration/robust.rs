//! Fits that bad views cannot spoil.

use nalgebra::{Matrix3, Vector2};

use super::adjustment::{self, Knowledge, Undetermined, View};
use super::board::Board;
use super::calibrate::WaypointView;
use super::detection::Corner;
use super::homography;
use super::lens::Lens;
use super::viewpoint::{Sighting, Viewpoint};

/// Fewest different corners that make a view.
pub(super) const FEWEST_CORNERS: usize = 6;
/// Corners farther off than this many standard deviations pull no harder.
const HUBER: f64 = 4.0;
/// The least threshold of the robust loss, pixels.
const LEAST_THRESHOLD: f64 = 0.02;
/// The median length of a vector of two normal deviates.
const RAYLEIGH_MEDIAN: f64 = 1.177_41;
/// Rounds of the robust fit.
const ROUNDS: usize = 4;
/// A waypoint is bad if its residual is this many times the median waypoint's, and no less than the floor, pixels.
const BAD: f64 = 3.0;
const BAD_FLOOR: f64 = 0.1;
/// The same for the residuals of homographies, which the lens bends.
const HOMOGRAPHY_FLOOR: f64 = 5.0;
/// Rounds in which waypoints may turn out bad or good.
const BAD_ROUNDS: usize = 6;

/// What a view is for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Role {
    /// Its viewpoint is wanted.
    Waypoint,
    /// It helps to determine the lens.
    Lens,
}

/// A view that determines a homography.
pub(super) struct Usable {
    pub(super) label: usize,
    pub(super) role: Role,
    homography: Matrix3<f64>,
    /// Root mean square of what the homography misses, pixels.
    rms: f64,
    sightings: Vec<Sighting>,
}

impl Usable {
    pub(super) fn of(view: &WaypointView, role: Role, board: &Board) -> Result<Usable, String> {
        let sightings = sightings(view, board);
        let mut ids: Vec<u32> = view.corners.iter().map(|corner| corner.id).collect();
        ids.sort_unstable();
        ids.dedup();
        if ids.len() < FEWEST_CORNERS {
            return Err(format!("{} corners are seen, {FEWEST_CORNERS} are needed", ids.len()));
        }
        let pairs: Vec<_> = sightings.iter().map(|s| (s.on_board, s.pixel)).collect();
        let homography = homography::fit(&pairs).ok_or("its corners lie on a line")?;
        let rms = homography_rms(&homography, &sightings);
        Ok(Usable { label: view.label, role, homography, rms, sightings })
    }

    /// Corners that it shows.
    pub(super) fn corners(&self) -> usize {
        self.sightings.len()
    }

    /// The viewpoint that a first lens makes of it; `None` if the corners contradict a board seen from its printed side.
    pub(super) fn placed(self, lens: &Lens) -> Option<Fitted> {
        let viewpoint = Viewpoint::of_homography(&self.homography, lens)?;
        let view = View { viewpoint, sightings: self.sightings };
        Some(Fitted { label: self.label, role: self.role, view, rms: self.rms, is_bad: false })
    }
}

/// The homographies of the views that have nearly one.
pub(super) fn good_homographies(usable: &[Usable]) -> Vec<Matrix3<f64>> {
    let limit = (BAD * median(usable.iter().map(|u| u.rms).collect())).max(HOMOGRAPHY_FLOOR);
    usable.iter().filter(|u| u.rms <= limit).map(|u| u.homography).collect()
}

pub(super) fn sightings(view: &WaypointView, board: &Board) -> Vec<Sighting> {
    let sighting = |corner: &Corner| {
        let on_board = Vector2::from(board.corner(corner.id)?);
        Some(Sighting { on_board, pixel: Vector2::new(corner.x, corner.y) })
    };
    view.corners.iter().filter_map(sighting).collect()
}

/// Root mean square of the distances, pixels, between corners and where a homography takes them.
fn homography_rms(homography: &Matrix3<f64>, sightings: &[Sighting]) -> f64 {
    let square = |s: &Sighting| {
        homography::apply(homography, s.on_board)
            .map_or(f64::INFINITY, |(to, _)| (to - s.pixel).norm_squared())
    };
    mean(&sightings.iter().map(square).collect::<Vec<_>>()).sqrt()
}

/// A view with its viewpoint.
#[derive(Clone)]
pub(super) struct Fitted {
    pub(super) label: usize,
    pub(super) role: Role,
    pub(super) view: View,
    /// Root mean square of the residuals, pixels.
    pub(super) rms: f64,
    pub(super) is_bad: bool,
}

impl Fitted {
    /// Gives a bad view the place that suits the lens best, and finds the residuals.
    fn place(&mut self, lens: &Lens, threshold: f64) {
        if self.is_bad {
            adjustment::adjust_viewpoint(lens, &mut self.view, threshold);
        }
        self.rms = mean(&lengths(lens, &self.view).iter().map(|l| l * l).collect::<Vec<_>>()).sqrt();
    }
}

/// Lengths of a view's residuals, pixels; infinite behind the camera.
pub(super) fn lengths(lens: &Lens, view: &View) -> Vec<f64> {
    let length = |s: &Sighting| view.viewpoint.residual(lens, s).map_or(f64::INFINITY, |r| r.pixels.norm());
    view.sightings.iter().map(length).collect()
}

pub(super) fn mean(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / values.len() as f64
}

/// The middle value; infinite for none.
pub(super) fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    values.get(values.len() / 2).copied().unwrap_or(f64::INFINITY)
}

/// Fits the lens to the good views, again until it is clear which these are; gives the threshold of the robust loss. The views
/// keep their places. `enough` refuses a fit to too few.
pub(super) fn fit<E>(
    lens: &mut Lens,
    fitted: &mut [Fitted],
    knowledge: &Knowledge,
    enough: impl Fn(&[Fitted]) -> Result<(), E>,
    undetermined: impl Fn(Undetermined) -> E,
) -> Result<f64, E> {
    mark_bad(fitted, HOMOGRAPHY_FLOOR);
    let mut threshold = f64::INFINITY;
    for _ in 0..BAD_ROUNDS {
        enough(fitted)?;
        threshold = fit_good(lens, fitted, knowledge).map_err(&undetermined)?;
        fitted.iter_mut().for_each(|f| f.place(lens, threshold));
        if !mark_bad(fitted, BAD_FLOOR) {
            break;
        }
    }
    Ok(threshold)
}

/// Fits the lens to the good views, least squares first, then with a robust threshold that follows the residuals. Gives the
/// threshold.
fn fit_good(lens: &mut Lens, fitted: &mut [Fitted], knowledge: &Knowledge) -> Result<f64, Undetermined> {
    let mut views: Vec<View> = fitted.iter().filter(|f| !f.is_bad).map(|f| f.view.clone()).collect();
    let mut threshold = f64::INFINITY;
    for _ in 0..ROUNDS {
        adjustment::adjust(lens, &mut views, knowledge, threshold)?;
        let middle = median(views.iter().flat_map(|view| lengths(lens, view)).collect());
        threshold = (HUBER * middle / RAYLEIGH_MEDIAN).max(LEAST_THRESHOLD);
    }
    for (fitted, view) in fitted.iter_mut().filter(|f| !f.is_bad).zip(views) {
        fitted.view = view;
    }
    Ok(threshold)
}

/// Marks as bad the views whose residuals are far above the others', no others; says whether that changed anything.
fn mark_bad(fitted: &mut [Fitted], floor: f64) -> bool {
    let limit = (BAD * median(fitted.iter().filter(|f| !f.is_bad).map(|f| f.rms).collect())).max(floor);
    let mut any = false;
    for f in fitted {
        let is_bad = f.rms > limit;
        any |= is_bad != f.is_bad;
        f.is_bad = is_bad;
    }
    any
}
