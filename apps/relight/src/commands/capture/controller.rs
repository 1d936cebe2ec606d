//! `relight capture controller`: a simulated controller that real clients can drive.

use std::sync::atomic::Ordering;
use std::thread;
use std::time::Duration;

use anyhow::{Context, bail, ensure};
use clap::ValueEnum;
use relight_capture::robot::simulated::{Fault, NoiseOf, SimulationSettings};
use relight_capture::robot::{EliteAddresses, SimulatedController, UrAddresses};

use crate::console::{cancel_flag, print_line};

/// Simulate a robot's controller until Ctrl-C, for real clients to drive.
///
/// `ur` is a UR5e with RTDE, the secondary interface (scripts of movej, stopj, sleep and textmsg) and the dashboard; `ec` is
/// Elite's EC66 with JSON-RPC and the monitor. The arm is on, ready and in remote control; it moves in joint space, in real
/// time, and comes to rest 0.03 mm (root mean square) beside the target. Once it listens it prints a line for each port: the service and
/// its address.
#[derive(clap::Args)]
#[command(after_help = "Examples:\n  relight capture controller ur\n  \
                  relight capture controller ec --listen 127.0.0.1:0\n  \
                  relight capture controller ur --fault protective-stop@3 --fault slow-replies@500\n\n\
                  Ports: HOST alone stands for the vendor's (ur: 30004 rtde, 30002 script, 29999 dashboard, 30003 \
                  realtime, which takes scripts too; ec: 8055 control, 8056 monitor). HOST:PORT counts up from PORT in that order, HOST:0 takes any that are free.\n\n\
                  Faults: protective-stop, emergency-stop, error and leave-remote come half-way through the N-th motion \
                  (1 unless told otherwise); link-loss, slow-replies and garbage after N messages on all connections \
                  together (200 unless told otherwise).")]
pub struct Args {
    /// Whose controller.
    make: Make,
    /// Where to listen: HOST or HOST:PORT.
    #[arg(long, value_name = "ADDR", default_value = "127.0.0.1")]
    listen: String,
    /// What goes wrong, and when: KIND or KIND@N. Can be given more than once.
    #[arg(long, value_name = "FAULT")]
    fault: Vec<Fault>,
    /// Seed of where exactly the arm comes to rest.
    #[arg(long, value_name = "N", default_value_t = 0)]
    seed: u64,
    /// What that depends on, besides the seed: a real arm rests a little elsewhere after each motion.
    #[arg(long, value_enum, value_name = "motion|target", default_value = "motion")]
    noise_of: Of,
    /// Where the arm stands at first, degrees; where its maker ships it if not given.
    #[arg(long, value_name = "Q1,…,Q6", allow_hyphen_values = true, value_delimiter = ',')]
    joints: Option<Vec<f64>>,
    /// Simulated seconds per second.
    #[arg(long, value_name = "F", default_value_t = 1.0, value_parser = time_scale)]
    time_scale: f64,
}

#[derive(Clone, Copy, ValueEnum)]
enum Of {
    /// The number of the motion.
    Motion,
    /// Where it goes: the same each time.
    Target,
}

#[derive(Clone, Copy, ValueEnum)]
enum Make {
    /// Universal Robots UR5e.
    Ur,
    /// Elite EC66.
    Ec,
}

fn time_scale(words: &str) -> Result<f64, String> {
    let scale = words.parse().ok().filter(|scale: &f64| (0.01..=1000.0).contains(scale));
    scale.ok_or_else(|| "a number from 0.01 to 1000".to_owned())
}

pub fn run(args: &Args) -> anyhow::Result<()> {
    let cancel = cancel_flag()?;
    let degrees = args.joints.clone().map(<[f64; 6]>::try_from).transpose();
    let Ok(joints) = degrees else { bail!("--joints: give six angles") };
    ensure!(
        joints.is_none_or(|joints| joints.iter().all(|q| q.abs() <= 360.0)),
        "--joints: an angle is not from -360 to 360 degrees"
    );
    let settings = SimulationSettings {
        seed: args.seed,
        noise_of: match args.noise_of {
            Of::Motion => NoiseOf::Motion,
            Of::Target => NoiseOf::Target,
        },
        time_scale: args.time_scale,
        faults: args.fault.clone(),
        joints: joints.map(|joints| joints.map(f64::to_radians)),
    };
    let controller = match args.make {
        Make::Ur => {
            SimulatedController::ur5e(&UrAddresses::parse(&args.listen).context("--listen")?, settings)?
        }
        Make::Ec => {
            SimulatedController::ec66(&EliteAddresses::parse(&args.listen).context("--listen")?, settings)?
        }
    };
    for (service, address) in controller.listening() {
        print_line(&format!("{service} {address}"))?;
    }
    while !cancel.load(Ordering::Relaxed) {
        thread::sleep(Duration::from_millis(50));
    }
    Ok(())
}
