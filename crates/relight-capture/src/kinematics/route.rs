//! Choosing one configuration for each waypoint, so that joints travel little and nothing meets.

use std::cell::OnceCell;
use std::f64::consts::TAU;
use std::ops::Range;

use glam::{DAffine3, DQuat};
use relight_scene::Pose;

use super::rigid::{from_pose, to_pose};
use super::{Arm, Cell, Joints, Obstruction, Unreachable};

/// One arm's way along a list of waypoints.
#[derive(Clone, Debug, PartialEq)]
pub struct Route {
    /// What became of each waypoint, in their order.
    pub stops: Vec<Outcome>,
    /// How far all joints turn on the whole way, radians.
    pub travel: f64,
}

/// What became of a waypoint.
#[derive(Clone, Debug, PartialEq)]
pub enum Outcome {
    /// It is a stop of the route.
    Reached {
        /// Where the joints stand.
        joints: Joints,
        /// Where the arm goes first, if the direct motion from the stop before is not free.
        via: Option<Joints>,
    },
    /// It is left out.
    Unreached(Unreached),
}

impl Outcome {
    /// Where the joints stand, if it is reached.
    pub fn joints(&self) -> Option<Joints> {
        match self {
            Outcome::Reached { joints, .. } => Some(*joints),
            Outcome::Unreached(_) => None,
        }
    }
}

/// Why a waypoint is left out. Where several poses or solutions fail for several reasons: that of the one that came
/// farthest.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum Unreached {
    /// No pose was given.
    #[error("the waypoint holds no pose")]
    NoPose,
    /// No joints bring the tool there.
    #[error(transparent)]
    NoSolution(Unreachable),
    /// Joints would, but something is in the way there.
    #[error("the arm cannot stand there: {0}")]
    Blocked(Obstruction),
    /// The arm could stand there, but neither the direct motion nor the one by way of home is free.
    #[error("no free motion leads there: {0}")]
    NoMotion(Obstruction),
}

/// Why no route can be planned at all.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum RouteError {
    /// There is no such arm.
    #[error("no arm {arm} (counted from 0) in a cell of {arms}")]
    NoSuchArm {
        /// The one that was asked for.
        arm: usize,
        /// How many there are.
        arms: usize,
    },
    /// Something is in the way already.
    #[error("the arms cannot start there: {0}")]
    Start(Obstruction),
}

impl Route {
    /// Plans the way of arm number `arm`, while the others stay where `start` has them.
    ///
    /// Each waypoint is a list of tool poses in the world that serve equally (see [`Route::rolled`]). A waypoint that cannot
    /// be reached is left out and the route goes on to the next. `home` is a configuration out of the way of everything,
    /// for detours: the model's `upright`, unless something is above it.
    ///
    /// Dynamic programming over the solutions of each waypoint; of a solution's whole turns only the one nearest to the
    /// stop before is looked at, so that a route around the base may unwind once where a plan that looked ahead would not.
    ///
    /// # Errors
    /// If there is no such arm or the arms cannot stand where they start.
    pub fn plan<const ARMS: usize>(
        cell: &Cell<ARMS>,
        arm: usize,
        start: &[Joints; ARMS],
        home: &Joints,
        waypoints: &[Vec<Pose>],
    ) -> Result<Route, RouteError> {
        let Some(moving) = cell.arms().get(arm) else {
            return Err(RouteError::NoSuchArm { arm, arms: ARMS });
        };
        cell.check(start).map_err(RouteError::Start)?;
        let planner = Planner { cell, moving, arm, others: *start, home };
        let mut states =
            vec![State { joints: start[arm], travel: 0.0, via: None, before: 0, waypoint: None }];
        let mut layer = 0..1;
        let mut stops = Vec::with_capacity(waypoints.len());
        for (i, poses) in waypoints.iter().enumerate() {
            match planner.reach(poses, &states, &layer) {
                Ok(reached) => {
                    let first = states.len();
                    states.extend(reached.into_iter().map(|state| State { waypoint: Some(i), ..state }));
                    layer = first..states.len();
                    // Filled in below, once it is known which of its states is on the way.
                    stops.push(Outcome::Unreached(Unreached::NoPose));
                }
                Err(fault) => stops.push(Outcome::Unreached(fault)),
            }
        }
        let last = layer.min_by(|&a, &b| states[a].travel.total_cmp(&states[b].travel)).unwrap_or(0);
        let travel = states[last].travel;
        let mut state = &states[last];
        while let Some(waypoint) = state.waypoint {
            stops[waypoint] = Outcome::Reached { joints: state.joints, via: state.via };
            state = &states[state.before];
        }
        Ok(Route { stops, travel })
    }

    /// A pose turned about its own +Z in equal steps: the places where a lamp shines alike.
    pub fn rolled(pose: &Pose, steps: usize) -> Vec<Pose> {
        let turn = |i: usize| DAffine3::from_quat(DQuat::from_rotation_z(TAU * i as f64 / steps as f64));
        (0..steps).map(|i| to_pose(&(from_pose(pose) * turn(i)))).collect()
    }
}

/// A way to stand at a waypoint, and the shortest way there.
struct State {
    joints: Joints,
    /// From the start, radians.
    travel: f64,
    via: Option<Joints>,
    before: usize,
    /// None at the start.
    waypoint: Option<usize>,
}

struct Planner<'a, const ARMS: usize> {
    cell: &'a Cell<ARMS>,
    moving: &'a Arm,
    arm: usize,
    others: [Joints; ARMS],
    home: &'a Joints,
}

impl<const ARMS: usize> Planner<'_, ARMS> {
    /// All ways to stand at a waypoint, each with the shortest way there from the states of the layer before.
    fn reach(&self, poses: &[Pose], states: &[State], layer: &Range<usize>) -> Result<Vec<State>, Unreached> {
        let mut reached = Vec::new();
        let mut fault = Unreached::NoPose;
        let mut fail = |reason: Unreached| {
            if progress(&reason) > progress(&fault) {
                fault = reason;
            }
        };
        let to_home: Vec<OnceCell<bool>> = layer.clone().map(|_| OnceCell::new()).collect();
        for pose in poses {
            let solutions = match self.moving.reach(pose, &states[layer.start].joints) {
                Ok(solutions) => solutions,
                Err(reason) => {
                    fail(Unreached::NoSolution(reason));
                    continue;
                }
            };
            for solution in solutions {
                if let Err(reason) = self.motion(&solution, &solution) {
                    fail(Unreached::Blocked(reason));
                    continue;
                }
                match self.shortest(&solution, states, layer, &to_home) {
                    Ok(state) => reached.push(state),
                    Err(reason) => reason.into_iter().for_each(|reason| fail(Unreached::NoMotion(reason))),
                }
            }
        }
        if reached.is_empty() { Err(fault) } else { Ok(reached) }
    }

    /// The shortest free way to a solution: from which state, directly or by way of home. If none is free, what is in the
    /// way of the shortest.
    fn shortest(
        &self,
        solution: &Joints,
        states: &[State],
        layer: &Range<usize>,
        to_home: &[OnceCell<bool>],
    ) -> Result<State, Option<Obstruction>> {
        let turned = |near: &Joints| {
            let limit = |fault| Obstruction::Limit { arm: self.moving.name.clone(), fault };
            self.moving.model.limits.nearest_turn(solution, near).map_err(|fault| Some(limit(fault)))
        };
        let from_home = turned(self.home)?;
        let mut ways = Vec::with_capacity(2 * layer.len());
        for before in layer.clone() {
            let state = &states[before];
            let joints = turned(&state.joints)?;
            let direct = state.travel + travel(&state.joints, &joints);
            let detour = state.travel + travel(&state.joints, self.home) + travel(self.home, &from_home);
            let waypoint = None;
            ways.push(State { joints, travel: direct, via: None, before, waypoint });
            ways.push(State { joints: from_home, travel: detour, via: Some(*self.home), before, waypoint });
        }
        ways.sort_by(|a, b| a.travel.total_cmp(&b.travel));
        let home_is_free = OnceCell::new();
        let mut obstruction = None;
        for way in ways {
            let before = &states[way.before].joints;
            if way.via.is_some() {
                let leaves = || self.motion(before, self.home).is_ok();
                let arrives = || self.motion(self.home, &from_home).is_ok();
                if *to_home[way.before - layer.start].get_or_init(leaves)
                    && *home_is_free.get_or_init(arrives)
                {
                    return Ok(way);
                }
            } else {
                match self.motion(before, &way.joints) {
                    Ok(()) => return Ok(way),
                    Err(reason) => _ = obstruction.get_or_insert(reason),
                }
            }
        }
        Err(obstruction)
    }

    fn motion(&self, from: &Joints, to: &Joints) -> Result<(), Obstruction> {
        let (mut a, mut b) = (self.others, self.others);
        (a[self.arm], b[self.arm]) = (*from, *to);
        self.cell.check_motion(&a, &b)
    }
}

/// How far all joints turn from one configuration to another, radians.
fn travel(from: &Joints, to: &Joints) -> f64 {
    from.iter().zip(to).map(|(a, b)| (b - a).abs()).sum()
}

/// How far an attempt came that failed for a reason.
fn progress(reason: &Unreached) -> u8 {
    match reason {
        Unreached::NoPose => 0,
        Unreached::NoSolution(Unreachable::Limit(_)) => 2,
        Unreached::NoSolution(_) => 1,
        Unreached::Blocked(_) => 3,
        Unreached::NoMotion(_) => 4,
    }
}
