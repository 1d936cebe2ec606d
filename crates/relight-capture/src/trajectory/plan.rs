//! The plan of a capture, and its file.

use std::collections::HashSet;
use std::io::Write;
use std::path::{Path, PathBuf};

use glam::DVec3;
use relight_scene::{Pose, SceneError, read_text, write_whole};
use serde::{Deserialize, Serialize};

use super::dome::{Dome, DomeFault, MAX_WAYPOINTS, is_near};
use super::partition::Cell;
use super::region::Region;
use super::settings::{ArmSettings, PlanSettings};
use super::visit::visit_order;

/// Format and version of a plan's file, under `format`.
pub const PLAN_FORMAT: &str = "relight-plan-1";

/// A plan's longest length, bytes: the most waypoints for two arms have a tenth, unless reasons are long.
const LONGEST: u64 = 1 << 25;

/// Where the camera and the light go, and what stands between them.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Plan {
    /// The box that holds the object.
    pub object: ObjectBox,
    /// The camera's trajectory; poses are camera-to-world, axes as OpenCV's.
    pub camera: Trajectory,
    /// The light's trajectory; poses are light-to-world, +Z towards the object.
    pub light: Trajectory,
}

/// An axis-aligned box, world, metres.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ObjectBox {
    /// Lowest corner.
    pub lo: [f64; 3],
    /// Highest corner.
    pub hi: [f64; 3],
}

impl ObjectBox {
    /// The middle, which cameras and lights look at.
    pub fn centre(&self) -> [f64; 3] {
        ((DVec3::from(self.lo) + DVec3::from(self.hi)) / 2.0).into()
    }

    /// Whether it is a box: every edge longer than nothing, no corner farther out than any rig.
    pub fn is_box(&self) -> bool {
        let (lo, hi) = (DVec3::from(self.lo), DVec3::from(self.hi));
        lo.cmplt(hi).all() && is_near(lo) && is_near(hi)
    }
}

/// The waypoints of one arm and the order of visiting them.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Trajectory {
    /// Middle of the sphere that the cells lie on, world, metres.
    pub centre: [f64; 3],
    /// Least and greatest distance of waypoints from it, metres.
    pub radius: [f64; 2],
    /// All waypoints, by label, reachable or not.
    pub waypoints: Vec<Waypoint>,
    /// Labels of the reachable waypoints in the order of visit.
    pub order: Vec<usize>,
}

/// A place to go to.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Waypoint {
    /// Its place among the waypoints, and the view's or light's number in the scene's folder.
    pub label: usize,
    /// To-world; in the file 16 numbers, row-major.
    #[serde(with = "matrix")]
    pub pose: Pose,
    /// The cell that it stands over.
    pub cell: Cell,
    /// Why the arm cannot go there.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub unreachable: Option<String>,
}

/// Why there is no plan.
#[derive(Debug, thiserror::Error)]
pub enum PlanError {
    /// The file cannot be read.
    #[error(transparent)]
    Read(#[from] SceneError),
    /// The file cannot be written.
    #[error("{}: cannot be written: {error}", path.display())]
    Write {
        /// The file.
        path: PathBuf,
        /// Why.
        error: std::io::Error,
    },
    /// The file is no plan, or one that contradicts itself.
    #[error("{}: {problem}", path.display())]
    Malformed {
        /// The file.
        path: PathBuf,
        /// What is wrong and how to mend it.
        problem: String,
    },
    /// Camera or light cannot stand as the settings say.
    #[error("[{0}] {1}")]
    Dome(&'static str, DomeFault),
    /// The object's box is none.
    #[error("[object] lo {:?} and hi {:?} make no box: give finite metres, within 100 m, lo below hi along each axis", .0.lo, .0.hi)]
    Object(ObjectBox),
}

impl Plan {
    /// The plan that `settings` ask for, every waypoint taken as reachable and ordered by straight-line travel. Whoever
    /// knows the arms marks those that are [`unreachable`](Waypoint::unreachable) and
    /// [orders the rest](Trajectory::order_by) by travel in joints.
    ///
    /// # Errors
    /// If the object's box is none or a dome cannot be.
    pub fn new(settings: &PlanSettings) -> Result<Plan, PlanError> {
        let object = settings.object;
        if !object.is_box() {
            return Err(PlanError::Object(object));
        }
        let trajectory = |name, arm: &ArmSettings| {
            let dome = arm.dome(object.centre()).map_err(|fault| PlanError::Dome(name, fault))?;
            Trajectory::new(&dome).map_err(|fault| PlanError::Dome(name, fault))
        };
        Ok(Plan {
            object,
            camera: trajectory("camera", &settings.camera)?,
            light: trajectory("light", &settings.light)?,
        })
    }

    /// Reads a plan and checks it whole: rigid poses, cells and domes that can be, labels and orders that fit.
    ///
    /// # Errors
    /// If the file cannot be read, has another [format](PLAN_FORMAT), or holds what no plan does.
    pub fn read(path: &Path) -> Result<Plan, PlanError> {
        let malformed = |problem| PlanError::Malformed { path: path.to_owned(), problem };
        parse(&read_text(path, LONGEST)?).map_err(malformed)
    }

    /// Writes the plan, whole or not at all.
    ///
    /// # Errors
    /// If the file cannot be written.
    pub fn write(&self, path: &Path) -> Result<(), PlanError> {
        let text = || -> serde_json::Result<Vec<u8>> {
            let mut object = serde_json::to_value(self)?;
            object["format"] = PLAN_FORMAT.into();
            serde_json::to_vec(&object)
        };
        write_whole(path, |file| file.write_all(&text()?))
            .map_err(|error| PlanError::Write { path: path.to_owned(), error })
    }

    fn check(&self) -> Result<(), String> {
        if !self.object.is_box() {
            return Err("\"object\" is no box: lo must lie below hi along each axis".into());
        }
        self.camera.check().map_err(|problem| format!("\"camera\": {problem}"))?;
        self.light.check().map_err(|problem| format!("\"light\": {problem}"))
    }
}

/// A plan from its file's text, or what is wrong with that.
fn parse(text: &str) -> Result<Plan, String> {
    let mend = "make the plan again with `relight capture plan`";
    let not_json = |error: serde_json::Error| format!("is not a plan: {error}; {mend}");
    let mut object: serde_json::Map<String, serde_json::Value> =
        serde_json::from_str(text).map_err(not_json)?;
    match object.remove("format") {
        Some(serde_json::Value::String(format)) if format == PLAN_FORMAT => {}
        Some(format) => {
            return Err(format!("format {format} is unknown to this version, which reads \"{PLAN_FORMAT}\""));
        }
        None => return Err(format!("has no \"format\": not a plan; {mend}")),
    }
    let plan: Plan = serde_json::from_value(object.into()).map_err(not_json)?;
    plan.check().map_err(|problem| format!("{problem}; {mend}"))?;
    Ok(plan)
}

impl Trajectory {
    /// Waypoints over a dome's cells, all taken as reachable, ordered by straight-line travel.
    ///
    /// # Errors
    /// As [`Dome::waypoints`].
    pub fn new(dome: &Dome) -> Result<Trajectory, DomeFault> {
        let waypoints = dome.waypoints()?;
        let (centre, radius) = (dome.centre, dome.radius);
        let mut trajectory = Trajectory { centre, radius, waypoints, order: Vec::new() };
        trajectory
            .order_by(|from, to| DVec3::from(from.pose.position()).distance(DVec3::from(to.pose.position())));
        Ok(trajectory)
    }

    /// Orders the reachable waypoints anew so that the sum of `travel` from each to the next is small: never more than ring
    /// by ring. `travel` must be finite and the same both ways; it is asked some n^2 times, often for the same pair.
    pub fn order_by(&mut self, travel: impl Fn(&Waypoint, &Waypoint) -> f64) {
        let all: Vec<(usize, &Waypoint)> = self.waypoints.iter().enumerate().collect();
        let rings: Vec<Vec<usize>> = all
            .chunk_by(|(_, one), (_, next)| one.cell.colatitude == next.cell.colatitude)
            .map(|ring| {
                ring.iter().filter(|(_, w)| w.unreachable.is_none()).map(|&(place, _)| place).collect()
            })
            .collect();
        self.order = visit_order(&rings, &|from, to| travel(&self.waypoints[from], &self.waypoints[to]));
    }

    /// The reachable waypoints in the order of visit.
    pub fn visited(&self) -> impl Iterator<Item = &Waypoint> {
        self.order.iter().filter_map(|&label| self.waypoints.get(label))
    }

    /// Straight-line travel along the order of visit, metres.
    pub fn length(&self) -> f64 {
        let stops: Vec<&Waypoint> = self.visited().collect();
        stops.windows(2).map(|pair| distance(pair[0], pair[1])).sum()
    }

    fn check(&self) -> Result<(), String> {
        let count = self.waypoints.len();
        if !(1..=MAX_WAYPOINTS).contains(&count) {
            return Err(format!("{count} waypoints; a plan has 1 to {MAX_WAYPOINTS}"));
        }
        let [near, far] = self.radius;
        if !(near > 0.0 && near <= far && is_near(DVec3::splat(far)) && is_near(self.centre.into())) {
            return Err(format!("no sphere has the centre {:?} and the radius {near} to {far}", self.centre));
        }
        for (index, waypoint) in self.waypoints.iter().enumerate() {
            if waypoint.label != index {
                return Err(format!("waypoint {index} is labelled {}", waypoint.label));
            }
            Region::new(waypoint.cell.colatitude, waypoint.cell.azimuth)
                .map_err(|fault| format!("the cell of waypoint {index}: {fault}"))?;
        }
        let visited: HashSet<usize> = self.order.iter().copied().collect();
        let reachable = |label: &usize| self.waypoints.get(*label).is_some_and(|w| w.unreachable.is_none());
        if let Some(label) = self.order.iter().find(|label| !reachable(label)) {
            return Err(format!("the order visits {label}, which is no reachable waypoint"));
        }
        let expected = self.waypoints.iter().filter(|w| w.unreachable.is_none()).count();
        if visited.len() != expected || self.order.len() != expected {
            return Err(format!(
                "the order has {} stops at {} places, but {expected} waypoints are reachable: each is visited once",
                self.order.len(),
                visited.len()
            ));
        }
        Ok(())
    }
}

/// Distance between two waypoints, metres.
fn distance(from: &Waypoint, to: &Waypoint) -> f64 {
    DVec3::from(from.pose.position()).distance(to.pose.position().into())
}

/// A pose as 16 numbers.
mod matrix {
    use relight_scene::Pose;
    use serde::{Deserialize, Deserializer, Serialize, Serializer, de::Error};

    pub(super) fn serialize<S: Serializer>(pose: &Pose, serializer: S) -> Result<S::Ok, S::Error> {
        pose.to_matrix().serialize(serializer)
    }

    pub(super) fn deserialize<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Pose, D::Error> {
        Pose::from_matrix(&Deserialize::deserialize(deserializer)?).map_err(D::Error::custom)
    }
}
