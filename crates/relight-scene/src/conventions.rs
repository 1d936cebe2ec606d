//! Whether poses follow the conventions that they should: to-world, the camera axes of their layout, metres.
//!
//! A capture looks at one thing. If the rays through the images' middles meet ahead of the cameras once the poses are
//! inverted, or their axes flipped, and not as they stand, then inverted or flipped is what they are.

use std::collections::HashMap;
use std::collections::hash_map::Entry;
use std::path::PathBuf;

use crate::camera::Camera;
use crate::error::{FaultKind, Faults};
use crate::focus::{Sight, focus, nearest_point};
use crate::pose::Pose;
use crate::reading::Reading;
use crate::scene::{Layout, Scene};
use crate::vector::{Vector, angle, mean, median, norm, sub};

/// Fewer cameras or lights than this tell nothing.
const FEW: usize = 3;
/// Poses whose axis misses the focus by less, radians, look at it.
const ON_TARGET: f64 = 0.35;
/// Poses whose axis misses it by more do not.
const OFF_TARGET: f64 = 0.6;
/// Lights that miss it by more, radians, and three times less when inverted, are likely inverted: lights stand high, and
/// inverted ones still look down.
const ASTRAY: f64 = 0.15;
/// Farther than this from camera to scene, metres, and the unit is likely not the metre.
const FAR: f64 = 50.0;
/// Farther than this many times what the others measure, and the unit differs.
const FARTHER: f64 = 50.0;
/// Nearer to the focus than this share of the cameras' distance, a light stands in the scene.
const INSIDE: f64 = 0.2;

/// Cameras that stand no farther apart, metres, meet nowhere.
const AT_ONE_PLACE: f64 = 1e-6;
/// Farther than this from the world's origin, metres, and single precision no longer tells tenths of a millimetre apart.
const REMOTE: f64 = 1000.0;

/// Adds what looks wrong about a scene's poses to the faults. The files are, for each camera and each light, the one that
/// places it.
pub(crate) fn check(scene: &Scene, camera_files: &[PathBuf], light_files: &[PathBuf], faults: &mut Faults) {
    let target = focus(&scene.cameras, &scene.lights);
    if scene.layout == Layout::Rene {
        check_copies("camera", scene.cameras.iter().map(|camera| &camera.pose), camera_files, faults);
        check_copies("light", scene.lights.iter().map(|light| &light.pose), light_files, faults);
    }
    if check_all_cameras(scene, camera_files, faults) {
        let reach = reach(scene, target);
        // In another unit nothing tells how far is far.
        let is_metric = check_unit(reach, camera_files, faults);
        if is_metric {
            check_origin(scene, target, faults);
        }
        check_each_camera(scene, target, camera_files, faults);
        check_lights(scene, target, is_metric.then_some(reach), light_files, faults);
    }
}

/// Poses that are another's to the last bit: a file that was copied.
fn check_copies<'a>(
    what: &str,
    poses: impl Iterator<Item = &'a Pose>,
    files: &[PathBuf],
    faults: &mut Faults,
) {
    let mut seen = HashMap::new();
    for (pose, file) in poses.zip(files) {
        match seen.entry(pose.to_matrix().map(f64::to_bits)) {
            Entry::Vacant(place) => {
                place.insert(file);
            }
            Entry::Occupied(first) => {
                let problem = format!("the {what}'s pose is that of {}", first.get().display());
                let mend =
                    "Two of them never stand at the same place: put the right file in the place of the copy.";
                faults.warning(FaultKind::Inconsistent, file, problem, mend);
            }
        }
    }
}

/// The median distance from the cameras to what they look at.
fn reach(scene: &Scene, target: Vector) -> f64 {
    median(scene.cameras.iter().map(|camera| norm(sub(target, camera.pose.position()))).collect())
}

/// Whether cameras at such a distance from what they look at are likely placed in metres.
fn check_unit(reach: f64, files: &[PathBuf], faults: &mut Faults) -> bool {
    if reach > FAR {
        let problem =
            format!("the cameras stand {reach:.0} m from what they look at: the poses look like millimetres");
        let mend = "Poses are in metres: divide all translations, the lights' too, by 1000.";
        faults.warning(FaultKind::Convention, &files[0], problem, mend);
    }
    reach <= FAR
}

/// Poses in a survey's coordinates.
fn check_origin(scene: &Scene, target: Vector, faults: &mut Faults) {
    let distance = norm(target);
    if distance > REMOTE {
        let step = 1e3 * distance * f64::from(f32::EPSILON);
        let problem = format!(
            "the scene lies {distance:.0} m from the world's origin: positions there lose precision, to steps of {step:.1} mm"
        );
        let mend =
            "Move the world's origin to the scene: take one offset from all camera and light positions.";
        faults.warning(FaultKind::Convention, &scene.root, problem, mend);
    }
}

/// Where and how well some sights meet.
struct Meeting {
    point: Vector,
    /// Median angle between a sight and the way to the point, radians.
    miss: f64,
    /// Median distance of the positions from their mean.
    spread: f64,
}

fn meeting(sights: &[Sight]) -> Meeting {
    let middle = mean(&sights.iter().map(|sight| sight.origin).collect::<Vec<_>>());
    let point = nearest_point(sights, middle);
    Meeting {
        point,
        miss: median(sights.iter().map(|sight| miss(sight, point)).collect()),
        spread: median(sights.iter().map(|sight| norm(sub(sight.origin, middle))).collect()),
    }
}

/// What a camera sees at its image's middle if its file, of the layout that `right` reads, is read otherwise.
fn camera_sight(camera: &Camera, right: Reading, reading: Reading) -> Sight {
    Sight::of(&Camera { pose: reading.pose(&right.matrix(&camera.pose)), ..camera.clone() })
}

fn light_sight(pose: &Pose) -> Sight {
    Sight { origin: pose.position(), direction: pose.axis(2) }
}

fn miss(sight: &Sight, point: Vector) -> f64 {
    angle(sight.direction, sub(point, sight.origin))
}

/// Whether the cameras as a whole follow the conventions, as far as can be told.
fn check_all_cameras(scene: &Scene, files: &[PathBuf], faults: &mut Faults) -> bool {
    if scene.cameras.len() < FEW {
        return true;
    }
    let right = Reading::of(scene.layout);
    let read = |reading| {
        let sights = scene.cameras.iter().map(|camera| camera_sight(camera, right, reading));
        meeting(&sights.collect::<Vec<_>>())
    };
    let as_is = read(right);
    let others = right.others();
    let axes = others[0];
    // Few inverted cameras may seem to meet once their axes are flipped as well, only less well.
    let likelier = others.into_iter().map(|reading| (reading, read(reading))).filter(|(reading, other)| {
        // Inverting good poses puts the cameras on a heap, where their axes may well meet.
        let unfolds = *reading == axes || other.spread > 2.0 * as_is.spread;
        other.miss < ON_TARGET && 3.0 * other.miss < as_is.miss && unfolds && other.spread > AT_ONE_PLACE
    });
    let Some((reading, _)) = likelier.min_by(|(_, a), (_, b)| a.miss.total_cmp(&b.miss)) else { return true };
    let mend = format!("{}; for each of them: {}.", right.rule(), reading.mend(right));
    // Cameras that look outward, from inside a room, also look away from their common point; but upright.
    let ups = scene.cameras.iter().filter(|camera| camera.pose.axis(1)[2] <= 0.0).count();
    if reading == axes && 2 * ups > scene.cameras.len() {
        let problem = "the cameras look away from their common point";
        faults.warning(FaultKind::Convention, &files[0], problem, &mend);
        return true;
    }
    let problem = format!(
        "the camera poses seem to be {}: only so do the cameras look at a common point",
        reading.unlike(right)
    );
    faults.error(FaultKind::Convention, &files[0], problem, &mend);
    false
}

/// Cameras that differ from the others.
fn check_each_camera(scene: &Scene, target: Vector, files: &[PathBuf], faults: &mut Faults) {
    let distance = |pose: &Pose| norm(sub(target, pose.position()));
    let usual = reach(scene, target);
    if scene.cameras.len() < FEW {
        return;
    }
    let right = Reading::of(scene.layout);
    for (index, (camera, path)) in scene.cameras.iter().zip(files).enumerate() {
        let name = || camera_name(scene, index);
        if distance(&camera.pose) > FARTHER * usual {
            let problem = format!(
                "{} stands {:.3} m from the scene, the others about {usual:.3} m",
                name(),
                distance(&camera.pose)
            );
            let mend = "Poses are in metres: this one looks like millimetres.";
            faults.error(FaultKind::Convention, path, problem, mend);
            continue;
        }
        let sight = |reading| camera_sight(camera, right, reading);
        let off = |reading| miss(&sight(reading), target);
        let as_is = off(right);
        if as_is < OFF_TARGET {
            continue;
        }
        let likely = right.others().into_iter().filter(|&reading| {
            let share = norm(sub(target, sight(reading).origin)) / usual;
            off(reading) < ON_TARGET && (0.5..2.0).contains(&share)
        });
        let meant = likely.min_by(|&a, &b| off(a).total_cmp(&off(b)));
        let degrees = as_is.to_degrees();
        if let Some(reading) = meant {
            let problem = format!("{} looks {degrees:.0} degrees away from what all others look at", name());
            let (rule, kind) = (right.rule(), reading.unlike(right));
            let mend = format!("{rule}; this one seems to be {kind}: {}.", reading.mend(right));
            faults.error(FaultKind::Convention, path, problem, &mend);
        } else {
            let problem = format!("{} looks {degrees:.0} degrees away from what the others look at", name());
            let mend = format!("{}: check this one, unless it is meant.", right.rule());
            faults.warning(FaultKind::Convention, path, problem, &mend);
        }
    }
}

/// A camera in words: a file that places one needs no more to say which, another says it by the first frame.
fn camera_name(scene: &Scene, camera: usize) -> String {
    let first = scene.frames.iter().find(|frame| frame.camera == camera);
    match first.filter(|_| scene.layout == Layout::Transforms) {
        Some(frame) => {
            let path = frame.path.strip_prefix(&scene.root).unwrap_or(&frame.path);
            format!("the camera of frame {}", path.display())
        }
        None => "the camera".to_owned(),
    }
}

/// Lights against each other, and against the distance of the cameras where that is known to be in metres.
fn check_lights(scene: &Scene, target: Vector, reach: Option<f64>, files: &[PathBuf], faults: &mut Faults) {
    let is_pose = scene.layout == Layout::Rene;
    let mend_start = if is_pose {
        "Light poses are light-to-world matrices in metres; the light stands at the last column"
    } else {
        "pl_pos is the point light's x, y and z in the world, metres"
    };
    let sights: Vec<Sight> = scene.lights.iter().map(|light| light_sight(&light.pose)).collect();
    let inverted: Vec<Sight> = scene.lights.iter().map(|light| light_sight(&light.pose.inverse())).collect();
    // Lights are compared with what lights look at, which need not be the very point that cameras look at. Where only
    // their positions are stated they have no axes to compare.
    let (as_is, other) = (meeting(&sights), meeting(&inverted));
    let is_enough = is_pose && sights.len() >= FEW;
    if is_enough && as_is.miss > ASTRAY && 3.0 * other.miss < as_is.miss && other.spread > 2.0 * as_is.spread
    {
        let problem =
            "the light poses look like world-to-light matrices: only so do the lights look at a common point";
        let mend = format!("{mend_start}: invert each.");
        faults.error(FaultKind::Convention, &files[0], problem, &mend);
        return;
    }
    for ((sight, inverted), path) in sights.iter().zip(&inverted).zip(files) {
        let distance = norm(sub(target, sight.origin));
        let astray = miss(sight, as_is.point);
        let is_inverted = astray > ASTRAY && astray > 3.0 * miss(inverted, as_is.point);
        // A file that places one light needs no more words to say which.
        let light = if is_pose { "the light".to_owned() } else { format!("the light at {:?}", sight.origin) };
        if let Some(cameras) = reach.filter(|reach| distance > FARTHER * reach.max(1e-9)) {
            let problem =
                format!("{light} stands {distance:.1} m from the scene, the cameras {cameras:.2} m");
            let mend = format!("{mend_start}; this one looks like millimetres.");
            faults.error(FaultKind::Convention, path, problem, &mend);
        } else if is_enough && as_is.miss < ASTRAY && is_inverted {
            let problem = "the light looks away from what all others look at";
            let mend = format!("{mend_start}; this one looks like world-to-light: invert it.");
            faults.error(FaultKind::Convention, path, problem, &mend);
        } else if reach.is_some_and(|reach| distance < INSIDE * reach) {
            let problem = format!("{light} stands {distance:.3} m from the middle of the scene, inside it");
            faults.warning(FaultKind::Placement, path, problem, &format!("{mend_start}: check this one."));
        } else if sight.origin[2] < 0.0 {
            let problem = format!("{light} stands {:.3} m below the floor (z = 0)", -sight.origin[2]);
            let mend = format!("{mend_start}; the world's +Z is up: check this one.");
            faults.warning(FaultKind::Placement, path, problem, &mend);
        }
    }
}
