//! Waypoints over the cells of a spherical region.

use glam::DVec3;
use relight_scene::Pose;

use super::partition::{Cell, Partition, PartitionError};
use super::plan::Waypoint;
use super::region::{Region, RegionFault};

/// The conjugate of the golden ratio: its multiples, modulo one, fill the unit interval evenly however many are taken.
const GOLDEN: f64 = 0.618_033_988_749_894_9;
/// Most waypoints of an arm: with more, the search for a short way through them takes minutes and the capture weeks.
pub const MAX_WAYPOINTS: usize = 2000;
/// Farthest reach of any rig, metres.
const FARTHEST: f64 = 100.0;

/// Where the waypoints of one arm stand: over the middles of equal-area cells of a region around `centre`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Dome {
    /// The region, its zenith along the world's +Z.
    pub region: Region,
    /// Waypoints, and cells.
    pub cells: usize,
    /// Middle of the sphere, world, metres.
    pub centre: [f64; 3],
    /// Least and greatest distance from the centre, metres; equal for a sphere.
    pub radius: [f64; 2],
    /// What every pose looks at along its +Z, world, metres: the middle of the object.
    pub target: [f64; 3],
    /// Turn of every pose about its +Z, from its +X towards its +Y, radians; without one, +Y is as far down as it can be.
    pub roll: f64,
}

/// Why a dome has no waypoints.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum DomeFault {
    /// A radius that is none.
    #[error(
        "the radius range {0} to {1} m cannot be: give two finite lengths above 0 and at most {FARTHEST} m, the lesser first"
    )]
    Radius(f64, f64),
    /// A centre, target or roll that is not finite or far out.
    #[error("the {0} is not made of finite numbers within {FARTHEST} m")]
    Place(&'static str),
    /// More waypoints than an arm can visit.
    #[error("{0} waypoints are too many: at most {MAX_WAYPOINTS}")]
    TooMany(usize),
    /// A waypoint stands in the middle of what it is to look at.
    #[error("waypoint {0} stands where it should look: move the object's middle inside the dome")]
    NowhereToLook(usize),
    /// The region is none.
    #[error(transparent)]
    Region(#[from] RegionFault),
    /// The region cannot be parted so.
    #[error(transparent)]
    Partition(#[from] PartitionError),
}

impl Dome {
    /// A waypoint over the centre of each cell, labelled in the cells' order. Within a range of radii they take turns
    /// that fill it evenly (multiples of the golden ratio), the same each time.
    ///
    /// # Errors
    /// If the region cannot be parted, or into more than [`MAX_WAYPOINTS`], or a length is not finite or out of range.
    pub fn waypoints(&self) -> Result<Vec<Waypoint>, DomeFault> {
        let [near, far] = self.radius;
        if !(near > 0.0 && near <= far && is_near(DVec3::splat(far))) {
            return Err(DomeFault::Radius(near, far));
        }
        let (centre, target) = (DVec3::from(self.centre), DVec3::from(self.target));
        for (name, place) in [("centre", centre), ("target", target), ("roll", DVec3::splat(self.roll))] {
            if !is_near(place) {
                return Err(DomeFault::Place(name));
            }
        }
        if self.cells > MAX_WAYPOINTS {
            return Err(DomeFault::TooMany(self.cells));
        }
        let partition = Partition::new(&self.region, self.cells)?;
        let waypoint = |(label, &cell): (usize, _)| {
            let radius = near + (far - near) * ((label as f64 + 0.5) * GOLDEN).fract();
            let position = centre + radius * direction(Cell::centre(&cell));
            if position.distance(target) < 1e-6 {
                return Err(DomeFault::NowhereToLook(label));
            }
            let pose = rolled(&Pose::look_at(position.into(), target.into()), self.roll);
            Ok(Waypoint { label, cell, pose, unreachable: None })
        };
        partition.cells.iter().enumerate().map(waypoint).collect()
    }
}

/// Whether a place is made of finite numbers, none beyond any rig.
pub(super) fn is_near(place: DVec3) -> bool {
    place.is_finite() && place.abs().max_element() <= FARTHEST
}

/// The unit vector at a colatitude and azimuth, radians.
pub(super) fn direction([colatitude, azimuth]: [f64; 2]) -> DVec3 {
    let (sine, cosine) = colatitude.sin_cos();
    DVec3::new(sine * azimuth.cos(), sine * azimuth.sin(), cosine)
}

/// A pose turned about its own +Z, from +X towards +Y.
fn rolled(pose: &Pose, roll: f64) -> Pose {
    let (sine, cosine) = roll.sin_cos();
    Pose(pose.0.map(|[x, y, z, t]| [cosine * x + sine * y, cosine * y - sine * x, z, t]))
}
