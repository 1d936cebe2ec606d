//! Elite's EC controllers: states by the monitor, motions and stops by JSON-RPC.

mod json_rpc;
pub(super) mod monitor;

use serde_json::{Value, json};

use super::addresses::EliteAddresses;
use super::arm::ArmState;
use super::error::ArmError;
use super::feed::Feed;
use super::following::{Controller, Watch};
use super::link::{Link, TimeLimits};
use super::planned_motion::PlannedMotion;
use json_rpc::JsonRpc;

/// What the controller takes for full joint speed, rad/s: that of the fastest joint, so that a share of it is never
/// faster than planned. Joints that are slower by nature arrive later, within the driver's limit.
const FULL_SPEED: f64 = std::f64::consts::PI;
/// The least share that it takes, percent.
const LEAST: f64 = 0.05;

/// An arm of Elite's EC series (EC63, EC66, EC612) in remote mode.
#[derive(Debug)]
pub struct EliteArm {
    watch: Watch,
    control: JsonRpc,
}

impl EliteArm {
    /// Connects to a controller. The arm stays where it is.
    ///
    /// # Errors
    /// If one of the two ports does not answer as it should.
    pub fn connect(addresses: EliteAddresses, limits: TimeLimits) -> Result<EliteArm, ArmError> {
        let mut control = JsonRpc::connect(&addresses.control, limits)?;
        // Whoever answers this speaks the protocol.
        control.call("getRobotState", json!({}))?;
        let link = Link::connect(&addresses.monitor, "monitor", &limits)?;
        let feed = Feed::start(link, move |link| {
            let packet = link.take("state", limits.silence, monitor::packet_length)?;
            monitor::state(&packet).ok_or_else(|| link.fault("a packet that holds no state".to_owned()))
        })?;
        Ok(EliteArm { watch: Watch { address: addresses.control, limits, feed }, control })
    }

    /// Calls a method that answers whether it was done.
    fn order(&mut self, method: &str, parameters: Value) -> Result<(), ArmError> {
        match self.control.call(method, parameters)? {
            Value::Bool(true) => Ok(()),
            answer => Err(ArmError::Refused {
                address: self.watch.address.clone(),
                request: method.to_owned(),
                answer: format!("it answered {answer}; see the pendant for the alarm"),
            }),
        }
    }
}

impl Controller for EliteArm {
    fn watched(&self) -> &Watch {
        &self.watch
    }

    fn state_now(&mut self) -> Result<ArmState, ArmError> {
        Ok(self.watch.newest()?.1)
    }

    fn begin(&mut self, motion: &PlannedMotion) -> Result<(), ArmError> {
        // Eight axes: two external ones, which are not there.
        let mut target = motion.to().map(f64::to_degrees).to_vec();
        target.extend([0.0, 0.0]);
        let percent = 100.0 * motion.speed().speed / FULL_SPEED;
        if percent < LEAST {
            let slowest = FULL_SPEED * LEAST / 100.0;
            return Err(ArmError::Refused {
                address: self.watch.address.clone(),
                request: "moveByJoint".to_owned(),
                answer: format!("it cannot go slower than {slowest:.4} rad/s; plan a faster motion"),
            });
        }
        self.order("moveByJoint", json!({"targetPos": target, "speed": percent}))
    }

    fn watch(&mut self) -> Result<(), ArmError> {
        // The monitor tells all.
        Ok(())
    }

    fn order_stop(&mut self) -> Result<(), ArmError> {
        if self.order("stop", json!({})).is_ok() {
            return Ok(());
        }
        // The connection may be what is wrong.
        self.control = JsonRpc::connect(&self.watch.address, self.watch.limits)?;
        self.order("stop", json!({}))
    }
}
