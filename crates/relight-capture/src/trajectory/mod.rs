//! Waypoints on equal-area cells of a spherical region, looking at the object.
//!
//! A [`Region`] of the sphere is parted into cells of equal area ([`Partition`]); a [`Dome`] sets a waypoint over the
//! middle of each; a [`Trajectory`] visits them with little travel; a [`Plan`] holds those of the camera and of the light
//! as a file, and [`picture()`] draws it.
//!
//! Spherical coordinates: colatitude from +Z down (0 at the zenith, pi at the nadir), azimuth from +X towards +Y.

mod dome;
mod partition;
mod picture;
mod plan;
mod region;
mod rings;
mod settings;
mod visit;

pub use dome::{Dome, DomeFault, MAX_WAYPOINTS};
pub use partition::{Cell, MAX_CELLS, Partition, PartitionError};
pub use picture::{Reach, picture};
pub use plan::{ObjectBox, PLAN_FORMAT, Plan, PlanError, Trajectory, Waypoint};
pub use region::{Degrees, Region, RegionFault};
pub use settings::{ArmSettings, PlanSettings};

#[cfg(test)]
mod tests;
