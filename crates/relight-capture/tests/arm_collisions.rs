//! Collisions of the arms: what meets what, at rest and on the way.

// Helpers of tests may panic as tests do.
#![allow(clippy::unwrap_used)]

mod common;

use std::f64::consts::PI;

use common::{CLEARANCE, OBJECT, UPRIGHT, between, camera_arm, cell, light_arm};
use proptest::prelude::*;
use relight_capture::kinematics::{Arm, Cell, Contact, Joints, Obstruction, Part};
use relight_capture::trajectory::ObjectBox;

/// What counts as touching is up to this much nearer than the clearance, metres.
const TOUCH: f64 = 1e-4;

fn contact(result: Result<(), Obstruction>) -> (Contact, f64) {
    match result {
        Err(Obstruction::Contact { contact, fraction }) => (contact, fraction),
        other => panic!("{other:?}"),
    }
}

fn arm_part(arm: &str, link: &'static str) -> Part {
    Part::Link { arm: arm.to_owned(), link }
}

#[test]
fn upright_arms_stand_free() {
    let cell = cell();
    assert_eq!(cell.check(&UPRIGHT), Ok(()));
    let nearest = cell.closest(&UPRIGHT).unwrap();
    assert!(nearest.distance > CLEARANCE, "{nearest}");
}

#[test]
fn an_arm_that_reaches_down_meets_the_table_and_then_the_object() {
    // Stretched towards the object and lowered from level.
    let lowered = [UPRIGHT[0], [PI, -0.1, 0.0, -PI / 2.0, -PI / 2.0, 0.0]];
    let into_table = [UPRIGHT[0], [PI / 2.0, 0.4, 0.0, -PI / 2.0, -PI / 2.0, 0.0]];
    let (met, _) = contact(cell().check(&into_table));
    assert_eq!(met.parts[1], Part::Table, "{met}");
    assert!(met.distance < -0.3, "the deepest counts: {}", met.distance);
    let tall = ObjectBox { lo: [-0.08, -0.08, 0.0], hi: [0.08, 0.08, 0.4] };
    let cell = Cell::new([camera_arm(), light_arm()], Some(0.0), Some(tall), CLEARANCE).unwrap();
    let (met, _) = contact(cell.check(&lowered));
    assert_eq!(met.parts[1], Part::Object, "{met}");
    assert!(matches!(&met.parts[0], Part::Link { arm, .. } if arm == "light arm"), "{met}");
}

/// The light's arm, stretched towards the object, is lowered behind a wall or into it.
#[test]
fn walls_are_met_on_the_way_and_those_elsewhere_are_not() {
    let lowered = [UPRIGHT[0], [PI, -0.1, 0.0, -PI / 2.0, -PI / 2.0, 0.0]];
    let open = Cell::new([camera_arm(), light_arm()], Some(0.0), None, CLEARANCE).unwrap();
    let wall = |x: f64| ObjectBox { lo: [x, -0.3, 0.0], hi: [x + 0.05, 0.3, 0.3] };
    assert_eq!(open.check_motion(&UPRIGHT, &lowered), Ok(()));
    let beyond = open.clone().with_walls(&[wall(-1.6)]).unwrap();
    assert_eq!(beyond.check_motion(&UPRIGHT, &lowered), Ok(()));
    let before = open.with_walls(&[wall(-1.6), wall(-0.2)]).unwrap();
    let (met, fraction) = contact(before.check_motion(&UPRIGHT, &lowered));
    assert_eq!(met.parts[1], Part::Wall(1), "{met}");
    assert!(met.to_string().ends_with("wall 2") && fraction > 0.3 && fraction < 1.0, "{met} {fraction}");
    assert_eq!(before.check(&UPRIGHT), Ok(()));
}

#[test]
fn a_folded_arm_meets_itself() {
    let mut folded = UPRIGHT;
    folded[1] = [0.0, -PI / 2.0, 2.9, 0.0, -PI / 2.0, 0.0];
    let (met, fraction) = contact(cell().check(&folded));
    assert_eq!(fraction, 0.0);
    assert!(
        met.parts.iter().all(|part| matches!(part, Part::Link { arm, .. } if arm == "light arm")),
        "{met}"
    );
}

#[test]
fn arms_that_reach_for_each_other_meet() {
    // Both level, one towards the other, over a gap of 1.45 m that is less than both reaches.
    let level = [[PI, 0.0, 0.0, -PI / 2.0, PI / 2.0, 0.0], [PI, 0.0, 0.0, -PI / 2.0, -PI / 2.0, 0.0]];
    let empty = Cell::new([camera_arm(), light_arm()], None, None, CLEARANCE).unwrap();
    let (met, _) = contact(empty.check(&level));
    let arms: Vec<&str> = met
        .parts
        .iter()
        .map(|p| match p {
            Part::Link { arm, .. } => arm.as_str(),
            _ => "",
        })
        .collect();
    assert!(arms.contains(&"camera arm") && arms.contains(&"light arm"), "{met}");
    // And on the way there, from upright, not before they have come near.
    let (_, fraction) = contact(empty.check_motion(&UPRIGHT, &level));
    assert!(fraction > 0.2 && fraction < 1.0, "{fraction}");
}

#[test]
fn a_thin_wall_between_the_ends_of_a_motion_is_not_jumped_over() {
    let wall = ObjectBox { lo: [-0.2, -0.0005, 0.3], hi: [0.3, 0.0005, 0.301] };
    let cell = Cell::new([light_arm()], Some(0.0), Some(wall), 0.0).unwrap();
    let reach = |heading: f64| [[heading, -0.3, 0.3, -PI / 2.0, -PI / 2.0, 0.0]];
    let (from, to) = (reach(PI - 1.2), reach(PI + 1.2));
    assert_eq!((cell.check(&from), cell.check(&to)), (Ok(()), Ok(())));
    let (met, fraction) = contact(cell.check_motion(&from, &to));
    assert_eq!(met.parts[1], Part::Object, "{met}");
    assert!((0.05..0.95).contains(&fraction), "{fraction}");
    // The way around the back is free: no wall there.
    assert_eq!(cell.check_motion(&from, &reach(PI + 1.2 - 2.0 * PI)), Ok(()));
}

#[test]
fn a_motion_out_of_a_joints_range_or_of_no_numbers_is_refused() {
    let mut beyond = UPRIGHT;
    beyond[0][2] = 3.0;
    let told = cell().check_motion(&UPRIGHT, &beyond).unwrap_err().to_string();
    assert!(told.starts_with("the camera arm's joint 3 would stand at 171.9 degrees"), "{told}");
    beyond[0][2] = f64::NAN;
    assert!(matches!(cell().check(&beyond), Err(Obstruction::Limit { .. })));
}

#[test]
fn things_that_make_no_cell_are_named() {
    let told = |arm: Arm, table: f64, object: ObjectBox, clearance: f64| {
        Cell::new([arm], Some(table), Some(object), clearance).unwrap_err().to_string()
    };
    let nowhere = ObjectBox { lo: [f64::NAN; 3], hi: [1.0; 3] };
    let inside_out = ObjectBox { lo: [0.1; 3], hi: [-0.1; 3] };
    assert!(told(light_arm(), 0.0, nowhere, 0.0).contains("finite"));
    assert!(told(light_arm(), 0.0, inside_out, 0.0).contains("lowest corner first"));
    assert!(told(light_arm(), f64::NAN, OBJECT, 0.0).contains("table"));
    assert!(told(light_arm(), 0.0, OBJECT, -0.1).contains("clearance of -0.1 m"));
    let mut mirrored = light_arm();
    mirrored.base.0[0][0] = -1.0;
    assert!(
        told(mirrored, 0.0, OBJECT, 0.0)
            .starts_with("the light arm's base is no rigid pose: the rotation part mirrors")
    );
    let mut hollow = light_arm();
    hollow.tool.hull[0].radius = 0.0;
    assert!(told(hollow, 0.0, OBJECT, 0.0).contains("hull"));
}

#[test]
fn a_contact_is_told_in_words() {
    let parts = [arm_part("light arm", "forearm"), Part::Object];
    let near = Contact { parts: parts.clone(), distance: 0.0042 };
    assert_eq!(near.to_string(), "the light arm's forearm comes within 4.2 mm of the object's box");
    let inside = Obstruction::Contact { contact: Contact { parts, distance: -0.01 }, fraction: 0.25 };
    assert_eq!(
        inside.to_string(),
        "the light arm's forearm runs into the object's box, 25 % along the motion"
    );
}

fn joints() -> impl Strategy<Value = Joints> {
    (-PI..PI, -2.6..-0.4f64, -2.0..2.0f64, -PI..PI, -PI..PI, -PI..PI)
        .prop_map(|(a, b, c, d, e, f)| [a, b, c, d, e, f])
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 200, max_global_rejects: 100_000, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn motions_are_free_just_as_far_as_dense_samples_are(from in [joints(), joints()], to in [joints(), joints()]) {
        const SAMPLES: usize = 400;
        let cell = cell();
        prop_assume!(cell.check(&from).is_ok());
        let distance = |fraction: f64| cell.closest(&between(&from, &to, fraction)).unwrap().distance;
        let free_until = match cell.check_motion(&from, &to) {
            Ok(()) => 1.0,
            Err(Obstruction::Contact { contact, fraction }) => {
                prop_assert!((distance(fraction) - contact.distance).abs() < 1e-12);
                prop_assert!(contact.distance < CLEARANCE + TOUCH);
                fraction
            }
            Err(other) => return Err(TestCaseError::fail(other.to_string())),
        };
        for i in 0..=SAMPLES {
            let fraction = i as f64 / SAMPLES as f64;
            if fraction < free_until {
                prop_assert!(distance(fraction) >= CLEARANCE, "missed at {fraction}, said free until {free_until}");
            }
        }
    }
}
