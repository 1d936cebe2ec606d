//! Forward and inverse kinematics against independent programs, on many poses, and where arms are singular.

// Helpers of tests may panic as tests do.
#![allow(clippy::unwrap_used)]

use std::f64::consts::{PI, TAU};

use proptest::prelude::*;
use relight_capture::kinematics::{ArmModel, EC66, JointLimits, Joints, UR5E, Unreachable};
use relight_scene::Pose;
use serde::Deserialize;

const ARMS: [&ArmModel; 2] = [&UR5E, &EC66];

#[derive(Deserialize)]
struct Golden {
    ur5e: Vec<Case>,
    ec66: Vec<Case>,
}

#[derive(Deserialize)]
struct Case {
    joints: Joints,
    pose: [f64; 16],
    solutions: Vec<Joints>,
}

fn golden() -> Golden {
    serde_json::from_str(include_str!("golden/kinematics.json")).unwrap()
}

/// The largest difference of two poses, entry by entry: metres, or radians for small turns.
fn difference(a: &Pose, b: &Pose) -> f64 {
    a.0.iter().flatten().zip(b.0.iter().flatten()).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max)
}

/// The largest difference of two configurations, whole turns apart from.
fn turn_between(a: &Joints, b: &Joints) -> f64 {
    let apart = |(a, b): (&f64, &f64)| {
        let d = (a - b).rem_euclid(TAU);
        d.min(TAU - d)
    };
    a.iter().zip(b).map(apart).fold(0.0, f64::max)
}

fn holds(solutions: &[Joints], joints: &Joints, within: f64) -> bool {
    solutions.iter().any(|s| turn_between(s, joints) < within)
}

/// A configuration from a seed, uniform over [-pi, pi] or what of it the joints' ranges allow.
fn random_joints(arm: &ArmModel, seed: u64) -> Joints {
    let mut state = seed.wrapping_mul(0x9e37_79b9_7f4a_7c15);
    std::array::from_fn(|i| {
        state = state.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = state;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        let unit = (z ^ (z >> 31)) as f64 / 2f64.powi(64);
        (2.0 * unit - 1.0) * arm.limits.upper[i].min(PI)
    })
}

fn joints() -> impl Strategy<Value = Joints> {
    let special = prop::sample::select(vec![0.0, PI / 2.0, -PI / 2.0, PI, -PI]);
    let angle = prop_oneof![3 => -PI..PI, 1 => special];
    prop::array::uniform6(angle)
}

#[test]
fn forward_kinematics_agree_with_independent_programs() {
    let golden = golden();
    for (arm, cases) in [(&UR5E, golden.ur5e), (&EC66, golden.ec66)] {
        assert!(cases.len() >= 30);
        for case in cases {
            let pose = Pose::from_matrix(&case.pose).unwrap();
            assert!(difference(&arm.forward(&case.joints), &pose) < 1e-14, "{}", arm.name);
        }
    }
}

#[test]
fn inverse_solutions_of_the_ur5e_are_those_of_an_independent_program() {
    for case in golden().ur5e {
        let pose = Pose::from_matrix(&case.pose).unwrap();
        let ours = UR5E.inverse(&pose, &[0.0; 6]).unwrap();
        assert_eq!(ours.len(), case.solutions.len());
        for theirs in &case.solutions {
            assert!(holds(&ours, theirs, 1e-9), "{theirs:?} is not among {ours:?}");
        }
    }
}

#[test]
fn ten_thousand_reachable_poses_of_each_arm_come_back() {
    for arm in ARMS {
        let (mut worst, mut with_eight) = (0.0_f64, 0);
        for seed in 0..10_000 {
            let joints = random_joints(arm, seed);
            let pose = arm.forward(&joints);
            let solutions = arm.inverse_within_limits(&pose, &joints).unwrap();
            for solution in &solutions {
                worst = worst.max(difference(&arm.forward(solution), &pose));
            }
            assert!(holds(&solutions, &joints, 1e-6), "{}: {joints:?} is not among {solutions:?}", arm.name);
            with_eight += usize::from(arm.inverse(&pose, &joints).unwrap().len() == 8);
        }
        println!("{}: worst {worst:e}, {with_eight} with eight", arm.name);
        assert!(worst < 1e-9, "{}: {worst:e}", arm.name);
        assert!(with_eight > 6_000, "{}: only {with_eight} poses have eight solutions", arm.name);
    }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 1000, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn every_solution_reproduces_the_pose_is_normalised_and_distinct(joints in joints(), which in 0..2usize) {
        let arm = ARMS[which];
        let pose = arm.forward(&joints);
        let solutions = arm.inverse(&pose, &joints).unwrap();
        prop_assert!(!solutions.is_empty() && solutions.len() <= 8);
        for (i, solution) in solutions.iter().enumerate() {
            prop_assert!(difference(&arm.forward(solution), &pose) < 1e-9, "{solution:?}");
            prop_assert!(solution.iter().all(|q| (-PI..=PI).contains(q)));
            prop_assert!(!holds(&solutions[..i], solution, 1e-6));
        }
    }

    #[test]
    fn poses_of_any_kind_give_solutions_or_a_reason(
        joints in joints(), position in prop::array::uniform3(-1.2..1.2f64), which in 0..2usize,
    ) {
        let arm = ARMS[which];
        let mut pose = arm.forward(&joints);
        for (row, p) in pose.0.iter_mut().zip(position) {
            row[3] = p;
        }
        match arm.inverse(&pose, &[0.0; 6]) {
            Ok(solutions) => for solution in solutions {
                prop_assert!(difference(&arm.forward(&solution), &pose) < 1e-9);
            },
            Err(reason) => {
                // What is refused is truly out of reach: no pose made from joints is.
                let stretched = (arm.a2 + arm.a3).abs() + arm.d4.hypot(arm.d5) + arm.d6;
                let from_shoulder = position[0].hypot(position[1]).hypot(position[2] - arm.d1);
                match reason {
                    Unreachable::TooFar { distance, reach } => {
                        prop_assert!(distance > reach);
                        prop_assert!(from_shoulder > reach - arm.d4.hypot(arm.d5) - arm.d6);
                    }
                    Unreachable::TooNear { distance, least } => prop_assert!(distance < least && from_shoulder < stretched),
                    Unreachable::BesideBase { distance, least } => {
                        prop_assert!(distance < least && position[0].hypot(position[1]) < arm.d4 + arm.d6);
                    }
                    other => prop_assert!(false, "{other}"),
                }
            }
        }
    }
}

/// Joints at which the wrist stands exactly `d4` from the base's axis.
fn at_the_shoulder_singularity(arm: &ArmModel, third: f64, fourth: f64) -> Joints {
    let across = arm.a2 + arm.a3 * third.cos() + arm.d5 * (third + fourth).sin();
    let up = -arm.a3 * third.sin() + arm.d5 * (third + fourth).cos();
    [0.3, (-across).atan2(up), third, fourth, 0.9, -0.4]
}

#[test]
fn singular_configurations_have_a_few_clean_solutions() {
    for arm in ARMS {
        let free = arm.zeros[4];
        let wrist_in_line = [0.3, -1.1, 1.2, 0.4, -free, 0.7];
        let wrist_turned_back = [0.3, -1.1, 1.2, 0.4, PI - free, 0.7];
        let stretched = [0.3, -1.1, 0.0, 0.4, 0.9, 0.7];
        let all_stretched = [0.0, -PI / 2.0, 0.0, -PI / 2.0, -free, 0.0];
        let shoulder = at_the_shoulder_singularity(arm, 1.3, 0.2);
        for (joints, most) in
            [(wrist_in_line, 6), (wrist_turned_back, 6), (stretched, 7), (all_stretched, 6), (shoulder, 4)]
        {
            let pose = arm.forward(&joints);
            let solutions = arm.inverse(&pose, &joints).unwrap();
            assert!(solutions.len() <= most, "{}: {joints:?} has {solutions:?}", arm.name);
            assert!(holds(&solutions, &joints, 1e-6), "{}: {joints:?} is not among {solutions:?}", arm.name);
            for solution in &solutions {
                assert!(difference(&arm.forward(solution), &pose) < 1e-9);
            }
        }
    }
}

#[test]
fn shoulder_wrist_and_elbow_may_be_singular_at_once() {
    for arm in ARMS {
        for i in 0..200 {
            let turn = 0.03 * f64::from(i) - 3.0;
            for third in [0.0, 1.3] {
                let mut joints = at_the_shoulder_singularity(arm, third, turn);
                (joints[0], joints[4]) = (turn, -arm.zeros[4]);
                let pose = arm.forward(&joints);
                let solutions = arm.inverse(&pose, &joints).unwrap();
                assert!(solutions.len() <= 2, "{}: {joints:?} has {solutions:?}", arm.name);
                assert!(
                    holds(&solutions, &joints, 1e-6),
                    "{}: {joints:?} is not among {solutions:?}",
                    arm.name
                );
                assert!(solutions.iter().all(|s| difference(&arm.forward(s), &pose) < 1e-9));
            }
        }
    }
}

#[test]
fn a_free_sixth_joint_stays_where_it_was() {
    for arm in ARMS {
        let joints = [0.3, -1.1, 1.2, 0.4, -arm.zeros[4], 0.7];
        let pose = arm.forward(&joints);
        for near in [-2.0, 0.0, 0.7, 1.9] {
            let solutions = arm.inverse(&pose, &[0.0, 0.0, 0.0, 0.0, 0.0, near]).unwrap();
            let singular = |s: &&Joints| (s[4] + arm.zeros[4]).sin().abs() < 1e-9;
            let kept: Vec<f64> = solutions.iter().filter(singular).map(|s| s[5]).collect();
            assert!(!kept.is_empty() && kept.iter().all(|q| (q - near).abs() < 1e-9), "{kept:?}");
        }
    }
}

#[test]
fn a_free_sixth_joint_gives_way_where_the_elbow_needs_it() {
    for arm in ARMS {
        // Stretched as far as it goes, the fifth axis outwards: the sixth joint must stand as it does.
        let joints = [0.3, -1.1, 0.0, -PI / 2.0, -arm.zeros[4], 0.7];
        let pose = arm.forward(&joints);
        for near in [0.7 + PI, 0.7 + 2.0, 0.7 - 1.0] {
            let solutions = arm.inverse(&pose, &[0.0, 0.0, 0.0, 0.0, 0.0, near]).unwrap();
            assert!(holds(&solutions, &joints, 1e-6), "{}: {solutions:?}", arm.name);
            assert!(solutions.iter().all(|s| difference(&arm.forward(s), &pose) < 1e-9));
        }
    }
}

#[test]
fn solutions_stay_good_all_the_way_into_a_singularity() {
    for arm in ARMS {
        for digits in 1..18 {
            let off = 10f64.powi(-digits);
            let mut shoulder = at_the_shoulder_singularity(arm, 1.3, 0.2);
            shoulder[1] += off;
            let near_wrist = [0.3, -1.1, 1.2, 0.4, off - arm.zeros[4], 0.7];
            for joints in
                [shoulder, near_wrist, [0.3, -1.1, off, 0.4, 0.9, 0.7], [0.3, -1.1, PI - off, 0.4, 0.9, 0.7]]
            {
                let pose = arm.forward(&joints);
                let solutions = arm.inverse(&pose, &joints).unwrap();
                for solution in &solutions {
                    let error = difference(&arm.forward(solution), &pose);
                    assert!(error < 1e-9, "{}: {joints:?}: {error:e}", arm.name);
                }
            }
        }
    }
}

#[test]
fn a_pose_that_a_text_file_rounded_is_reached_as_nearly_as_can_be() {
    let pose = UR5E.forward(&[0.3, -1.1, 1.2, 0.4, 0.9, 0.7]);
    let rounded = Pose(pose.0.map(|row| row.map(|v| (v * 1e4).round() / 1e4)));
    let solutions = UR5E.inverse(&rounded, &[0.0; 6]).unwrap();
    assert_eq!(solutions.len(), 8);
    for solution in solutions {
        let reached = UR5E.forward(&solution);
        assert!(difference(&reached, &rounded) < 2e-4);
        assert!(
            (0..3).all(|i| (reached.0[i][3] - rounded.0[i][3]).abs() < 1e-12),
            "the position is met exactly"
        );
    }
}

#[test]
fn unreachable_poses_have_none_and_a_reason() {
    let down = |x: f64, y: f64, z: f64| Pose([[1.0, 0.0, 0.0, x], [0.0, -1.0, 0.0, y], [0.0, 0.0, -1.0, z]]);
    for arm in ARMS {
        let reason = |pose: Pose| arm.inverse(&pose, &[0.0; 6]).unwrap_err();
        assert!(
            matches!(reason(down(1.4, 0.0, 0.3)), Unreachable::TooFar { distance, .. } if distance > 0.8)
        );
        assert!(matches!(reason(down(0.05, 0.05, 0.4)), Unreachable::BesideBase { .. }));
        assert!(matches!(reason(Pose([[f64::NAN; 4]; 3])), Unreachable::Pose(_)));
        assert!(matches!(reason(Pose([[0.5; 4]; 3])), Unreachable::Pose(_)));
    }
    let told = UR5E.inverse(&down(1.4, 0.0, 0.3), &[0.0; 6]).unwrap_err().to_string();
    assert!(
        told.starts_with("too far: the wrist would be 1.") && told.ends_with("reaches 0.817 m"),
        "{told}"
    );

    let mut stiff = EC66.clone();
    stiff.limits = JointLimits::symmetric([TAU, TAU, 0.5, TAU, TAU, TAU]);
    let bent = [0.0, -1.0, 1.5, 0.5, 1.0, 0.0];
    match stiff.inverse_within_limits(&stiff.forward(&bent), &bent) {
        Err(Unreachable::Limit(fault)) => assert_eq!((fault.joint, fault.upper), (2, 0.5)),
        other => panic!("{other:?}"),
    }
}

#[test]
fn each_reason_is_met_among_poses_close_to_the_base() {
    // With links so unlike, and so short a wrist, the folded arm keeps it away from the shoulder whichever way it turns.
    let unlike = ArmModel { a3: -0.15, d5: 0.03, ..UR5E };
    for (arm, folds_short) in [(&UR5E, false), (&EC66, false), (&unlike, true)] {
        let mut met = [0; 3];
        for seed in 0..20_000 {
            let mut pose = arm.forward(&random_joints(arm, seed));
            for (axis, row) in pose.0.iter_mut().enumerate() {
                row[3] = 0.5 * row[3] + if axis == 2 { 0.5 * arm.d1 } else { 0.0 };
            }
            match arm.inverse(&pose, &[0.0; 6]) {
                Err(Unreachable::TooNear { distance, least }) => {
                    assert!(distance < least);
                    met[0] += 1;
                }
                Err(Unreachable::BesideBase { distance, least }) => {
                    assert!(distance < least);
                    met[1] += 1;
                }
                Ok(_) => met[2] += 1,
                Err(other) => panic!("{other}"),
            }
        }
        assert_eq!(met[0] > 0, folds_short, "{met:?}");
        assert!(met[1] > 0 && met[2] > 0, "{met:?}");
    }
}

#[test]
fn solutions_turn_to_the_previous_configuration() {
    let joints = [4.0, -4.5, 1.2, 5.5, 0.9, -6.0];
    let all = UR5E.inverse_within_limits(&UR5E.forward(&joints), &joints).unwrap();
    assert!(all.iter().any(|s| s.iter().zip(&joints).all(|(a, b)| (a - b).abs() < 1e-9)), "{all:?}");
}
