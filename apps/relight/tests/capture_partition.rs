//! `relight capture partition`: equal-area cells on the command line.

#![allow(clippy::unwrap_used)]

use std::f64::consts::PI;
use std::process::{Command, Output};

use serde_json::Value;

fn partition(arguments: &str) -> Output {
    let mut command = Command::new(env!("CARGO_BIN_EXE_relight"));
    command.args(["capture", "partition"]).args(arguments.split_whitespace()).output().unwrap()
}

fn json(arguments: &str) -> Value {
    let output = partition(&format!("{arguments} --json"));
    assert!(output.status.success(), "{arguments}: {}", String::from_utf8_lossy(&output.stderr));
    serde_json::from_slice(&output.stdout).unwrap()
}

fn pair(value: &Value) -> [f64; 2] {
    [0, 1].map(|index| value[index].as_f64().unwrap())
}

/// Areas from the bounds as they are written, in degrees.
fn areas(parted: &Value) -> Vec<f64> {
    let area = |cell: &Value| {
        let [top, bottom] = pair(&cell["colatitude"]).map(|angle| angle.to_radians().cos());
        let [lo, hi] = pair(&cell["azimuth"]);
        assert_eq!(cell.as_object().unwrap().len(), 4);
        let told = cell["area"].as_f64().unwrap();
        let area = (top - bottom) * (hi - lo).to_radians();
        assert!((area - told).abs() < 1e-12);
        area
    };
    parted["cells"].as_array().unwrap().iter().map(area).collect()
}

#[test]
fn the_whole_sphere_is_parted_without_a_region() {
    let parted = json("--cells 100");
    assert_eq!(parted.as_object().unwrap().len(), 2);
    assert_eq!(parted["rings"], serde_json::json!([1, 6, 11, 15, 17, 17, 15, 11, 6, 1]));
    let all = areas(&parted);
    assert_eq!(all.len(), 100);
    assert!(all.iter().all(|area| (area - 4.0 * PI / 100.0).abs() < 1e-12));
    let first_of_second_ring = &parted["cells"][1];
    assert!((pair(&first_of_second_ring["colatitude"])[0] - 11.47834).abs() < 5.1e-6);
    assert!((pair(&first_of_second_ring["centre"])[0] - 21.08088).abs() < 5.1e-6);
    assert_eq!(pair(&parted["cells"][99]["centre"])[0], 180.0);
}

#[test]
fn a_region_is_parted_itself() {
    let parted = json("--cells 50 --colatitude 48,68 --azimuth -118.5,-61.5");
    let share = 57f64.to_radians() * (48f64.to_radians().cos() - 68f64.to_radians().cos()) / 50.0;
    let all = areas(&parted);
    assert_eq!(all.len(), 50);
    assert!(all.iter().all(|area| (area - share).abs() < 1e-12));
    for cell in parted["cells"].as_array().unwrap() {
        let [colatitude, azimuth] = pair(&cell["centre"]);
        assert!((48.0..68.0).contains(&colatitude) && (-118.5..-61.5).contains(&azimuth));
    }
    let rings: Vec<u64> =
        parted["rings"].as_array().unwrap().iter().map(|count| count.as_u64().unwrap()).collect();
    assert!(rings.len() > 1 && rings.iter().sum::<u64>() == 50, "{rings:?}");
    assert_eq!(json("--cells 7 --colatitude 0,60")["rings"][0], 1, "a dome has a cap");
    assert_eq!(json("--cells 8 --colatitude 100,180")["rings"].as_array().unwrap().last().unwrap(), 1);
}

#[test]
fn without_json_there_is_a_table_of_rings() {
    let output = partition("--cells 40");
    let text = String::from_utf8(output.stdout).unwrap();
    assert_eq!(text.lines().count(), 8, "{text}");
    assert!(text.starts_with("40 cells of 0.314159 sr each, 12.566371 sr in all"));
    assert!(text.contains("18.19487") && text.contains("35.66249"), "{text}");
}

#[test]
fn regions_that_cannot_be_are_refused() {
    for (arguments, says) in [
        ("", "--cells"),
        ("--cells -3", "-3"),
        ("--cells many", "many"),
        ("--cells 0", "0 is not in 1..=100000"),
        ("--cells 999999", "999999 is not in 1..=100000"),
        ("--cells 999999999999", "1..=100000"),
        ("--cells 5 --azimuth 30", "not LO,HI"),
        ("--cells 5 --azimuth 30,x", "\"x\" is not a number"),
        ("--cells 5 --colatitude 40,30", "the colatitude range 40 to 30 degrees is reversed"),
        ("--cells 5 --colatitude 40,40", "is empty"),
        ("--cells 5 --colatitude 40,190", "leaves 0..180"),
        ("--cells 5 --azimuth -10,351", "more than a full turn"),
        ("--cells 5 --azimuth nan,1", "not a finite number"),
    ] {
        let output = partition(arguments);
        let stderr = String::from_utf8(output.stderr).unwrap();
        assert_eq!(output.status.code(), Some(2), "{arguments}: {stderr}");
        assert!(output.stdout.is_empty(), "{arguments}");
        assert!(stderr.contains(says) && !stderr.contains("panicked"), "{arguments}: {stderr}");
    }
}
