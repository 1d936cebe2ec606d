//! The control port of a simulated Elite EC controller: JSON-RPC, a line a message, results as strings that hold JSON.

use std::io;

use relight_scene::Pose;
use serde_json::{Value, json};

use super::super::arm::{Joints, largest_difference};
use super::arm::{Health, Refusal, SimulatedArm, Snapshot, Step};
use super::model::{of_roll_pitch_yaw, roll_pitch_yaw};
use super::server::Wire;

/// Error codes: JSON-RPC's own, and Elite's for a controller that is not in remote mode.
const NO_JSON: i64 = -32700;
const NO_METHOD: i64 = -32601;
const BAD_PARAMETERS: i64 = -32602;
const NOT_REMOTE: i64 = -32693;

pub(super) fn serve(wire: &mut Wire) -> io::Result<()> {
    loop {
        let question = wire.line()?;
        let answer = answer(&question, &mut wire.arm());
        // In one piece: clients read once.
        wire.send(format!("{answer}\n").as_bytes())?;
    }
}

/// The state as a number of Elite's.
pub(super) fn robot_state(now: &Snapshot) -> i32 {
    match (now.health, now.is_running, now.is_paused) {
        (Health::EmergencyStop, ..) => 2,
        (Health::Error, ..) => 4,
        (Health::ProtectiveStop, ..) => 5,
        (_, true, _) => 3,
        (_, _, true) => 1,
        _ => 0,
    }
}

/// The mode as a number of Elite's: remote, or taught by hand.
pub(super) fn robot_mode(now: &Snapshot) -> i32 {
    if now.is_remote { 2 } else { 0 }
}

/// Joint angles or speeds in degrees, with the two external axes that are not there.
pub(super) fn eight_degrees(joints: &Joints) -> [f64; 8] {
    std::array::from_fn(|i| joints.get(i).copied().unwrap_or(0.0).to_degrees())
}

fn answer(question: &str, arm: &mut SimulatedArm) -> Value {
    let Ok(question) = serde_json::from_str::<Value>(question) else {
        return refusal(&Value::Null, NO_JSON, "Parse error.");
    };
    let id = question.get("id").cloned().unwrap_or(Value::Null);
    let id = if id.is_number() { id } else { Value::Null };
    let Some(method) = question.get("method").and_then(Value::as_str) else {
        return refusal(&id, NO_METHOD, "Method not found.");
    };
    match call(method, question.get("params").unwrap_or(&Value::Null), arm) {
        Ok(result) => json!({"jsonrpc": "2.0", "result": result.to_string(), "id": id}),
        Err((code, message)) => refusal(&id, code, message),
    }
}

fn refusal(id: &Value, code: i64, message: &str) -> Value {
    json!({"jsonrpc": "2.0", "error": {"code": code, "message": message}, "id": id})
}

fn call(method: &str, parameters: &Value, arm: &mut SimulatedArm) -> Result<Value, (i64, &'static str)> {
    let now = arm.snapshot();
    let is_in_degrees = parameters.get("unit_type").and_then(Value::as_i64) == Some(0);
    let pose = |pose: Pose| {
        let mut pose = roll_pitch_yaw(&pose);
        if is_in_degrees {
            pose[3..].iter_mut().for_each(|angle| *angle = angle.to_degrees());
        }
        json!(pose)
    };
    Ok(match method {
        "getRobotState" => json!(robot_state(&now)),
        "getRobotMode" => json!(robot_mode(&now)),
        "getServoStatus" | "getMotorStatus" => json!(true),
        "get_servo_precise_position_status" => json!(1),
        "get_transparent_transmission_state" => json!(0),
        "get_estop_status" => json!(i32::from(now.health == Health::EmergencyStop)),
        "getCollisionState" => json!(i32::from(now.health == Health::ProtectiveStop)),
        "get_joint_pos" | "getRobotPos" => json!(eight_degrees(&now.joints)),
        "get_joint_speed" => json!(eight_degrees(&now.speeds)),
        "getRobotPose" | "get_tcp_pose" | "get_base_flange_pose" => pose(now.model.flange(&now.joints)),
        "positiveKinematic" => pose(now.model.flange(&joints(parameters, "targetPos")?)),
        "inverseKinematic" => {
            let mut pose = numbers(parameters, "targetPose")?;
            if is_in_degrees {
                pose[3..].iter_mut().for_each(|angle| *angle = angle.to_radians());
            }
            let near = match parameters.get("referencePos") {
                Some(_) => joints(parameters, "referencePos")?,
                None => now.joints,
            };
            let solutions = now.model.arm.inverse_within_limits(&of_roll_pitch_yaw(pose), &near);
            let apart = |joints: &Joints| largest_difference(joints, &near).1;
            let nearest = solutions
                .ok()
                .and_then(|found| found.into_iter().min_by(|a, b| apart(a).total_cmp(&apart(b))));
            json!(eight_degrees(&nearest.ok_or((BAD_PARAMETERS, "targetPose is out of reach"))?))
        }
        "getSoftVersion" => json!("v3.5.2"),
        "getRobotType" => json!(62),
        "getRobotSubtype" => json!(6),
        "getSpeed" => json!(100.0),
        "getCurrentCoord" | "getCycleMode" | "getToolNumber" | "getUserNumber" => json!(0),
        _ => return order(method, parameters, &now, arm),
    })
}

/// What changes something, which needs remote mode.
fn order(
    method: &str,
    parameters: &Value,
    now: &Snapshot,
    arm: &mut SimulatedArm,
) -> Result<Value, (i64, &'static str)> {
    let orders = [
        "moveByJoint",
        "stop",
        "stopj",
        "pause",
        "run",
        "clearAlarm",
        "resetCollisionState",
        "set_servo_status",
        "syncMotorStatus",
    ];
    if !orders.contains(&method) {
        return Err((NO_METHOD, "Method not found."));
    }
    if !now.is_remote {
        return Err((
            NOT_REMOTE,
            "The interface cannot be executed in the current mode: switch to remote mode.",
        ));
    }
    Ok(json!(match method {
        "moveByJoint" if now.is_running || now.is_paused => false,
        "moveByJoint" => {
            let percent =
                parameters.get("speed").and_then(Value::as_f64).filter(|v| (0.05..=100.0).contains(v));
            let percent = percent.ok_or((BAD_PARAMETERS, "speed is outside 0.05 to 100"))?;
            let speed = 0.01 * percent * now.model.full_speed;
            let step = Step::Move {
                target: joints(parameters, "targetPos")?,
                speed,
                acceleration: now.model.acceleration,
            };
            match arm.run(vec![step]) {
                Ok(()) => true,
                Err(Refusal::Bad) => return Err((BAD_PARAMETERS, "targetPos is out of range")),
                Err(Refusal::NotReady | Refusal::NotRemote) => false,
            }
        }
        "stop" | "stopj" => {
            arm.halt(2.0);
            true
        }
        "pause" => {
            arm.pause();
            true
        }
        "run" => arm.resume().is_ok(),
        "clearAlarm" | "resetCollisionState" => arm.release(),
        // They are on and in step.
        _ => true,
    }))
}

/// Six to eight angles in degrees, by their key, in radians; those of external axes do not matter.
fn joints(parameters: &Value, key: &str) -> Result<Joints, (i64, &'static str)> {
    Ok(numbers(parameters, key)?.map(f64::to_radians))
}

/// The first six of six to eight numbers, by their key.
fn numbers(parameters: &Value, key: &str) -> Result<[f64; 6], (i64, &'static str)> {
    let fault = (BAD_PARAMETERS, "a position or pose is not six to eight numbers");
    let list = parameters.get(key).and_then(Value::as_array).ok_or(fault)?;
    let numbers = list.iter().map(Value::as_f64).collect::<Option<Vec<_>>>().ok_or(fault)?;
    if numbers.len() > 8 {
        return Err(fault);
    }
    numbers.first_chunk().copied().ok_or(fault)
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::super::super::golden;
    use super::super::{SimulatedModel, SimulationSettings};
    use super::*;

    fn arm() -> SimulatedArm {
        SimulatedArm::new(
            &SimulatedModel::EC66,
            &SimulationSettings { time_scale: 1e6, ..SimulationSettings::default() },
        )
    }

    #[test]
    fn requests_of_both_clients_are_understood() {
        for clients in golden::elite_requests().chunks(2) {
            let mut arm = arm();
            let asked = answer(&clients[0], &mut arm);
            assert!(asked["result"].is_string() && asked["id"] == 1, "{asked}");
            let moved = answer(&clients[1], &mut arm);
            assert_eq!(moved["result"], "true", "{moved}");
            std::thread::sleep(std::time::Duration::from_millis(1));
            assert!(largest_difference(&arm.snapshot().joints, &golden::joints()).1 < 3e-4);
        }
    }

    #[test]
    fn answers_are_short_and_name_what_is_wrong() {
        let mut arm = arm();
        for (question, code) in [
            ("{", NO_JSON),
            ("[]", NO_METHOD),
            (r#"{"method":"dance","id":1}"#, NO_METHOD),
            (r#"{"method":"inverseKinematic","id":1}"#, BAD_PARAMETERS),
            (
                r#"{"method":"inverseKinematic","params":{"targetPose":[9000,0,0,0,0,0]},"id":1}"#,
                BAD_PARAMETERS,
            ),
            (
                r#"{"method":"moveByJoint","params":{"targetPos":[0,0,0,0,0,0],"speed":0},"id":1}"#,
                BAD_PARAMETERS,
            ),
            (r#"{"method":"moveByJoint","params":{"targetPos":[0,0,0],"speed":5},"id":1}"#, BAD_PARAMETERS),
            (
                r#"{"method":"moveByJoint","params":{"targetPos":[0,0,200,0,0,0],"speed":5},"id":1}"#,
                BAD_PARAMETERS,
            ),
        ] {
            assert_eq!(answer(question, &mut arm)["error"]["code"], code, "{question}");
        }
        // An id that is a long text must not come back: clients read 1 KiB.
        let long = format!(r#"{{"method":"get_tcp_pose","id":"{}"}}"#, "a".repeat(5000));
        assert!(answer(&long, &mut arm).to_string().len() < 1024);
    }

    #[test]
    fn joints_are_found_for_a_pose_near_where_one_asks() {
        let mut arm = arm();
        let mut ask = |method: &str, parameters: Value| -> Vec<f64> {
            let question = json!({"method": method, "params": parameters, "id": 1}).to_string();
            serde_json::from_str(answer(&question, &mut arm)["result"].as_str().unwrap()).unwrap()
        };
        let there = [30.0, -70.0, 80.0, -95.0, 75.0, 20.0];
        for unit in [0, 1] {
            let pose = ask("positiveKinematic", json!({"targetPos": there, "unit_type": unit}));
            let near = there.map(|angle| angle + 3.0);
            let found =
                ask("inverseKinematic", json!({"targetPose": pose, "referencePos": near, "unit_type": unit}));
            assert!(there.iter().zip(&found).all(|(a, b)| (a - b).abs() < 1e-6), "{found:?}");
            assert_eq!(found.len(), 8);
        }
    }

    #[test]
    fn the_monitor_says_what_a_driver_reads() {
        let mut arm = arm();
        let snapshot = arm.snapshot();
        let packet = super::super::elite_monitor::packet(&snapshot, 0);
        let state = super::super::super::elite::monitor::state(&packet).unwrap();
        assert!(largest_difference(&state.joints, &SimulatedModel::EC66.home).1 < 1e-12);
        assert_eq!(state.status, super::super::super::arm::ArmStatus::Idle);
        assert_eq!(packet.len(), 1024);
    }

    proptest! {
        #[test]
        fn no_words_make_it_panic(words in "[ -~]{0,60}", method in "moveByJoint|positiveKinematic|inverseKinematic|get_tcp_pose", parameters in "[0-9\\[\\]{}:,e-]{0,30}") {
            answer(&words, &mut arm());
            answer(&format!(r#"{{"method":"{method}","params":{parameters},"id":1}}"#), &mut arm());
            answer(&format!(r#"{{"method":"{method}","params":{{"targetPos":[{parameters}],"speed":5}},"id":1}}"#), &mut arm());
        }
    }
}
