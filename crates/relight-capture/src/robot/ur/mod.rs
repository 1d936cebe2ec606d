//! Universal Robots' controllers: states by RTDE, motions as scripts, remote control and stops by the dashboard.

mod dashboard;
pub(super) mod rtde;
mod script;
mod stream;

use std::time::{Duration, Instant};

use super::addresses::UrAddresses;
use super::arm::{Arm, ArmState, ArmStatus};
use super::error::ArmError;
use super::feed::Feed;
use super::following::{self, Controller};
use super::link::{Link, TimeLimits};
use super::planned_motion::PlannedMotion;
use dashboard::Dashboard;

/// How often remote control is asked for while the arm moves.
const ASK_EVERY: Duration = Duration::from_millis(250);

/// An arm of Universal Robots' e-Series (PolyScope 5.6 or later, which has remote control).
#[derive(Debug)]
pub struct UrArm {
    addresses: UrAddresses,
    limits: TimeLimits,
    feed: Feed,
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
        let dashboard = Dashboard::connect(&addresses.dashboard, limits)?;
        let feed = stream::open(&addresses.rtde, limits)?;
        Ok(UrArm { addresses, limits, feed, dashboard, script: None, asked: Instant::now() })
    }

    fn run(&mut self, script: &str) -> Result<(), ArmError> {
        let mut link = Link::connect(&self.addresses.script, "secondary interface", &self.limits)?;
        link.send(script.as_bytes())?;
        self.script = Some(link);
        Ok(())
    }

    fn check_remote(&mut self) -> Result<(), ArmError> {
        if self.dashboard.is_remote()? {
            return Ok(());
        }
        let address = self.addresses.dashboard.clone();
        Err(ArmError::Stopped { address, status: ArmStatus::NotInRemote })
    }
}

impl Controller for UrArm {
    fn address(&self) -> &str {
        &self.addresses.rtde
    }

    fn limits(&self) -> &TimeLimits {
        &self.limits
    }

    fn feed(&self) -> &Feed {
        &self.feed
    }

    fn state_now(&mut self) -> Result<ArmState, ArmError> {
        let (_, state) = self.feed.newest(&self.addresses.rtde, self.limits.silence)?;
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

impl Arm for UrArm {
    fn state(&mut self) -> Result<ArmState, ArmError> {
        self.state_now()
    }

    fn move_along(&mut self, motion: &PlannedMotion) -> Result<ArmState, ArmError> {
        following::follow(self, motion)
    }

    fn stop(&mut self) -> Result<(), ArmError> {
        following::stop(self)
    }
}
