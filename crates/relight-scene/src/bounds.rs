//! The world box that a field covers.

use serde::{Deserialize, Serialize};

use crate::camera::{Camera, Intrinsics};
use crate::focus::{Sight, focus};
use crate::pose::Pose;
use crate::scene::Scene;
use crate::vector::{Vector, add, mean, median, norm, scale, sub};

/// Half the box's side, at most, as a share of the median distance from camera to focus.
const LARGEST: f64 = 0.75;
/// And at least.
const SMALLEST: f64 = 0.3;
/// Its centre lies behind the focus by this share of that distance, where all cameras look the same way.
const BEHIND: f64 = 0.15;
/// A place belongs to the scene if this share of the cameras frame it.
const SEEN_BY: f64 = 0.5;
/// Cameras asked, at most.
const WITNESSES: usize = 64;
/// Grid of places from the focus outward, a half axis.
const STEPS: i32 = 12;

/// The longest edge of a box that somebody names, as shares of that distance: at least, at most.
const LONGEST_EDGE: [f64; 2] = [0.01, 100.0];
/// And its shortest, at least.
const SHORTEST_EDGE: f64 = 0.001;
/// Places a box is looked at, an axis.
const PLACES: u32 = 9;

/// An axis-aligned box in the world frame, metres.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Bounds {
    /// Lowest corner.
    pub lo: [f32; 3],
    /// Highest corner.
    pub hi: [f32; 3],
}

impl Bounds {
    /// Length of the longest edge, metres.
    pub fn longest_edge(&self) -> f32 {
        (0..3).map(|a| self.hi[a] - self.lo[a]).fold(0.0, f32::max)
    }
}

/// Why a box cannot be that of a field.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum BoundsFault {
    /// A corner is not finite, or the low one is not below the high one.
    #[error("it is no box: each number of its low corner must be below that of the high one")]
    NoBox,
    /// Nothing would fit in.
    #[error("an edge of {edge:e} m is too short where cameras stand {reach:.3} m from what they look at")]
    TooSmall {
        /// Its edge, metres.
        edge: f64,
        /// The cameras' distance, metres.
        reach: f64,
    },
    /// What the cameras see would be lost in it.
    #[error("an edge of {edge:e} m is too long where cameras stand {reach:.3} m from what they look at")]
    TooLarge {
        /// Its edge, metres.
        edge: f64,
        /// The cameras' distance, metres.
        reach: f64,
    },
    /// It lies where no camera looks.
    #[error("no camera sees anything of it")]
    Unseen,
}

/// Whether a box that somebody names can be that of a field of this scene.
///
/// # Errors
/// If its longest edge is not between a hundredth and a hundred times the cameras' distance from what they look at, its
/// shortest is below a thousandth of that, or no camera sees it.
pub fn check_bounds(scene: &Scene, bounds: &Bounds) -> Result<(), BoundsFault> {
    let focus = focus(&scene.cameras, &scene.lights);
    let reach = reach(scene, focus);
    let (lo, hi) = (bounds.lo.map(f64::from), bounds.hi.map(f64::from));
    let edges: Vector = std::array::from_fn(|axis| hi[axis] - lo[axis]);
    if !edges.iter().all(|&edge| edge > 0.0 && edge.is_finite()) {
        return Err(BoundsFault::NoBox);
    }
    let shortest = edges.into_iter().fold(f64::INFINITY, f64::min);
    let longest = edges.into_iter().fold(0.0, f64::max);
    if longest > LONGEST_EDGE[1] * reach {
        return Err(BoundsFault::TooLarge { edge: longest, reach });
    }
    if longest < LONGEST_EDGE[0] * reach {
        return Err(BoundsFault::TooSmall { edge: longest, reach });
    }
    if shortest < SHORTEST_EDGE * reach {
        return Err(BoundsFault::TooSmall { edge: shortest, reach });
    }
    let holds_focus = (0..3).all(|axis| (lo[axis]..hi[axis]).contains(&focus[axis]));
    let witnesses = witnesses(&scene.cameras);
    let mut places = (0..PLACES.pow(3)).map(|n| {
        let steps = [n % PLACES, n / PLACES % PLACES, n / PLACES.pow(2)];
        std::array::from_fn(|axis| lo[axis] + edges[axis] * f64::from(steps[axis]) / f64::from(PLACES - 1))
    });
    if holds_focus || places.any(|place| witnesses.iter().any(|witness| witness.sees(place))) {
        Ok(())
    } else {
        Err(BoundsFault::Unseen)
    }
}

/// A cubic box found from cameras and lights alone.
///
/// It lies about the focus: the point nearest to the rays through the middles of all images (where those leave it open,
/// as for one camera or parallel ones, the point near the middle of the lights). Where the cameras stand on one side its
/// centre is moved on behind the focus, up to 0.15 times the median distance from camera to focus, since there is more
/// to see there and the cameras should stand outside. It is as small as will hold every place that half of the cameras
/// frame, but its half side is between 0.3 and 0.75 times that distance. Cameras on one side, as in ReNe, all
/// see far behind the focus and give 0.75: at 0.6 m, room for a floor and for walls 0.45 m from the object. Cameras all
/// around give little more than the ball that all of them frame. What lies beyond, an engine paints on the box's faces.
/// Cameras may stand inside near the box's edges; its middle is free of them.
pub fn scene_bounds(scene: &Scene) -> Bounds {
    let focus = focus(&scene.cameras, &scene.lights);
    let reach = reach(scene, focus);
    let views: Vec<Vector> = scene.cameras.iter().map(|camera| Sight::of(camera).direction).collect();
    let centre = add(focus, scale(mean(&views), BEHIND * reach));
    let half = reach * framed(&scene.cameras, centre, reach).clamp(SMALLEST, LARGEST);
    Bounds { lo: centre.map(|c| (c - half) as f32), hi: centre.map(|c| (c + half) as f32) }
}

/// The median distance from the cameras, or the lights where those stand at it, to the focus.
fn reach(scene: &Scene, focus: Vector) -> f64 {
    let distances = |points: Vec<Vector>| median(points.iter().map(|&p| norm(sub(p, focus))).collect());
    let reach = distances(scene.cameras.iter().map(|camera| camera.pose.position()).collect());
    if reach < 1e-6 {
        distances(scene.lights.iter().map(|light| light.pose.position()).collect()).max(1e-3)
    } else {
        reach
    }
}

/// A camera that is asked what it sees.
struct Witness<'a> {
    /// Without distortion: far outside its image a distortion model may fold back in.
    lens: Intrinsics,
    pose: &'a Pose,
}

impl Witness<'_> {
    /// Whether a place of the world is within its image.
    fn sees(&self, place: Vector) -> bool {
        self.lens.project(self.pose.inverse_transform(place)).is_some_and(|[u, v]| {
            (-0.5..f64::from(self.lens.width) - 0.5).contains(&u)
                && (-0.5..f64::from(self.lens.height) - 0.5).contains(&v)
        })
    }
}

/// Some of the cameras, evenly spread over their list.
fn witnesses(cameras: &[Camera]) -> Vec<Witness<'_>> {
    let every = cameras.len().div_ceil(WITNESSES).max(1);
    cameras
        .iter()
        .step_by(every)
        .map(|camera| Witness {
            lens: Intrinsics { distortion: Vec::new(), ..camera.intrinsics.clone() },
            pose: &camera.pose,
        })
        .collect()
}

/// Half the side of the smallest cube about `centre` that holds all places framed by enough cameras, as a share of
/// `reach`; places beyond the largest box are not looked at.
fn framed(cameras: &[Camera], centre: Vector, reach: f64) -> f64 {
    let witnesses = witnesses(cameras);
    let needed = (SEEN_BY * witnesses.len() as f64).ceil().max(1.0) as usize;
    let pitch = LARGEST / f64::from(STEPS);
    let mut shells = 0;
    for i in -STEPS..=STEPS {
        for j in -STEPS..=STEPS {
            for k in -STEPS..=STEPS {
                let shell = i.abs().max(j.abs()).max(k.abs());
                let offset = [i, j, k].map(|n| f64::from(n) * pitch * reach);
                let place = std::array::from_fn(|axis| centre[axis] + offset[axis]);
                if shell > shells && witnesses.iter().filter(|w| w.sees(place)).count() >= needed {
                    shells = shell;
                }
            }
        }
    }
    f64::from(shells + 1) * pitch
}
