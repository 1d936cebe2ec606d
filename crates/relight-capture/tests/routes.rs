//! Routes along waypoints of the paper's rig.

// Helpers of tests may panic as tests do.
#![allow(clippy::unwrap_used)]

mod common;

use std::f64::consts::PI;

use common::{CLEARANCE, UPRIGHT, cell, light_arm, looking};
use relight_capture::kinematics::{
    Cell, Joints, Obstruction, Outcome, Part, Route, RouteError, Unreachable, Unreached,
};
use relight_capture::trajectory::ObjectBox;
use relight_scene::Pose;

const CAMERA: usize = 0;
const LIGHT: usize = 1;

fn camera_waypoints() -> Vec<Vec<Pose>> {
    let ring = |elevation: f64| (-3..=3).map(move |i| vec![looking(0.61, elevation, 9.0 * f64::from(i))]);
    [24.0, 32.0, 40.0].into_iter().flat_map(ring).collect()
}

fn light_waypoints() -> Vec<Vec<Pose>> {
    let ring = |elevation: f64| {
        (0..8).map(move |i| Route::rolled(&looking(0.39, elevation, 45.0 * f64::from(i)), 4))
    };
    [60.0, 80.0].into_iter().flat_map(ring).collect()
}

/// Follows a route motion by motion, and says how many waypoints it reaches and how far its joints turn.
fn follow(
    cell: &Cell<2>,
    arm: usize,
    start: &[Joints; 2],
    waypoints: &[Vec<Pose>],
    route: &Route,
) -> (usize, f64) {
    let (mut here, mut reached, mut travel) = (*start, 0, 0.0);
    for (poses, stop) in waypoints.iter().zip(&route.stops) {
        let Outcome::Reached { joints, via } = stop else { continue };
        for target in via.iter().chain([joints]) {
            let mut there = here;
            there[arm] = *target;
            assert_eq!(cell.check_motion(&here, &there), Ok(()));
            travel += here[arm].iter().zip(target).map(|(a, b)| (b - a).abs()).sum::<f64>();
            here = there;
        }
        let tool = cell.arms()[arm].tool_pose(joints);
        let error = |pose: &Pose| {
            pose.0
                .iter()
                .flatten()
                .zip(tool.0.iter().flatten())
                .map(|(a, b)| (a - b).abs())
                .fold(0.0, f64::max)
        };
        assert!(poses.iter().map(error).fold(f64::MAX, f64::min) < 1e-9, "the tool is not at the waypoint");
        reached += 1;
    }
    (reached, travel)
}

#[test]
fn both_arms_find_a_free_way_along_their_domes() {
    let cell = cell();
    for (arm, waypoints) in [(CAMERA, camera_waypoints()), (LIGHT, light_waypoints())] {
        let home = cell.arms()[arm].model.upright;
        let route = Route::plan(&cell, arm, &UPRIGHT, &home, &waypoints).unwrap();
        assert_eq!(route.stops.len(), waypoints.len());
        for (i, stop) in route.stops.iter().enumerate() {
            if let Outcome::Unreached(reason) = stop {
                println!("arm {arm}, waypoint {i}: {reason}");
            }
        }
        let (reached, travel) = follow(&cell, arm, &UPRIGHT, &waypoints, &route);
        println!("arm {arm}: {reached} of {}, {travel:.1} rad", waypoints.len());
        assert!(10 * reached >= 8 * waypoints.len(), "{reached}");
        assert!((travel - route.travel).abs() < 1e-9, "{travel} {}", route.travel);
    }
}

#[test]
fn looking_ahead_travels_no_farther_than_taking_the_nearest_each_time() {
    let cell = cell();
    let waypoints = camera_waypoints();
    let home = cell.arms()[CAMERA].model.upright;
    let planned = Route::plan(&cell, CAMERA, &UPRIGHT, &home, &waypoints).unwrap();
    let (mut here, mut greedy) = (UPRIGHT, 0.0);
    for waypoint in waypoints {
        let step = Route::plan(&cell, CAMERA, &here, &home, &[waypoint]).unwrap();
        greedy += step.travel;
        if let Outcome::Reached { joints, .. } = step.stops[0] {
            here[CAMERA] = joints;
        }
    }
    assert!(planned.travel <= greedy + 1e-9, "{} > {greedy}", planned.travel);
}

#[test]
fn what_cannot_be_reached_is_left_out_with_its_reason() {
    let cell = cell();
    let far = vec![looking(3.0, 40.0, 0.0)];
    let in_the_table = vec![Pose::look_at([0.55, 0.0, 0.02], [0.0, 0.0, 0.1])];
    let good = vec![looking(0.61, 32.0, 0.0)];
    let waypoints = [far, good.clone(), in_the_table, Vec::new(), good];
    let route = Route::plan(&cell, CAMERA, &UPRIGHT, &UPRIGHT[CAMERA], &waypoints).unwrap();
    assert!(matches!(&route.stops[0], Outcome::Unreached(Unreached::NoSolution(Unreachable::TooFar { .. }))));
    let (Outcome::Reached { joints: first, .. }, Outcome::Reached { joints: last, .. }) =
        (&route.stops[1], &route.stops[4])
    else {
        panic!("{route:?}");
    };
    assert!(first.iter().zip(last).all(|(a, b)| (a - b).abs() < 1e-9), "it stays where it is already");
    match &route.stops[2] {
        Outcome::Unreached(Unreached::Blocked(Obstruction::Contact { contact, .. })) => {
            assert_eq!(contact.parts[1], Part::Table, "{contact}");
        }
        other => panic!("{other:?}"),
    }
    assert_eq!(route.stops[3], Outcome::Unreached(Unreached::NoPose));
}

/// The light arm's tool on one side of the wall, pointing down.
fn beside_the_wall(y: f64) -> Vec<Pose> {
    vec![Pose([[1.0, 0.0, 0.0, 0.2], [0.0, -1.0, 0.0, y], [0.0, 0.0, -1.0, 0.25]])]
}

/// The light arm alone, turned to a wall in front of it, and how it stands on either side; its joints are kept to what
/// both sides and upright need, so that it cannot go around.
fn walled(height: f64) -> (Cell<1>, Joints, [Joints; 2]) {
    let wall = ObjectBox { lo: [0.0, -0.01, 0.0], hi: [0.5, 0.01, height] };
    let home = [PI, -PI / 2.0, 0.0, -PI / 2.0, -PI / 2.0, 0.0];
    let mut arm = light_arm();
    let cell = Cell::new([arm.clone()], Some(0.0), Some(wall), CLEARANCE).unwrap();
    let sides = [0.3, -0.3].map(|y| {
        let route = Route::plan(&cell, 0, &[home], &home, &[beside_the_wall(y)]).unwrap();
        let Outcome::Reached { joints, .. } = route.stops[0] else { panic!("{route:?}") };
        joints
    });
    for joint in 0..6 {
        let all = [home[joint], sides[0][joint], sides[1][joint]];
        arm.model.limits.lower[joint] = all.into_iter().fold(f64::MAX, f64::min) - 0.05;
        arm.model.limits.upper[joint] = all.into_iter().fold(f64::MIN, f64::max) + 0.05;
    }
    (Cell::new([arm], Some(0.0), Some(wall), CLEARANCE).unwrap(), home, sides)
}

#[test]
fn an_obstacle_in_the_direct_way_is_lifted_over() {
    let (cell, home, [here, there]) = walled(0.45);
    assert!(cell.check_motion(&[here], &[there]).is_err());
    let route = Route::plan(&cell, 0, &[here], &home, &[beside_the_wall(-0.3)]).unwrap();
    let Outcome::Reached { joints, via } = route.stops[0] else { panic!("{route:?}") };
    assert_eq!(via, Some(home));
    assert_eq!(cell.check_motion(&[here], &[home]), Ok(()));
    assert_eq!(cell.check_motion(&[home], &[joints]), Ok(()));
}

#[test]
fn a_wall_that_home_does_not_clear_leaves_no_motion() {
    let (cell, _, [here, _]) = walled(0.45);
    // Home on this side of it.
    let route = Route::plan(&cell, 0, &[here], &here, &[beside_the_wall(-0.3)]).unwrap();
    match &route.stops[0] {
        Outcome::Unreached(Unreached::NoMotion(Obstruction::Contact { contact, fraction })) => {
            assert_eq!(contact.parts[1], Part::Object, "{contact}");
            assert!((0.1..0.9).contains(fraction), "{fraction}");
        }
        other => panic!("{other:?}"),
    }
}

#[test]
fn a_route_needs_an_arm_and_a_free_start() {
    let cell = cell();
    let missing = Route::plan(&cell, 2, &UPRIGHT, &UPRIGHT[0], &[]).unwrap_err();
    assert_eq!(missing, RouteError::NoSuchArm { arm: 2, arms: 2 });
    let mut start = UPRIGHT;
    start[LIGHT] = [PI / 2.0, 0.4, 0.0, -PI / 2.0, -PI / 2.0, 0.0];
    assert!(matches!(Route::plan(&cell, LIGHT, &start, &UPRIGHT[1], &[]), Err(RouteError::Start(_))));
    let route = Route::plan(&cell, LIGHT, &UPRIGHT, &UPRIGHT[1], &[]).unwrap();
    assert_eq!((route.stops, route.travel), (Vec::new(), 0.0));
}
