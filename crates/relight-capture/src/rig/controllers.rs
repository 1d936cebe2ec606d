//! The arms of a rig, real or simulated.

use std::time::Duration;

use super::error::SetupError;
use super::file::Controllers;
use super::itinerary::{CAMERA, Itinerary, LIGHT};
use super::roadmap::HOME;
use crate::kinematics::{ArmsSettings, Joints, Make};
use crate::robot::simulated::{NoiseOf, Repeatability, SimulationSettings};
use crate::robot::{
    Arm, ArmError, EliteAddresses, EliteArm, SimulatedController, TimeLimits, UrAddresses, UrArm,
};

/// Any free ports of this machine.
const ANYWHERE: &str = "127.0.0.1:0";
/// How much faster than real time simulated arms go.
const TIME_SCALE: f64 = 1000.0;
/// How long simulated controllers may take to answer: a machine that traces is busy.
const PATIENCE: Duration = Duration::from_secs(30);

/// Both arms: the camera's and the light's.
pub type Arms = [Box<dyn Arm>; 2];

/// Connects to the controllers of both arms. They stay where they are.
///
/// # Errors
/// If an address is none, or what answers there is no controller of the arm's make.
pub fn connect(
    itinerary: &Itinerary,
    arms: &ArmsSettings,
    controllers: &Controllers,
) -> Result<Arms, SetupError> {
    let connect = |arm: usize, make: Make, at: &str| {
        let limits = TimeLimits::default();
        let connected: Result<Box<dyn Arm>, ArmError> = match make {
            Make::Ur5e => UrArm::connect(UrAddresses::parse(at)?, limits).map(|arm| Box::new(arm) as _),
            Make::Ec66 => EliteArm::connect(EliteAddresses::parse(at)?, limits).map(|arm| Box::new(arm) as _),
        };
        named(itinerary, arm, connected)
    };
    Ok([
        connect(CAMERA, arms.camera.model, &controllers.camera)?,
        connect(LIGHT, arms.light.model, &controllers.light)?,
    ])
}

/// Arms that are simulated in this process, spoken to over the makers' protocols as any others.
pub struct SimulatedArms {
    /// The controllers, which live as long as the arms are driven.
    controllers: [SimulatedController; 2],
    seed: u64,
}

impl SimulatedArms {
    /// Starts controllers for both arms, which stand at home.
    ///
    /// # Errors
    /// If no port is free.
    pub fn start(itinerary: &Itinerary, arms: &ArmsSettings, seed: u64) -> Result<SimulatedArms, SetupError> {
        let start = |arm: usize, make: Make| -> Result<SimulatedController, SetupError> {
            let settings = SimulationSettings {
                seed: seed_of(arm, seed),
                noise_of: NoiseOf::Target,
                time_scale: TIME_SCALE,
                faults: Vec::new(),
                joints: Some(*itinerary.joints(arm, HOME)),
            };
            Ok(match make {
                Make::Ur5e => SimulatedController::ur5e(&UrAddresses::parse(ANYWHERE)?, settings)?,
                Make::Ec66 => SimulatedController::ec66(&EliteAddresses::parse(ANYWHERE)?, settings)?,
            })
        };
        let controllers = [start(CAMERA, arms.camera.model)?, start(LIGHT, arms.light.model)?];
        Ok(SimulatedArms { controllers, seed })
    }

    /// Connects to them by the drivers of real arms.
    ///
    /// # Errors
    /// If one does not answer in time.
    pub fn connect(&self, itinerary: &Itinerary, arms: &ArmsSettings) -> Result<Arms, SetupError> {
        let limits =
            TimeLimits { connect: PATIENCE, reply: PATIENCE, silence: PATIENCE, rest: Duration::ZERO };
        let connect = |arm: usize, make: Make| {
            let controller = &self.controllers[arm];
            let at = |service| controller.address_of(service);
            let connected: Result<Box<dyn Arm>, ArmError> = match make {
                Make::Ur5e => {
                    let [rtde, script, dashboard, realtime] =
                        [at("rtde"), at("script"), at("dashboard"), at("realtime")];
                    UrArm::connect(UrAddresses { rtde, script, dashboard, realtime }, limits)
                        .map(|arm| Box::new(arm) as _)
                }
                Make::Ec66 => {
                    let [control, monitor] = [at("control"), at("monitor")];
                    EliteArm::connect(EliteAddresses { control, monitor }, limits)
                        .map(|arm| Box::new(arm) as _)
                }
            };
            named(itinerary, arm, connected)
        };
        Ok([connect(CAMERA, arms.camera.model)?, connect(LIGHT, arms.light.model)?])
    }

    /// Where an arm will come to rest when it goes to some joints, radians.
    pub fn foresee(&self, arm: usize, joints: &Joints) -> Joints {
        Repeatability::of(NoiseOf::Target, seed_of(arm, self.seed)).reached(0, joints)
    }
}

/// Both arms have their own noise.
fn seed_of(arm: usize, seed: u64) -> u64 {
    seed.wrapping_mul(2).wrapping_add(arm as u64)
}

fn named(
    itinerary: &Itinerary,
    arm: usize,
    connected: Result<Box<dyn Arm>, ArmError>,
) -> Result<Box<dyn Arm>, SetupError> {
    connected.map_err(|fault| SetupError::Connect { arm: itinerary.arm(arm).name.clone(), fault })
}
