use std::fs;

use serde_json::{Value, json};

use super::super::{PLAN_FORMAT, Plan, PlanError, PlanSettings};
use super::small;

fn plan() -> Plan {
    let mut plan = Plan::new(&small()).unwrap();
    plan.camera.waypoints[4].unreachable =
        Some("joint 3 would have to turn to 171 degrees, its limit is 160".into());
    plan.camera.order.retain(|&label| label != 4);
    plan
}

/// A plan's file after `change`, and what reading it says.
fn fault(change: impl FnOnce(&mut Value)) -> String {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("plan.json");
    plan().write(&path).unwrap();
    let mut value: Value = serde_json::from_slice(&fs::read(&path).unwrap()).unwrap();
    change(&mut value);
    fs::write(&path, value.to_string()).unwrap();
    let said = Plan::read(&path).unwrap_err().to_string();
    assert!(said.contains("plan.json: "), "{said}");
    said
}

#[test]
fn a_plan_comes_back_from_its_file_to_the_last_bit() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("plan.json");
    let plan = plan();
    plan.write(&path).unwrap();
    assert_eq!(Plan::read(&path).unwrap(), plan);
    assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 1, "nothing is left beside it");
    let value: Value = serde_json::from_slice(&fs::read(&path).unwrap()).unwrap();
    assert_eq!(value["format"], PLAN_FORMAT);
    let pose = value["light"]["waypoints"][2]["pose"].as_array().unwrap();
    let position = plan.light.waypoints[2].pose.position();
    assert_eq!([&pose[3], &pose[7], &pose[11]], position.map(Value::from).each_ref());
    assert_eq!(pose[12..], [0.0, 0.0, 0.0, 1.0].map(Value::from));
}

#[test]
fn other_versions_are_refused_by_name() {
    let said = fault(|plan| {
        plan["format"] = "relight-plan-2".into();
        plan["novelty"] = 1.into();
    });
    assert!(
        said.contains(r#"format "relight-plan-2" is unknown to this version, which reads "relight-plan-1""#)
    );
    assert!(fault(|plan| drop(plan.as_object_mut().unwrap().remove("format"))).contains("no \"format\""));
    assert!(fault(|plan| plan["format"] = json!({})).contains("unknown"));
}

#[test]
fn plans_that_contradict_themselves_are_refused() {
    type Change = fn(&mut Value);
    let faults: [(&str, Change); 14] = [
        ("is not a plan: ", |plan| *plan = json!([])),
        ("unknown field `novelty`", |plan| plan["novelty"] = 1.into()),
        ("missing field `light`", |plan| drop(plan.as_object_mut().unwrap().remove("light"))),
        ("\"object\" is no box", |plan| plan["object"]["lo"] = json!([0.0, 0.0, 9.0])),
        ("\"light\": no sphere", |plan| plan["light"]["radius"] = json!([0.5, 0.4])),
        ("\"light\": no sphere", |plan| plan["light"]["centre"] = json!([0.0, 1e200, 0.0])),
        ("\"camera\": 0 waypoints", |plan| plan["camera"]["waypoints"] = json!([])),
        ("waypoint 1 is labelled 7", |plan| plan["camera"]["waypoints"][1]["label"] = 7.into()),
        ("the rotation part is not orthonormal", |plan| plan["camera"]["waypoints"][2]["pose"][0] = 2.into()),
        ("invalid length", |plan| plan["camera"]["waypoints"][2]["pose"] = json!([1.0, 2.0])),
        ("the cell of waypoint 3: the colatitude range", |plan| {
            plan["light"]["waypoints"][3]["cell"]["colatitude"] = json!([1.0, 0.5]);
        }),
        ("the order visits 12, which", |plan| plan["camera"]["order"][0] = 12.into()),
        ("the order visits 4, which is no reachable waypoint", |plan| plan["camera"]["order"][0] = 4.into()),
        ("11 stops at 10 places", |plan| plan["camera"]["order"][0] = plan["camera"]["order"][1].clone()),
    ];
    for (says, change) in faults {
        let said = fault(change);
        assert!(said.contains(says), "{says}: {said}");
    }
    let said = fault(|plan| drop(plan["light"]["order"].as_array_mut().unwrap().pop()));
    assert!(said.contains("8 stops") && said.contains("9 waypoints are reachable"), "{said}");
}

#[test]
fn files_that_are_none_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let missing = folder.path().join("missing.json");
    assert!(matches!(Plan::read(&missing), Err(PlanError::Read(_))));
    assert!(matches!(plan().write(folder.path()), Err(PlanError::Write { .. })));
    fs::write(&missing, "{\"format\":\"relight-plan-1\",").unwrap();
    assert!(Plan::read(&missing).unwrap_err().to_string().contains("missing.json: is not a plan"));
}

#[test]
fn the_default_is_the_rig_of_the_paper() {
    let plan = Plan::new(&PlanSettings::default()).unwrap();
    let statistics = |trajectory: &super::super::Trajectory| {
        let mut ranges = [[f64::MAX, f64::MIN]; 2];
        for waypoint in &trajectory.waypoints {
            let p = glam::DVec3::from(waypoint.pose.position());
            for (range, value) in ranges.iter_mut().zip([p.length(), (p.z / p.length()).asin().to_degrees()])
            {
                *range = [range[0].min(value), range[1].max(value)];
            }
        }
        ranges
    };
    assert_eq!((plan.camera.waypoints.len(), plan.light.waypoints.len()), (50, 40));
    let within = |[lo, hi]: [f64; 2], [least, most]: [f64; 2]| least <= lo && hi <= most;
    let [radius, elevation] = statistics(&plan.camera);
    assert!(within(radius, [0.602, 0.623]) && within(elevation, [22.0, 42.0]));
    let [radius, elevation] = statistics(&plan.light);
    assert!(within(radius, [0.363, 0.414]) && within(elevation, [47.0, 85.0]));
    assert!(elevation[0] < 55.0 && elevation[1] > 75.0, "the whole dome part: {elevation:?}");
}

#[test]
fn settings_are_toml_and_their_faults_are_told() {
    let text = toml::to_string(&PlanSettings::default()).unwrap();
    assert_eq!(toml::from_str::<PlanSettings>(&text).unwrap(), PlanSettings::default());
    let short = "[light]\nwaypoints = 3\ncolatitude-degrees = [0, 60]\nradius-metres = [0.4, 0.4]\n";
    let settings: PlanSettings = toml::from_str(short).unwrap();
    assert_eq!(settings.light.azimuth_degrees, [0.0, 360.0]);
    assert_eq!(settings.camera, PlanSettings::default().camera);
    assert!(toml::from_str::<PlanSettings>("[light]\nwaypoint = 3\n").is_err());
    let said = |change: fn(&mut PlanSettings)| {
        let mut settings = small();
        change(&mut settings);
        Plan::new(&settings).unwrap_err().to_string()
    };
    assert!(said(|s| s.light.waypoints = 0).starts_with("[light] 0 cells"));
    assert!(
        said(|s| s.camera.colatitude_degrees = [68.0, 48.0])
            .starts_with("[camera] the colatitude range 68 to 48")
    );
    assert!(said(|s| s.camera.radius_metres = [0.6, f64::NAN]).starts_with("[camera] the radius"));
    assert!(said(|s| s.object.hi[2] = -1.0).starts_with("[object]"));
}
