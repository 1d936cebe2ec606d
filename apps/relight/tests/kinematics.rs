//! `relight capture kinematics` as scripts call it.

// Helpers of tests may panic as tests do.
#![allow(clippy::unwrap_used)]

use std::process::{Command, Output};

use serde_json::Value;

fn run(arguments: &[&str]) -> Output {
    let mut command = Command::new(env!("CARGO_BIN_EXE_relight"));
    command.args(["capture", "kinematics"]).args(arguments).output().unwrap()
}

fn json(arguments: &[&str]) -> Value {
    let output = run(arguments);
    assert!(output.status.success(), "{arguments:?}: {}", String::from_utf8_lossy(&output.stderr));
    serde_json::from_slice(&output.stdout).unwrap()
}

fn list(value: &Value) -> Vec<f64> {
    value.as_array().unwrap().iter().map(|v| v.as_f64().unwrap()).collect()
}

fn nearest(solutions: &Value, joints: &[f64]) -> f64 {
    let apart = |s: &Value| list(s).iter().zip(joints).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
    solutions.as_array().unwrap().iter().map(apart).fold(f64::MAX, f64::min)
}

#[test]
fn a_pose_from_joints_leads_back_to_them() {
    let joints = [-0.5, -1.5, 1.25, -0.75, -1.5, 0.5];
    let text = "-0.5,-1.5,1.25,-0.75,-1.5,0.5";
    for arm in ["ur5e", "ec66"] {
        let forward = json(&[arm, "--joints", text, "--json"]);
        let pose = list(&forward["pose"]);
        assert_eq!(pose.len(), 16);
        assert_eq!(pose[12..], [0.0, 0.0, 0.0, 1.0]);
        let words: Vec<String> = pose.iter().map(f64::to_string).collect();
        let parted: Vec<&str> =
            [arm, "--pose"].into_iter().chain(words.iter().map(String::as_str)).chain(["--json"]).collect();
        let commas = words.join(",");
        let equals = format!("--pose={commas}");
        for arguments in [parted.as_slice(), &[arm, "--pose", &commas, "--json"], &["--json", arm, &equals]] {
            let answer = json(arguments);
            let solutions = answer["solutions"].as_array().unwrap();
            assert_eq!(solutions.len(), 8, "{arm}");
            assert!(nearest(&answer["solutions"], &joints) < 1e-9, "{arm}: {answer}");
        }
    }
}

#[test]
fn joints_of_a_known_pose() {
    // All joints at zero: the UR5e lies stretched along its own -X.
    let pose = list(&json(&["ur5e", "--joints", "0,0,0,0,0,0", "--json"])["pose"]);
    let known = [1.0, 0.0, 0.0, -0.8172, 0.0, 0.0, -1.0, -0.2329, 0.0, 1.0, 0.0, 0.0628, 0.0, 0.0, 0.0, 1.0];
    assert!(pose.iter().zip(known).all(|(a, b)| (a - b).abs() < 1e-12), "{pose:?}");
}

#[test]
fn a_pose_out_of_reach_has_no_solutions_and_a_reason() {
    let output = run(&["ur5e", "--pose", "1,0,0,2,0,1,0,0,0,0,1,0.5,0,0,0,1", "--json"]);
    assert!(output.status.success());
    assert_eq!(String::from_utf8_lossy(&output.stdout).trim(), r#"{"solutions":[]}"#);
    let told = String::from_utf8_lossy(&output.stderr);
    assert!(told.contains("too far"), "{told}");
}

#[test]
fn bad_arguments_are_told() {
    let fault = |arguments: &[&str]| {
        let output = run(arguments);
        assert_eq!(output.status.code(), Some(2), "{arguments:?}");
        String::from_utf8_lossy(&output.stderr).into_owned()
    };
    assert!(fault(&["ur5e", "--pose", "1,0,0,0,0,1,0,0,0,0,-1,0,0,0,0,1"]).contains("mirrors"));
    assert!(fault(&["ur5e", "--pose", "1,0,0,0,0,1,0,0,0,0,1,0,0.1,0.2,0.3,1"]).contains("transposed"));
    assert!(fault(&["ur5e", "--pose", "1", "0", "0"]).contains("3 numbers where 16 are needed"));
    assert!(fault(&["ur5e", "--joints", "1,2,3,4,5,nan"]).contains("finite"));
    assert!(fault(&["ur5e", "--joints", "0,0,0,0,0,0", "--pose", "1"]).contains("numbers"));
    assert!(fault(&["ur5e"]).contains("--joints"));
    assert!(fault(&["ur10", "--joints", "0,0,0,0,0,0"]).contains("ec66"));
}
