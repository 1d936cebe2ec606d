//! The paper's plan, asked of two arms.

// Helpers of tests may panic as tests do.
#![allow(clippy::unwrap_used)]

use relight_capture::kinematics::{ArmPlace, ArmsSettings, CellError, Make};
use relight_capture::trajectory::{Plan, PlanSettings};

fn arms(light: [f64; 3]) -> ArmsSettings {
    let place = |model, base_metres| ArmPlace { model, base_metres, yaw_degrees: 0.0, home_degrees: None };
    ArmsSettings {
        camera: place(Make::Ec66, [0.0, -1.0, 0.0]),
        light: place(Make::Ur5e, light),
        table_metres: 0.0,
        walls: Vec::new(),
        clearance_metres: 0.01,
    }
}

/// The plan as the arms leave it, and as it was.
fn reached(arms: &ArmsSettings) -> [Plan; 2] {
    let before = Plan::new(&PlanSettings::default()).unwrap();
    let mut plan = before.clone();
    arms.cell(plan.object).unwrap().reach_plan(&mut plan, &arms.homes()).unwrap();
    [plan, before]
}

#[test]
fn what_is_out_of_reach_is_marked_with_its_reason_and_not_visited() {
    let [plan, before] = reached(&arms([0.0, 0.45, 0.0]));
    assert_eq!((plan.camera.order.len(), plan.light.order.len()), (50, 39));
    let marked: Vec<_> = plan.light.waypoints.iter().filter(|w| w.unreachable.is_some()).collect();
    assert_eq!(marked.len(), 1);
    assert!(marked[0].unreachable.as_ref().unwrap().contains("too near the base's axis"), "{:?}", marked[0]);
    assert!(!plan.light.order.contains(&marked[0].label));
    for (now, then) in plan.light.waypoints.iter().zip(&before.light.waypoints) {
        assert_eq!((now.pose, now.label), (then.pose, then.label), "waypoints stay where they are");
    }
    // As good as the file's own check: it reads back.
    let folder = tempfile::tempdir().unwrap();
    plan.write(&folder.path().join("plan.json")).unwrap();
    assert_eq!(Plan::read(&folder.path().join("plan.json")).unwrap(), plan);
    // Farther away, what is on the other side of the object is too far.
    let [plan, _] = reached(&arms([0.2, 0.55, 0.0]));
    let reasons: Vec<_> = plan.light.waypoints.iter().filter_map(|w| w.unreachable.as_ref()).collect();
    assert!(reasons.len() > 3 && reasons.iter().all(|reason| reason.contains("too far")), "{reasons:?}");
}

/// A base that is turned reaches the same, by other joints.
#[test]
fn a_turned_base_reaches_the_same() {
    let straight = arms([0.0, 0.45, 0.0]);
    let mut turned = straight.clone();
    (turned.camera.yaw_degrees, turned.light.yaw_degrees) = (30.0, -75.0);
    let orders = [straight, turned].map(|arms| {
        let [mut plan, _] = reached(&arms);
        plan.light.order.sort_unstable();
        (plan.camera.order.len(), plan.light.order)
    });
    assert_eq!(orders[0], orders[1]);
}

#[test]
fn cells_that_cannot_be_are_refused() {
    let mut nowhere = arms([0.0, f64::NAN, 0.0]);
    let object = PlanSettings::default().object;
    assert!(matches!(nowhere.cell(object), Err(CellError::Pose { .. })));
    nowhere = arms([0.0, 0.45, 0.0]);
    nowhere.clearance_metres = -1.0;
    assert!(nowhere.cell(object).is_err());
}
