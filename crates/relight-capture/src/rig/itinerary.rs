//! All motions of a session, planned before the first of them.

use std::collections::HashMap;

use rayon::prelude::*;
use relight_scene::Pose;

use super::roadmap::{HOME, Roadmap};
use crate::kinematics::{Arm, Cell, Joints, Obstruction, RouteError};
use crate::trajectory::{Plan, Trajectory};

/// The arm with the camera and the one with the light, in their order.
pub const CAMERA: usize = 0;
/// See [`CAMERA`].
pub const LIGHT: usize = 1;

/// Joints are planned in whole steps of this, radians (half a micrometre at full stretch): no protocol rounds them.
const STEP: f64 = 1e-6;

/// Where two arms go to shoot every view under every light, every motion checked with both arms in their places.
///
/// The camera moves while the light is at home, and the light while the camera stands: at home, or at a view. Station 0 is home;
/// station 1 + LABEL is that of a waypoint.
#[derive(Clone, Debug)]
pub struct Itinerary {
    cell: Cell<2>,
    /// Joints of the camera's and the light's stations, by number; those of home where nothing is reached.
    stations: [Vec<Joints>; 2],
    /// Labels of what is visited, in order of visit.
    orders: [Vec<usize>; 2],
    camera: Roadmap,
    /// By the camera's station.
    light: Vec<Roadmap>,
}

impl Itinerary {
    /// Plans the motions of a plan's arms. Waypoints that cannot be visited are marked in the plan with the reason, and left
    /// out of its orders: those that an arm does not reach, and then the fewest such that every view can be shot under every
    /// light.
    ///
    /// # Errors
    /// If the arms cannot stand at home.
    pub fn plan(cell: Cell<2>, homes: &[Joints; 2], plan: &mut Plan) -> Result<Itinerary, RouteError> {
        let homes = homes.map(|home| home.map(stepped));
        let reached = cell.reach_plan(plan, &homes)?;
        let stations = [(&plan.camera, CAMERA), (&plan.light, LIGHT)]
            .map(|(trajectory, arm)| stations(trajectory, &homes[arm], &reached[arm]));
        loop {
            let orders = [&plan.camera, &plan.light].map(|trajectory| trajectory.order.clone());
            let (camera, light) = roadmaps(&cell, &stations, &orders);
            let itinerary =
                Itinerary { cell: cell.clone(), stations: stations.clone(), orders, camera, light };
            let conflicts = itinerary.conflicts();
            if conflicts.is_empty() {
                return Ok(itinerary);
            }
            itinerary.leave_out(conflicts, plan);
        }
    }

    /// Labels of views or lights in the order of visit.
    pub fn order(&self, arm: usize) -> &[usize] {
        &self.orders[arm]
    }

    /// The cell in which the arms work.
    pub fn cell(&self) -> &Cell<2> {
        &self.cell
    }

    /// The arm with the camera or the light.
    pub fn arm(&self, arm: usize) -> &Arm {
        &self.cell.arms()[arm]
    }

    /// Joints of a station; those of home where there is none.
    pub fn joints(&self, arm: usize, station: usize) -> &Joints {
        self.stations[arm].get(station).unwrap_or(&self.stations[arm][HOME])
    }

    /// Joints of all stations.
    pub fn stations(&self, arm: usize) -> &[Joints] {
        &self.stations[arm]
    }

    /// Where the tool is at a waypoint, by the arm's own kinematics.
    pub fn pose(&self, arm: usize, label: usize) -> Pose {
        self.arm(arm).tool_pose(self.joints(arm, station(label)))
    }

    /// The motions that are free for an arm while the other stands at a station; none where it must not move then.
    pub fn roadmap(&self, arm: usize, other: usize) -> Option<&Roadmap> {
        if arm == CAMERA { (other == HOME).then_some(&self.camera) } else { self.light.get(other) }
    }

    /// Labels of views and lights that cannot be shot together.
    fn conflicts(&self) -> Vec<(usize, usize)> {
        let [views, lights] = &self.orders;
        let mut conflicts = Vec::new();
        let is_view_reached = self.camera.is_reached();
        for &view in views {
            let is_light_reached = self.light[station(view)].is_reached();
            let is_met =
                |light: &usize| !(is_view_reached[station(view)] && is_light_reached[station(*light)]);
            conflicts.extend(lights.iter().copied().filter(is_met).map(|light| (view, light)));
        }
        conflicts
    }

    /// Leaves out of a plan the waypoint with most conflicts, and so on until none is left.
    fn leave_out(&self, mut conflicts: Vec<(usize, usize)>, plan: &mut Plan) {
        while let Some((arm, label, (view, light))) = worst(&conflicts) {
            let count = conflicts.len();
            conflicts.retain(|&(view, light)| label != if arm == CAMERA { view } else { light });
            let met = count - conflicts.len();
            let (trajectory, others) =
                if arm == CAMERA { (&mut plan.camera, "lights") } else { (&mut plan.light, "views") };
            let reason = match self.obstruction(view, light) {
                Some(obstruction) => obstruction.to_string(),
                None => "no free motion leads there".to_owned(),
            };
            let pair = if arm == CAMERA { format!("light {light}") } else { format!("view {view}") };
            trajectory.order.retain(|&visited| visited != label);
            if let Some(waypoint) = trajectory.waypoints.get_mut(label) {
                waypoint.unreachable =
                    Some(format!("it cannot be shot together with {met} {others}: with {pair}, {reason}"));
            }
        }
    }

    /// What is in the way of the light from its home to a light's place, with the camera at a view; or of the camera.
    fn obstruction(&self, view: usize, light: usize) -> Option<Obstruction> {
        let home = [CAMERA, LIGHT].map(|arm| *self.joints(arm, HOME));
        let camera = [*self.joints(CAMERA, station(view)), home[LIGHT]];
        let both = [camera[CAMERA], *self.joints(LIGHT, station(light))];
        let checked =
            self.cell.check_motion(&home, &camera).and_then(|()| self.cell.check_motion(&camera, &both));
        checked.err()
    }
}

/// The station of a waypoint.
pub fn station(label: usize) -> usize {
    1 + label
}

/// An angle in whole steps.
fn stepped(angle: f64) -> f64 {
    (angle / STEP).round() * STEP
}

fn stations(trajectory: &Trajectory, home: &Joints, reached: &HashMap<usize, Joints>) -> Vec<Joints> {
    let waypoints = 0..trajectory.waypoints.len();
    let joints = waypoints.map(|label| reached.get(&label).map_or(*home, |joints| joints.map(stepped)));
    std::iter::once(*home).chain(joints).collect()
}

/// The roadmaps of the camera while the light is at home, and of the light for each station of the camera.
fn roadmaps(
    cell: &Cell<2>,
    stations: &[Vec<Joints>; 2],
    orders: &[Vec<usize>; 2],
) -> (Roadmap, Vec<Roadmap>) {
    let [views, lights] =
        orders.each_ref().map(|order| order.iter().map(|&l| station(l)).collect::<Vec<_>>());
    let light_home = stations[LIGHT][HOME];
    let camera = Roadmap::new(&stations[CAMERA], &views, |from, to| {
        cell.check_motion(&[*from, light_home], &[*to, light_home]).is_ok()
    });
    let is_visited = camera.is_reached();
    let light = stations[CAMERA].par_iter().enumerate().map(|(view, camera)| {
        let order = if is_visited[view] { lights.as_slice() } else { &[] };
        Roadmap::new(&stations[LIGHT], order, |from, to| {
            cell.check_motion(&[*camera, *from], &[*camera, *to]).is_ok()
        })
    });
    (camera, light.collect())
}

/// The arm and waypoint with most conflicts, a light of several, and one of the conflicts.
fn worst(conflicts: &[(usize, usize)]) -> Option<(usize, usize, (usize, usize))> {
    let mut counts: HashMap<(usize, usize), (usize, (usize, usize))> = HashMap::new();
    for &(view, light) in conflicts {
        for key in [(CAMERA, view), (LIGHT, light)] {
            counts.entry(key).or_insert((0, (view, light))).0 += 1;
        }
    }
    let most =
        counts.into_iter().max_by_key(|&((arm, label), (count, _))| (count, arm, usize::MAX - label))?;
    let ((arm, label), (_, pair)) = most;
    Some((arm, label, pair))
}
