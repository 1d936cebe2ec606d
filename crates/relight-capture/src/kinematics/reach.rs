//! Which waypoints of a plan the arms of a rig reach.

use std::collections::HashMap;

use relight_scene::Pose;
use serde::{Deserialize, Serialize};

use super::{Arm, ArmModel, Cell, CellError, EC66, Joints, Outcome, Route, RouteError, Tool, UR5E};
use crate::trajectory::{ObjectBox, Plan, Trajectory};

/// Turns of a lamp about its own axis, equally far apart, that are tried: it shines alike in all.
const LAMP_ROLLS: usize = 8;

/// Where two arms stand, as a person writes it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, rename_all = "kebab-case")]
pub struct ArmsSettings {
    /// The arm with the camera.
    pub camera: ArmPlace,
    /// The arm with the light.
    pub light: ArmPlace,
    /// Height of the table, world, metres.
    #[serde(default)]
    pub table_metres: f64,
    /// Walls, or other boxes that nothing may meet.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub walls: Vec<ObjectBox>,
    /// How far everything must stay from everything else, metres.
    #[serde(default = "clearance")]
    pub clearance_metres: f64,
}

/// Which arm stands where.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, rename_all = "kebab-case")]
pub struct ArmPlace {
    /// The make.
    pub model: Make,
    /// Its base in the world.
    pub base_metres: [f64; 3],
    /// Turn of the base about +Z.
    #[serde(default)]
    pub yaw_degrees: f64,
    /// Joints where the arm is out of the way of everything and waits for the other; upright if not given.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub home_degrees: Option<Joints>,
}

/// A make of arms.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Make {
    /// Universal Robots UR5e.
    Ur5e,
    /// Elite EC66.
    Ec66,
}

fn clearance() -> f64 {
    0.01
}

impl Make {
    fn model(self) -> ArmModel {
        match self {
            Make::Ur5e => UR5E,
            Make::Ec66 => EC66,
        }
    }
}

impl ArmPlace {
    fn arm(&self, name: &str, tool: Tool) -> Arm {
        let ((s, c), [x, y, z]) = (self.yaw_degrees.to_radians().sin_cos(), self.base_metres);
        let base = Pose([[c, -s, 0.0, x], [s, c, 0.0, y], [0.0, 0.0, 1.0, z]]);
        Arm { name: name.to_owned(), model: self.model.model(), base, tool }
    }
}

impl ArmsSettings {
    /// The cell in which they work around an object.
    ///
    /// # Errors
    /// If a number is none, or a length negative.
    pub fn cell(&self, object: ObjectBox) -> Result<Cell<2>, CellError> {
        let arms =
            [self.camera.arm("camera arm", Tool::camera()), self.light.arm("light arm", Tool::light())];
        Cell::new(arms, Some(self.table_metres), Some(object), self.clearance_metres)?.with_walls(&self.walls)
    }

    /// Where both arms wait, radians.
    pub fn homes(&self) -> [Joints; 2] {
        [&self.camera, &self.light].map(|place| {
            let given = place.home_degrees.map(|home| home.map(f64::to_radians));
            given.unwrap_or(place.model.model().upright)
        })
    }
}

impl Cell<2> {
    /// Marks the waypoints of a plan that the camera's arm (the first) and the light's (the second) cannot go to, with the
    /// reason, and orders the others by how far joints turn. While one arm moves the other stands at home. Returns the
    /// joints at the waypoints that are reached, by label.
    ///
    /// # Errors
    /// If the arms cannot stand at home.
    pub fn reach_plan(
        &self,
        plan: &mut Plan,
        homes: &[Joints; 2],
    ) -> Result<[HashMap<usize, Joints>; 2], RouteError> {
        let camera = self.reach_all(0, &mut plan.camera, homes, |pose| vec![*pose])?;
        let light = self.reach_all(1, &mut plan.light, homes, |pose| Route::rolled(pose, LAMP_ROLLS))?;
        Ok([camera, light])
    }

    fn reach_all(
        &self,
        arm: usize,
        trajectory: &mut Trajectory,
        homes: &[Joints; 2],
        poses: impl Fn(&Pose) -> Vec<Pose>,
    ) -> Result<HashMap<usize, Joints>, RouteError> {
        let route = |trajectory: &Trajectory| {
            let waypoints: Vec<Vec<Pose>> =
                trajectory.visited().map(|waypoint| poses(&waypoint.pose)).collect();
            Route::plan(self, arm, homes, &homes[arm], &waypoints)
        };
        let first = route(trajectory)?;
        let mut joints: HashMap<usize, Joints> = HashMap::new();
        for (&label, stop) in trajectory.order.iter().zip(&first.stops) {
            match stop {
                Outcome::Reached { joints: there, .. } => _ = joints.insert(label, *there),
                Outcome::Unreached(reason) => {
                    trajectory.waypoints[label].unreachable = Some(reason.to_string());
                }
            }
        }
        let by_distance = trajectory.clone();
        trajectory.order_by(|from, to| match (joints.get(&from.label), joints.get(&to.label)) {
            (Some(a), Some(b)) => a.iter().zip(b).map(|(a, b)| (b - a).abs()).sum(),
            _ => 0.0,
        });
        // In the other order joints may stand otherwise; what counts is how far they turn then.
        let second = route(trajectory)?;
        let is_whole = second.stops.iter().all(|stop| matches!(stop, Outcome::Reached { .. }));
        if !is_whole || second.travel > first.travel {
            trajectory.order = by_distance.order;
            trajectory.order.retain(|label| joints.contains_key(label));
            return Ok(joints);
        }
        let stops = trajectory.order.iter().zip(second.stops);
        Ok(stops.filter_map(|(&label, stop)| Some((label, stop.joints()?))).collect())
    }
}
