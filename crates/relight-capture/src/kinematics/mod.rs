//! Forward and inverse kinematics of six-axis arms with an offset wrist, their limits and collisions.
//!
//! An [`ArmModel`] knows where its links are for given [`Joints`] and, in closed form, which joints bring its flange to a
//! pose. A [`Tool`] says where camera or light sits on the flange. A [`Cell`] holds the arms of a rig, the table, the
//! object and walls, and tells whether a motion keeps its distance all the way. A [`Route`] picks one configuration for each
//! waypoint so that the joints travel little and nothing meets.
//!
//! Joint angles are the controller's own, in radians. The flange is the vendor's (`tool0`), its +Z pointing out of it.

mod arm_model;
mod bodies;
mod cell;
mod inverse;
mod limits;
mod motion;
mod reach;
mod rigid;
mod route;
mod shapes;
mod tool;

pub use arm_model::{ArmModel, EC66, LINK_NAMES, UR5E};
pub use cell::{Arm, Cell, CellError, Contact, Part};
pub use inverse::Unreachable;
pub use limits::{JointLimits, LimitFault};
pub use motion::Obstruction;
pub use reach::{ArmPlace, ArmsSettings, Make};
pub use route::{Outcome, Route, RouteError, Unreached};
pub use shapes::Capsule;
pub use tool::Tool;

/// The six joint angles of an arm, radians, as its controller counts them; base first.
pub type Joints = [f64; 6];
