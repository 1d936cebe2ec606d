//! Robot arms: what a session asks of one, drivers for two makes, and simulated controllers to test against.
//!
//! A session speaks to an [`Arm`] and hands it a [`PlannedMotion`], which only a [`MotionPlan`] makes: no driver has a
//! way to go anywhere else. [`UrArm`] drives Universal Robots' arms (RTDE, script and dashboard), [`EliteArm`] those of
//! Elite's EC series (JSON-RPC and monitor), [`DryRun`] drives nothing and keeps a record. All speak plain TCP, every
//! wait has a limit, and whatever stops a motion (protective stop, emergency stop, a lost link, an arm taken out of
//! remote control) comes back as an [`ArmError`] after the arm was told to stop.
//!
//! [`SimulatedController`] stands in for a real controller on the same ports, well enough for the makers' own clients.
//!
//! Joints are in radians, as the controller counts them: zeros and signs are the maker's.

mod addresses;
mod arm;
mod dry_run;
mod elite;
mod error;
mod feed;
mod following;
#[cfg(test)]
mod golden;
mod link;
mod planned_motion;
pub mod simulated;
mod trapezoid;
mod ur;

pub use addresses::{AddressFault, EliteAddresses, UrAddresses};
pub(crate) use arm::largest_difference;
pub use arm::{Arm, ArmState, ArmStatus, Joints};
pub use dry_run::DryRun;
pub use elite::EliteArm;
pub use error::ArmError;
pub use link::TimeLimits;
pub use planned_motion::{JointSpeed, MotionPlan, PlanFault, PlannedMotion};
pub use simulated::SimulatedController;
pub use ur::UrArm;
