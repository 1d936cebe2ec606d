//! The world box that a field covers.

use serde::{Deserialize, Serialize};

use crate::camera::{Camera, Intrinsics};
use crate::focus::{Sight, focus};
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
    let distances = |points: Vec<Vector>| median(points.iter().map(|&p| norm(sub(p, focus))).collect());
    let mut reach = distances(scene.cameras.iter().map(|camera| camera.pose.position()).collect());
    if reach < 1e-6 {
        reach = distances(scene.lights.iter().map(|light| light.pose.position()).collect()).max(1e-3);
    }
    let views: Vec<Vector> = scene.cameras.iter().map(|camera| Sight::of(camera).direction).collect();
    let centre = add(focus, scale(mean(&views), BEHIND * reach));
    let half = reach * framed(&scene.cameras, centre, reach).clamp(SMALLEST, LARGEST);
    Bounds { lo: centre.map(|c| (c - half) as f32), hi: centre.map(|c| (c + half) as f32) }
}

/// Half the side of the smallest cube about `centre` that holds all places framed by enough cameras, as a share of
/// `reach`; places beyond the largest box are not looked at.
fn framed(cameras: &[Camera], centre: Vector, reach: f64) -> f64 {
    let every = cameras.len().div_ceil(WITNESSES).max(1);
    // Without distortion: far outside its image a distortion model may fold back in.
    let witnesses: Vec<(Intrinsics, &Camera)> = cameras
        .iter()
        .step_by(every)
        .map(|camera| (Intrinsics { distortion: Vec::new(), ..camera.intrinsics.clone() }, camera))
        .collect();
    let needed = (SEEN_BY * witnesses.len() as f64).ceil().max(1.0) as usize;
    let sees = |(lens, camera): &(Intrinsics, &Camera), place: Vector| {
        lens.project(camera.pose.inverse_transform(place)).is_some_and(|[u, v]| {
            (-0.5..f64::from(lens.width) - 0.5).contains(&u)
                && (-0.5..f64::from(lens.height) - 0.5).contains(&v)
        })
    };
    let pitch = LARGEST / f64::from(STEPS);
    let mut shells = 0;
    for i in -STEPS..=STEPS {
        for j in -STEPS..=STEPS {
            for k in -STEPS..=STEPS {
                let shell = i.abs().max(j.abs()).max(k.abs());
                let offset = [i, j, k].map(|n| f64::from(n) * pitch * reach);
                let place = std::array::from_fn(|axis| centre[axis] + offset[axis]);
                if shell > shells && witnesses.iter().filter(|w| sees(w, place)).count() >= needed {
                    shells = shell;
                }
            }
        }
    }
    f64::from(shells + 1) * pitch
}
