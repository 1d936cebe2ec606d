//! `relight capture plan`: the plan's file and picture from the command line.

#![allow(clippy::unwrap_used)]

use std::fs;
use std::path::Path;
use std::process::{Command, Output};

use relight_capture::trajectory::{Plan, PlanSettings};
use relight_scene::read_image;

fn plan(folder: &Path, arguments: &str) -> Output {
    let mut command = Command::new(env!("CARGO_BIN_EXE_relight"));
    command.current_dir(folder).args(["capture", "plan"]).args(arguments.split_whitespace()).output().unwrap()
}

#[test]
fn a_plan_and_its_picture_are_written() {
    let folder = tempfile::tempdir().unwrap();
    let output = plan(folder.path(), "--out plan.json --picture plan.png");
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let said = String::from_utf8(output.stdout).unwrap();
    assert!(said.contains("camera 50 of 50 waypoints") && said.contains("light  40 of 40"), "{said}");
    assert!(said.contains("no arms were asked"), "{said}");
    let made = Plan::read(&folder.path().join("plan.json")).unwrap();
    assert_eq!(made, Plan::new(&PlanSettings::default()).unwrap());
    assert_eq!(read_image(&folder.path().join("plan.png")).unwrap().width, 1500);
    let help = String::from_utf8(plan(folder.path(), "--help").stdout).unwrap();
    let (_, example) = help.split_once("without them:").unwrap();
    let (example, _) = example.split_once("With a table of arms").unwrap();
    fs::write(folder.path().join("rig.toml"), example).unwrap();
    assert!(plan(folder.path(), "--rig rig.toml --out again.json").status.success());
    assert_eq!(Plan::read(&folder.path().join("again.json")).unwrap(), made, "the help tells the defaults");
}

#[test]
fn rigs_that_cannot_be_are_refused_by_name() {
    let folder = tempfile::tempdir().unwrap();
    for (rig, says) in [
        ("[camera", "rig.toml"),
        ("[lamp]\n", "rig.toml: "),
        ("[light]\nwaypoints = 4\nradius-metres = [0.4, 0.4]\n", "colatitude-degrees"),
        (
            "[light]\nwaypoints = 4\ncolatitude-degrees = [50, 40]\nradius-metres = [0.4, 0.4]\n",
            "rig.toml: [light] the colatitude range 50 to 40 degrees is reversed",
        ),
    ] {
        fs::write(folder.path().join("rig.toml"), rig).unwrap();
        let output = plan(folder.path(), "--rig rig.toml --out plan.json");
        let stderr = String::from_utf8(output.stderr).unwrap();
        assert_eq!(output.status.code(), Some(1), "{stderr}");
        assert!(stderr.contains(says) && !stderr.contains("panicked"), "{stderr}");
        assert!(!folder.path().join("plan.json").exists());
    }
    for arguments in ["--rig missing.toml --out plan.json", "--out nowhere/plan.json", "--out ."] {
        assert_eq!(plan(folder.path(), arguments).status.code(), Some(1), "{arguments}");
    }
    assert_eq!(plan(folder.path(), "").status.code(), Some(2));
}

#[test]
fn arms_that_are_given_are_asked_what_they_reach() {
    let folder = tempfile::tempdir().unwrap();
    let help = String::from_utf8(plan(folder.path(), "--help").stdout).unwrap();
    let (_, arms) = help.split_once("taken to be reached:").unwrap();
    let (arms, _) = arms.split_once("`relight capture run").unwrap();
    fs::write(folder.path().join("rig.toml"), arms).unwrap();
    let said = String::from_utf8(plan(folder.path(), "--rig rig.toml --out plan.json").stdout).unwrap();
    assert!(said.contains("camera 50 of 50") && said.contains("light  40 of 40"), "{said}");
    fs::write(folder.path().join("rig.toml"), arms.replace("-0.124, 0.464, 0.03", "0.0, 0.45, 0.0")).unwrap();
    let output = plan(folder.path(), "--rig rig.toml --out plan.json --picture plan.png");
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let said = String::from_utf8(output.stdout).unwrap();
    assert!(said.contains("camera 50 of 50") && said.contains("light  39 of 40"), "{said}");
    assert!(said.contains("is unreachable: too near the base's axis"), "{said}");
    let output = plan(folder.path(), "--rig virtual --out plan.json --picture plan.png");
    let said = String::from_utf8(output.stdout).unwrap();
    assert!(said.contains("camera 50 of 50") && !said.contains("no arms were asked"), "{said}");
    // A wall between the light's arm and half of its places.
    let wall = |hi: &str| arms.replace("walls = []", &format!("walls = [{{ lo = [-1, 0, 0], hi = {hi} }}]"));
    fs::write(folder.path().join("rig.toml"), wall("[1, 0.02, 1]")).unwrap();
    let output = plan(folder.path(), "--rig rig.toml --out plan.json");
    let said = String::from_utf8(output.stdout).unwrap();
    assert!(output.status.success() && said.contains("wall 1"), "{said}");
    assert!(said.contains("camera 50 of 50") && !said.contains("light  40 of 40"), "{said}");
    fs::write(folder.path().join("rig.toml"), wall("[1, 0.02, -1]")).unwrap();
    let output = plan(folder.path(), "--rig rig.toml --out other.json");
    let error = String::from_utf8(output.stderr).unwrap();
    assert!(error.contains("rig.toml") && error.contains("[arms] wall 1 from"), "{error}");
    fs::write(folder.path().join("rig.toml"), arms.replace("ur5e", "kuka")).unwrap();
    let output = plan(folder.path(), "--rig rig.toml --out other.json");
    assert!(String::from_utf8_lossy(&output.stderr).contains("rig.toml"));
    assert_eq!(output.status.code(), Some(1));
}
