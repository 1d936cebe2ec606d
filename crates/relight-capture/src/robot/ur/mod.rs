//! Universal Robots' controllers: states by RTDE, motions as scripts, remote control and stops by the dashboard.

mod dashboard;
pub(super) mod rtde;
mod script;
mod stream;

use std::time::{Duration, Instant};

use super::addresses::UrAddresses;
use super::arm::{ArmState, ArmStatus};
use super::error::ArmError;
use super::following::{Controller, Watch};
use super::link::{Link, TimeLimits};
use super::planned_motion::PlannedMotion;
use dashboard::Dashboard;

/// How often remote control is asked for while the arm moves.
const ASK_EVERY: Duration = Duration::from_millis(250);

/// An arm of Universal Robots' e-Series (PolyScope 5.6 or later, which has remote control).
#[derive(Debug)]
pub struct UrArm {
    watch: Watch,
    /// The addresses of the secondary interface and the dashboard.
    script_at: String,
    dashboard_at: String,
    dashboard: Dashboard,
    /// The last connection that took a script. It stays open until the next: closing it while the controller sends
    /// would reset it, and the script with it.
    script: Option<Link>,
    asked: Instant,
}

impl UrArm {
    /// Connects to a controller. The arm stays where it is.
    ///
    /// # Errors
    /// If one of the three ports does not answer as it should.
    pub fn connect(addresses: UrAddresses, limits: TimeLimits) -> Result<UrArm, ArmError> {
        let UrAddresses { rtde: address, script: script_at, dashboard: dashboard_at, .. } = addresses;
        let dashboard = Dashboard::connect(&dashboard_at, limits)?;
        let feed = stream::open(&address, limits)?;
        let watch = Watch { address, limits, feed };
        Ok(UrArm { watch, script_at, dashboard_at, dashboard, script: None, asked: Instant::now() })
    }

    fn run(&mut self, script: &str) -> Result<(), ArmError> {
        let mut link = Link::connect(&self.script_at, "secondary interface", &self.watch.limits)?;
        link.send(script.as_bytes())?;
        self.script = Some(link);
        Ok(())
    }

    fn check_remote(&mut self) -> Result<(), ArmError> {
        if self.dashboard.is_remote()? {
            return Ok(());
        }
        let address = self.dashboard_at.clone();
        Err(ArmError::Stopped { address, status: ArmStatus::NotInRemote })
    }
}

impl Controller for UrArm {
    fn watched(&self) -> &Watch {
        &self.watch
    }

    fn state_now(&mut self) -> Result<ArmState, ArmError> {
        let (_, state) = self.watch.newest()?;
        let is_well = matches!(state.status, ArmStatus::Idle | ArmStatus::Running);
        if is_well && !self.dashboard.is_remote()? {
            return Ok(ArmState { status: ArmStatus::NotInRemote, ..state });
        }
        Ok(state)
    }

    fn begin(&mut self, motion: &PlannedMotion) -> Result<(), ArmError> {
        self.run(&script::movej(motion))
    }

    fn watch(&mut self) -> Result<(), ArmError> {
        if self.asked.elapsed() < ASK_EVERY {
            return Ok(());
        }
        self.asked = Instant::now();
        self.check_remote()
    }

    fn order_stop(&mut self) -> Result<(), ArmError> {
        // The script first: nobody need answer it.
        let by_script = self.run(script::STOP);
        let by_dashboard = self.dashboard.stop();
        by_script.and(by_dashboard)
    }
}
