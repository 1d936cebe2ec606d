//! Whether poses follow the conventions that they should: to-world, OpenCV's camera axes, metres.
//!
//! A capture looks at one thing. If the rays through the images' middles meet ahead of the cameras once the poses are
//! inverted, or their axes flipped, and not as they stand, then inverted or flipped is what they are.

use std::path::PathBuf;

use crate::camera::Camera;
use crate::error::{FaultKind, Faults};
use crate::focus::{Sight, focus, nearest_point};
use crate::pose::Pose;
use crate::scene::{Layout, Scene};
use crate::vector::{Vector, angle, mean, median, norm, sub};

/// Fewer cameras or lights than this tell nothing.
const FEW: usize = 3;
/// Poses whose axis misses the focus by less, radians, look at it.
const ON_TARGET: f64 = 0.35;
/// Poses whose axis misses it by more do not.
const OFF_TARGET: f64 = 0.6;
/// Farther than this from camera to scene, metres, and the unit is likely not the metre.
const FAR: f64 = 50.0;
/// Farther than this many times what the others measure, and the unit differs.
const FARTHER: f64 = 50.0;
/// Nearer to the focus than this share of the cameras' distance, a light stands in the scene.
const INSIDE: f64 = 0.2;

const CAMERA_MEND: &str =
    "Camera poses are camera-to-world matrices in metres, with OpenCV's axes (+X right, +Y down, +Z forward)";

/// How a pose might have been meant.
#[derive(Clone, Copy, PartialEq)]
enum Reading {
    AsIs,
    Flipped,
    Inverted,
    InvertedFlipped,
}

impl Reading {
    const OTHERS: [Reading; 3] = [Reading::Flipped, Reading::Inverted, Reading::InvertedFlipped];

    fn apply(self, pose: &Pose) -> Pose {
        match self {
            Reading::AsIs => *pose,
            Reading::Flipped => pose.flip_camera_axes(),
            Reading::Inverted => pose.inverse(),
            // A world-to-camera matrix of OpenGL's axes has its rows flipped.
            Reading::InvertedFlipped => pose.inverse().flip_camera_axes(),
        }
    }

    /// What poses that must be read so look like, and the mend.
    fn words(self) -> (&'static str, &'static str) {
        match self {
            Reading::AsIs => ("as they should be", ""),
            Reading::Flipped => {
                ("of OpenGL's axes (+Y up, looking along -Z)", "negate the second and third column")
            }
            Reading::Inverted => ("world-to-camera", "invert it"),
            Reading::InvertedFlipped => {
                ("world-to-camera of OpenGL's axes", "invert it, then negate the second and third column")
            }
        }
    }
}

/// Adds what looks wrong about a scene's poses to the faults.
pub(crate) fn check(scene: &Scene, faults: &mut Faults) {
    let target = focus(&scene.cameras, &scene.lights);
    if check_all_cameras(scene, faults) {
        check_each_camera(scene, target, faults);
        if scene.layout == Layout::Rene {
            check_lights(scene, target, faults);
        }
    }
}

/// How well a set of sights meets.
struct Meeting {
    /// Median angle between a sight and the way to the point where all meet, radians.
    miss: f64,
    /// Median distance of the positions from their mean.
    spread: f64,
}

fn meeting(cameras: &[Camera], reading: Reading) -> Meeting {
    let read = |camera: &Camera| Sight::of(&Camera { pose: reading.apply(&camera.pose), ..camera.clone() });
    let sights: Vec<Sight> = cameras.iter().map(read).collect();
    let middle = mean(&sights.iter().map(|sight| sight.origin).collect::<Vec<_>>());
    let point = nearest_point(&sights, middle);
    Meeting {
        miss: median(sights.iter().map(|sight| miss(sight, point)).collect()),
        spread: median(sights.iter().map(|sight| norm(sub(sight.origin, middle))).collect()),
    }
}

fn miss(sight: &Sight, point: Vector) -> f64 {
    angle(sight.direction, sub(point, sight.origin))
}

/// Whether the cameras as a whole follow the conventions, as far as can be told.
fn check_all_cameras(scene: &Scene, faults: &mut Faults) -> bool {
    if scene.cameras.len() < FEW {
        return true;
    }
    let as_is = meeting(&scene.cameras, Reading::AsIs);
    for reading in Reading::OTHERS {
        let other = meeting(&scene.cameras, reading);
        // Inverting good poses puts the cameras on a heap, where their axes may well meet.
        let unfolds = reading == Reading::Flipped || other.spread > 2.0 * as_is.spread;
        if other.miss < ON_TARGET && 3.0 * other.miss < as_is.miss && unfolds {
            let (kind, cure) = reading.words();
            let problem =
                format!("the camera poses look {kind}: only so do the cameras look at a common point");
            let mend = format!(
                "{CAMERA_MEND}: {}.",
                cure.replace("it,", "each,").replace("invert it", "invert each")
            );
            // Cameras that look outward, from inside a room, also look away from their common point; but upright.
            let ups = scene.cameras.iter().filter(|camera| camera.pose.axis(1)[2] <= 0.0).count();
            let path = pose_path(scene, 0);
            if reading == Reading::Flipped && 2 * ups > scene.cameras.len() {
                faults.warning(
                    FaultKind::Convention,
                    &path,
                    "the cameras look away from their common point",
                    &mend,
                );
                return true;
            }
            faults.error(FaultKind::Convention, &path, problem, &mend);
            return false;
        }
    }
    true
}

/// Cameras that differ from the others.
fn check_each_camera(scene: &Scene, target: Vector, faults: &mut Faults) {
    let distance = |pose: &Pose| norm(sub(target, pose.position()));
    let usual = median(scene.cameras.iter().map(|camera| distance(&camera.pose)).collect());
    if usual > FAR {
        let problem =
            format!("the cameras stand {usual:.0} m from what they look at: the poses look like millimetres");
        let mend = "Poses are in metres: divide all translations, the lights' too, by 1000.";
        faults.warning(FaultKind::Convention, &pose_path(scene, 0), problem, mend);
    }
    if scene.cameras.len() < FEW {
        return;
    }
    for (index, camera) in scene.cameras.iter().enumerate() {
        let path = || pose_path(scene, index);
        if distance(&camera.pose) > FARTHER * usual {
            let problem = format!(
                "the camera stands {:.3} m from the scene, the others about {usual:.3} m",
                distance(&camera.pose)
            );
            let mend = "Poses are in metres: this one looks like millimetres.";
            faults.error(FaultKind::Convention, &path(), problem, mend);
            continue;
        }
        let off = |pose: Pose| miss(&Sight::of(&Camera { pose, ..camera.clone() }), target);
        let as_is = off(camera.pose);
        if as_is < OFF_TARGET {
            continue;
        }
        let meant = Reading::OTHERS.into_iter().find(|reading| {
            let pose = reading.apply(&camera.pose);
            off(pose) < ON_TARGET && (0.5..2.0).contains(&(distance(&pose) / usual))
        });
        let degrees = as_is.to_degrees();
        if let Some(reading) = meant {
            let (kind, cure) = reading.words();
            let problem = format!("the camera looks {degrees:.0} degrees away from what all others look at");
            let mend = format!("{CAMERA_MEND}; this one looks {kind}: {cure}.");
            faults.error(FaultKind::Convention, &path(), problem, &mend);
        } else {
            let problem = format!("the camera looks {degrees:.0} degrees away from what the others look at");
            let mend = format!("{CAMERA_MEND}: check this one, unless it is meant.");
            faults.warning(FaultKind::Convention, &path(), problem, &mend);
        }
    }
}

/// The file that states a camera's pose.
fn pose_path(scene: &Scene, camera: usize) -> PathBuf {
    let Some(frame) = scene.frames.iter().find(|frame| frame.camera == camera) else {
        return scene.root.clone();
    };
    match scene.layout {
        Layout::Rene => frame.path.with_file_name(format!("{:05}_pose.txt", scene.cameras[camera].label)),
        Layout::Transforms => frame.path.clone(),
    }
}

/// The file that states a light's pose.
fn light_path(scene: &Scene, light: usize) -> PathBuf {
    let frame = scene.frames.iter().find(|frame| frame.light == light);
    let folder = frame.and_then(|frame| frame.path.parent()?.parent());
    folder.map_or_else(|| scene.root.clone(), |folder| folder.join("light.txt"))
}

fn check_lights(scene: &Scene, target: Vector, faults: &mut Faults) {
    let off = |pose: &Pose| angle(pose.axis(2), sub(target, pose.position()));
    let distance = |pose: &Pose| norm(sub(target, pose.position()));
    let poses: Vec<Pose> = scene.lights.iter().map(|light| light.pose).collect();
    let inverted: Vec<Pose> = poses.iter().map(Pose::inverse).collect();
    let of = |poses: &[Pose], measure: &dyn Fn(&Pose) -> f64| median(poses.iter().map(measure).collect());
    let cameras = median(scene.cameras.iter().map(|camera| distance(&camera.pose)).collect());
    let spread = |poses: &[Pose]| {
        let middle = mean(&poses.iter().map(Pose::position).collect::<Vec<_>>());
        of(poses, &|pose| norm(sub(pose.position(), middle)))
    };
    const MEND: &str =
        "Light poses are light-to-world matrices in metres; the light stands at the last column";
    let (usual, aimed) = (of(&poses, &distance), of(&poses, &off));
    if poses.len() >= FEW
        && aimed > OFF_TARGET
        && of(&inverted, &off) < ON_TARGET
        && spread(&inverted) > 2.0 * spread(&poses)
    {
        let problem =
            "the light poses look like world-to-light matrices: only so do the lights look at the scene";
        faults.error(FaultKind::Convention, &light_path(scene, 0), problem, &format!("{MEND}: invert each."));
        return;
    }
    for (index, pose) in poses.iter().enumerate() {
        let path = light_path(scene, index);
        let is_odd = poses.len() >= FEW && aimed < ON_TARGET && off(pose) > OFF_TARGET;
        if distance(pose) > FARTHER * cameras.max(1e-9) {
            let problem = format!(
                "the light stands {:.1} m from the scene, the cameras {cameras:.2} m",
                distance(pose)
            );
            faults.error(
                FaultKind::Convention,
                &path,
                problem,
                &format!("{MEND}; this one looks like millimetres."),
            );
        } else if is_odd
            && off(&inverted[index]) < ON_TARGET
            && (0.5..2.0).contains(&(distance(&inverted[index]) / usual))
        {
            let problem = "the light looks away from the scene, at which all others look";
            let mend = format!("{MEND}; this one looks like world-to-light: invert it.");
            faults.error(FaultKind::Convention, &path, problem, &mend);
        } else if distance(pose) < INSIDE * cameras {
            let problem =
                format!("the light stands {:.3} m from the middle of the scene, inside it", distance(pose));
            faults.warning(FaultKind::Placement, &path, problem, &format!("{MEND}: check this one."));
        } else if pose.position()[2] < 0.0 {
            let problem = format!("the light stands {:.3} m below the floor (z = 0)", -pose.position()[2]);
            faults.warning(
                FaultKind::Placement,
                &path,
                problem,
                &format!("{MEND}; the world's +Z is up: check this one."),
            );
        }
    }
}
