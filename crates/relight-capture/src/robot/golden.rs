//! Bytes of independent clients, made by `tools/golden_robots.py`.

use std::collections::BTreeMap;

use serde_json::Value;

use super::arm::Joints;

fn file() -> Value {
    serde_json::from_str(include_str!("../../tests/golden/robots.json")).unwrap()
}

fn bytes(hex: &Value) -> Vec<u8> {
    let hex = hex.as_str().unwrap();
    (0..hex.len() / 2).map(|i| u8::from_str_radix(&hex[2 * i..2 * i + 2], 16).unwrap()).collect()
}

fn frames(group: &str) -> BTreeMap<String, Vec<u8>> {
    let file = file();
    file["ur"][group].as_object().unwrap().iter().map(|(kind, hex)| (kind.clone(), bytes(hex))).collect()
}

pub(super) fn joints() -> Joints {
    serde_json::from_value::<Vec<f64>>(file()["joints"].clone()).unwrap().try_into().unwrap()
}

/// Frames that UR's client sends, by kind.
pub(super) fn ur_requests() -> BTreeMap<String, Vec<u8>> {
    frames("requests")
}

/// Payloads that it accepts as answers, by kind.
pub(super) fn ur_answers() -> BTreeMap<String, Vec<u8>> {
    frames("answers")
}

/// A frame of the outputs that it asked for: 1.5 s, the joints, running, safe, playing.
pub(super) fn ur_state() -> Vec<u8> {
    bytes(&file()["ur"]["state"])
}

/// A monitor's packet as elirobots unpacks it: the joints, running, servos on, remote.
pub(super) fn elite_packet() -> Vec<u8> {
    bytes(&file()["elite"]["packet"])
}

/// Lines that elirobots and elite-ec-sdk send: getRobotState, moveByJoint to the joints at 20 %, then getRobotMode and
/// moveByJoint again.
pub(super) fn elite_requests() -> Vec<String> {
    serde_json::from_value(file()["elite"]["requests"].clone()).unwrap()
}
