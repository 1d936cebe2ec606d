//! The dashboard of a simulated UR controller (UR, "Dashboard Server e-Series").

use std::io;

use super::arm::{Health, SimulatedArm};
use super::server::Wire;
use super::ur::VERSION;

pub(super) fn serve(wire: &mut Wire) -> io::Result<()> {
    wire.send(b"Connected: Universal Robots Dashboard Server\n")?;
    loop {
        let question = wire.line()?;
        let answer = answer(&question, &mut wire.arm());
        wire.send(format!("{answer}\n").as_bytes())?;
        if question == "quit" {
            return Ok(());
        }
    }
}

fn answer(question: &str, arm: &mut SimulatedArm) -> String {
    let now = arm.snapshot();
    let safety = match now.health {
        Health::Well => "NORMAL",
        Health::ProtectiveStop => "PROTECTIVE_STOP",
        Health::EmergencyStop => "ROBOT_EMERGENCY_STOP",
        Health::Error => "FAULT",
    };
    let fixed = match question {
        "robotmode" => "Robotmode: RUNNING",
        "running" if now.is_running => "Program running: true",
        "running" => "Program running: false",
        "programState" if now.is_running => "PLAYING <unnamed>",
        "programState" if now.is_paused => "PAUSED <unnamed>",
        "programState" => "STOPPED <unnamed>",
        "is in remote control" if now.is_remote => "true",
        "is in remote control" => "false",
        "get operational mode" => "NONE",
        "get robot model" => "UR5",
        "get serial number" => "20205500000",
        "get loaded program" => "No program loaded",
        "isProgramSaved" => "true <unnamed>",
        "get user role" => "NONE",
        "quit" => "Disconnected",
        "close popup" => "closing popup",
        "close safety popup" => "closing safety popup",
        "version" | "PolyscopeVersion" => {
            let [major, minor, bugfix, build] = VERSION;
            return format!("URSoftware {major}.{minor}.{bugfix}.{build} (Jan 01 2023)");
        }
        "safetymode" => return format!("Safetymode: {safety}"),
        "safetystatus" => return format!("Safetystatus: {safety}"),
        _ if question.starts_with("addToLog") => "Added log message",
        _ if question.starts_with("popup") => "showing popup",
        _ => return ordered(question, now.is_remote, arm),
    };
    fixed.to_owned()
}

/// Answers to what changes something, which needs remote control.
fn ordered(question: &str, is_remote: bool, arm: &mut SimulatedArm) -> String {
    let fails = || format!("Failed to execute: {question}");
    let answer = match question {
        "stop"
        | "pause"
        | "play"
        | "unlock protective stop"
        | "restart safety"
        | "power on"
        | "brake release"
            if !is_remote =>
        {
            return "Command is not allowed due to safety reasons".to_owned();
        }
        "stop" => {
            arm.halt(2.0);
            "Stopped"
        }
        "pause" => {
            arm.pause();
            "Pausing program"
        }
        "play" if arm.resume().is_ok() => "Starting program",
        "unlock protective stop" if arm.release() => "Protective stop releasing",
        "restart safety" if arm.release() => "Restarting safety",
        "play" | "unlock protective stop" | "restart safety" => return fails(),
        // It is on.
        "power on" => "Powering on",
        "brake release" => "Brake releasing",
        _ => {
            let shortened: String = question.chars().take(80).collect();
            return format!("could not understand: '{shortened}'");
        }
    };
    answer.to_owned()
}
