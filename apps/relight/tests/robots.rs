//! `relight capture controller` in a process of its own, driven over TCP.

#![allow(clippy::unwrap_used)]

use std::io::{BufRead, BufReader};
use std::process::{Child, Command, Stdio};

use relight_capture::robot::simulated::SimulatedModel;
use relight_capture::robot::{
    Arm, ArmError, ArmStatus, EliteAddresses, EliteArm, JointSpeed, Joints, MotionPlan, TimeLimits,
    UrAddresses, UrArm,
};

fn relight(arguments: &str) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_relight"));
    command.args(arguments.split_whitespace()).stdin(Stdio::null());
    command
}

/// A controller that runs until it is interrupted.
struct Controller {
    process: Child,
    /// Service and address, a line each.
    lines: Vec<(String, String)>,
}

impl Controller {
    fn start(arguments: &str, ports: usize) -> Controller {
        let mut process =
            relight(&format!("capture controller {arguments}")).stdout(Stdio::piped()).spawn().unwrap();
        let lines = BufReader::new(process.stdout.take().unwrap()).lines().take(ports);
        let part = |line: String| {
            let (service, address) = line.split_once(' ').unwrap();
            (service.to_owned(), address.to_owned())
        };
        let lines = lines.map(|line| part(line.unwrap())).collect();
        Controller { process, lines }
    }

    fn at(&self, service: &str) -> String {
        self.lines.iter().find(|(name, _)| name == service).unwrap().1.clone()
    }

    /// Ctrl-C, and the exit status.
    fn interrupt(mut self) -> Option<i32> {
        let killed = Command::new("kill").args(["-INT", &self.process.id().to_string()]).status().unwrap();
        assert!(killed.success());
        self.process.wait().unwrap().code()
    }
}

impl Drop for Controller {
    fn drop(&mut self) {
        let _ = self.process.kill();
    }
}

fn plan(home: Joints) -> MotionPlan {
    let stations: Vec<Joints> = [0.0, 0.3, 0.6].iter().map(|d| home.map(|q| q + d)).collect();
    MotionPlan::through(&stations, JointSpeed::FASTEST, |_, _| Ok::<_, String>(())).unwrap()
}

/// The first motion succeeds, the second ends as `expected`.
fn drive(arm: &mut dyn Arm, home: Joints, expected: ArmStatus) {
    let plan = plan(home);
    arm.move_along(&plan.motions()[0]).unwrap();
    let error = arm.move_along(&plan.motions()[1]).unwrap_err();
    assert!(matches!(&error, ArmError::Stopped { status, .. } if *status == expected), "{error}");
}

#[test]
fn a_ur_controller_is_driven_fails_on_demand_and_ends_cleanly() {
    let controller =
        Controller::start("ur --listen 127.0.0.1:0 --time-scale 10 --fault protective-stop@2 --seed 5", 4);
    let addresses = UrAddresses {
        rtde: controller.at("rtde"),
        script: controller.at("script"),
        dashboard: controller.at("dashboard"),
        realtime: controller.at("realtime"),
    };
    let mut arm = UrArm::connect(addresses, TimeLimits::default()).unwrap();
    drive(&mut arm, SimulatedModel::UR5E.home, ArmStatus::ProtectiveStop);
    assert_eq!(controller.interrupt(), Some(0));
    assert!(matches!(arm.state(), Err(ArmError::LinkLost { .. })));
}

#[test]
fn an_ec_controller_is_driven_fails_on_demand_and_ends_cleanly() {
    let controller = Controller::start("ec --listen 127.0.0.1:0 --time-scale 10 --fault emergency-stop@2", 2);
    let addresses = EliteAddresses { control: controller.at("control"), monitor: controller.at("monitor") };
    let mut arm = EliteArm::connect(addresses, TimeLimits::default()).unwrap();
    drive(&mut arm, SimulatedModel::EC66.home, ArmStatus::EmergencyStop);
    assert_eq!(controller.interrupt(), Some(0));
}

#[test]
fn what_cannot_be_is_refused() {
    let fails = |arguments: &str, code: i32| {
        let output = relight(&format!("capture controller {arguments}")).output().unwrap();
        let stderr = String::from_utf8(output.stderr).unwrap();
        assert_eq!(output.status.code(), Some(code), "{arguments}: {stderr}");
        assert!(output.stdout.is_empty() && !stderr.contains("panicked"), "{arguments}: {stderr}");
        stderr
    };
    for arguments in
        ["", "kuka", "ur --fault fire", "ur --fault error@0", "ec --time-scale 0", "ec --seed -1"]
    {
        fails(arguments, 2);
    }
    assert!(fails("ur --fault fire", 2).contains("link-loss"), "the kinds are named");
    assert!(fails("ur --listen 127.0.0.1:65535", 1).contains("HOST:PORT"));
    let first = Controller::start("ec --listen 127.0.0.1:0", 2);
    let taken = first.at("control");
    assert!(fails(&format!("ec --listen {taken}"), 1).contains(&taken));
}
