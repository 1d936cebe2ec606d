//! The official ReNe folder: `lset000/ … /{camera.yml, light.txt, data/00000_image.png, data/00000_pose.txt, …}`.
//!
//! A folder `lsetNNN` is a light; inside, a number is a camera. Poses are to-world 4x4 matrices in metres, camera axes
//! OpenCV's. `camera.yml` and the camera poses are the same in all folders, since the robots repeat their paths. Images
//! may be JPEG or WebP in place of PNG. A frame is an image and its pose: if both are missing the frame is left out.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use rayon::prelude::*;

use super::Found;
use super::camera_file;
use super::lenses;
use super::pose_file;
use crate::camera::{Camera, Intrinsics};
use crate::error::{FaultKind, Faults};
use crate::files;
use crate::frame::Frame;
use crate::image_file::EXTENSIONS;
use crate::light::Light;
use crate::pose::Pose;
use crate::scene::{Layout, Scene};

/// Poses of one camera in two folders that differ by no more than this, metres or entries of the rotation, are one
/// pose: cameras come back to within 0.03 mm.
const SAME_POSE: f64 = 1e-3;

/// The file that places a folder's light.
const LIGHT: &str = "light.txt";

type Entries = [(String, PathBuf)];

/// What one `lsetNNN` folder holds.
struct LightFolder {
    label: usize,
    path: PathBuf,
    light: Option<Pose>,
    intrinsics: Option<Intrinsics>,
    images: BTreeMap<usize, PathBuf>,
    poses: BTreeMap<usize, (PathBuf, Option<Pose>)>,
    faults: Faults,
}

/// The number in `lsetNNN`.
pub(super) fn light_number(name: &str) -> Option<usize> {
    name.strip_prefix("lset").and_then(number)
}

fn number(digits: &str) -> Option<usize> {
    digits.bytes().all(|byte| byte.is_ascii_digit()).then(|| digits.parse().ok())?
}

/// Reads the folder, given its entries.
pub(super) fn read(root: &Path, entries: &Entries, faults: &mut Faults) -> Option<Found> {
    let mut numbered = BTreeMap::new();
    for (name, path) in entries {
        match light_number(name) {
            Some(label) => {
                if let Some(other) = numbered.insert(label, path.clone()) {
                    let problem = format!("has the same light number as {}", other.display());
                    faults.error(FaultKind::Extra, path, problem, "Rename or remove one of the two.");
                }
            }
            None if path.is_dir() => {
                faults.note(FaultKind::Extra, path, "is no part of a ReNe scene and is not read", "");
            }
            None => {}
        }
    }
    let mut folders: Vec<LightFolder> =
        numbered.into_par_iter().map(|(label, path)| read_light(label, path)).collect();
    for folder in &mut folders {
        faults.0.append(&mut folder.faults.0);
    }
    assemble(root, &folders, faults)
}

fn read_light(label: usize, path: PathBuf) -> LightFolder {
    let mut faults = Faults::default();
    let light = faults.keep(pose_file::read(&path.join(LIGHT)));
    let intrinsics = faults.keep(camera_file::read(&path.join("camera.yml")));
    let mut folder = LightFolder {
        label,
        light,
        intrinsics,
        images: BTreeMap::new(),
        poses: BTreeMap::new(),
        faults: Faults::default(),
        path,
    };
    let data = folder.path.join("data");
    for (name, path) in faults.keep(files::list(&data)).unwrap_or_default() {
        folder.sort_in(&name, path, &mut faults);
    }
    for (name, path) in faults.keep(files::list(&folder.path)).unwrap_or_default() {
        if !["camera.yml", LIGHT, "data"].contains(&name.as_str()) {
            faults.note(FaultKind::Extra, &path, "is no part of a ReNe scene and is not read", "");
        }
    }
    folder.faults = faults;
    folder
}

impl LightFolder {
    /// Files an entry of `data` under its camera.
    fn sort_in(&mut self, name: &str, path: PathBuf, faults: &mut Faults) {
        let stem_and_extension = name.rsplit_once('.');
        let (stem, extension) = stem_and_extension.unwrap_or((name, ""));
        let extension = extension.to_ascii_lowercase();
        if let Some(camera) = stem.strip_suffix("_image").and_then(number)
            && EXTENSIONS.contains(&extension.as_str())
        {
            if let Some(other) = self.images.insert(camera, path.clone()) {
                let problem = format!("is a second image of the same view, beside {}", other.display());
                faults.error(FaultKind::Extra, &path, problem, "Remove one of the two.");
            }
        } else if let Some(camera) = stem.strip_suffix("_pose").and_then(number)
            && extension == "txt"
        {
            let pose = faults.keep(pose_file::read(&path));
            if let Some((other, _)) = self.poses.insert(camera, (path.clone(), pose)) {
                let problem = format!("is a second pose of the same view, beside {}", other.display());
                faults.error(FaultKind::Extra, &path, problem, "Remove one of the two.");
            }
        } else {
            faults.warning(
                FaultKind::Extra,
                &path,
                "is neither an image nor a pose of a ReNe scene and is not read",
                "Images are named like 00013_image.png (or .jpg, .jpeg, .webp), poses like 00013_pose.txt.",
            );
        }
    }

    fn data_path(&self, camera: usize, file: &str) -> PathBuf {
        self.path.join("data").join(format!("{camera:05}_{file}"))
    }
}

fn assemble(root: &Path, folders: &[LightFolder], faults: &mut Faults) -> Option<Found> {
    let intrinsics = common_intrinsics(folders, faults);
    let poses = common_poses(folders, faults);
    check_frames(folders, &poses, faults);
    check_numbers(root, "lights", folders.iter().map(|folder| folder.label), faults);
    check_numbers(root, "views", poses.keys().copied(), faults);
    if poses.is_empty() {
        faults.error(
            FaultKind::Missing,
            root,
            "holds no camera pose that can be used",
            "Every lset folder needs data/00000_image.png, data/00000_pose.txt and so on.",
        );
    }
    let intrinsics = intrinsics?;
    let cameras: Vec<Camera> = poses
        .iter()
        .map(|(&label, &(_, pose))| Camera { label, intrinsics: intrinsics.clone(), pose })
        .collect();
    let index: BTreeMap<usize, usize> =
        poses.keys().enumerate().map(|(index, &label)| (label, index)).collect();
    let mut lights = Vec::new();
    let mut light_files = Vec::new();
    let mut frames = Vec::new();
    for folder in folders {
        let Some(pose) = folder.light else { continue };
        for (label, path) in &folder.images {
            if let Some(&camera) = index.get(label) {
                frames.push(Frame { camera, light: lights.len(), path: path.clone() });
            }
        }
        lights.push(Light { label: folder.label, pose });
        light_files.push(folder.path.join(LIGHT));
    }
    if frames.is_empty() {
        faults.error(
            FaultKind::Missing,
            root,
            "holds no image with a pose and a light",
            "Check the download.",
        );
        return None;
    }
    let name = super::name_of(root);
    let scene =
        Scene { name, root: root.to_owned(), layout: Layout::Rene, cameras, lights, frames, declared: None };
    let camera_files = poses.values().map(|(path, _)| path.to_path_buf()).collect();
    Some(Found { scene, camera_files, light_files })
}

/// Numbers left out: a light or a view that was not fetched, perhaps.
fn check_numbers(
    root: &Path,
    what: &str,
    labels: impl ExactSizeIterator<Item = usize> + Clone,
    faults: &mut Faults,
) {
    let Some(last) = labels.clone().last() else { return };
    let gaps = last - (labels.len() - 1);
    if gaps > 0 {
        let first = labels
            .enumerate()
            .find(|(expected, label)| expected != label)
            .map_or(0, |(expected, _)| expected);
        let problem = format!("{gaps} of the {what} 0 to {last} are missing, the first of them {first}");
        let mend = "Fetch them if they exist: the official scenes have 50 views and 40 lights.";
        faults.warning(FaultKind::Missing, root, problem, mend);
    }
}

/// The lens that all folders state.
fn common_intrinsics(folders: &[LightFolder], faults: &mut Faults) -> Option<Intrinsics> {
    let mut stated = folders.iter().filter_map(|folder| Some((folder, folder.intrinsics.as_ref()?)));
    let (first, intrinsics) = stated.next()?;
    for (folder, other) in stated {
        if other != intrinsics {
            let problem = format!("differs from {}", first.path.join("camera.yml").display());
            let mend = "All folders of a scene hold the same camera.yml: copy the right one to all.";
            faults.error(FaultKind::Inconsistent, &folder.path.join("camera.yml"), problem, mend);
        }
    }
    for (problem, mend) in lenses::odd(intrinsics) {
        faults.warning(FaultKind::Lens, &first.path.join("camera.yml"), problem, mend);
    }
    Some(intrinsics.clone())
}

/// Each camera's pose, as its first folder has it.
fn common_poses<'a>(folders: &'a [LightFolder], faults: &mut Faults) -> BTreeMap<usize, (&'a Path, Pose)> {
    let mut poses: BTreeMap<usize, (&Path, Pose)> = BTreeMap::new();
    for folder in folders {
        for (&label, (path, pose)) in &folder.poses {
            let Some(pose) = *pose else { continue };
            let &mut (first, known) = poses.entry(label).or_insert((path, pose));
            let largest = pose.difference(&known);
            let problem = format!("differs from {} by up to {largest:.2e}", first.display());
            if largest > SAME_POSE {
                let mend = "A camera stands at the same place under all lights: copy the right pose to all folders, or \
                            number views from other places apart.";
                faults.error(FaultKind::Inconsistent, path, problem, mend);
            } else if largest > 0.0 {
                let problem = format!("{problem}; the pose of the first folder is used for all lights");
                faults.note(FaultKind::Inconsistent, path, problem, "");
            }
        }
    }
    poses
}

/// Missing halves of frames, and frames missing whole.
fn check_frames(folders: &[LightFolder], cameras: &BTreeMap<usize, (&Path, Pose)>, faults: &mut Faults) {
    for folder in folders {
        for &camera in folder.images.keys().filter(|camera| !folder.poses.contains_key(camera)) {
            let mend = "Fetch it again, or remove the image to leave this frame out.";
            let path = folder.data_path(camera, "pose.txt");
            faults.error(FaultKind::Missing, &path, "is missing, but its image is there", mend);
        }
        for &camera in folder.poses.keys().filter(|camera| !folder.images.contains_key(camera)) {
            let mend = "Fetch it again, or remove the pose to leave this frame out.";
            let path = folder.data_path(camera, "image.png");
            faults.error(FaultKind::Missing, &path, "is missing, but its pose is there", mend);
        }
        let absent =
            |camera: &&usize| !folder.images.contains_key(camera) && !folder.poses.contains_key(camera);
        let missing: Vec<usize> = cameras.keys().filter(absent).copied().collect();
        if let (Some(&first), Some(&last)) = (missing.first(), missing.last()) {
            let problem = match missing.len() {
                1 => format!("the scene's view {first} is missing here"),
                several => format!("{several} of the scene's views are missing here, {first} to {last}"),
            };
            let mend = "Fetch them again; without them these frames are left out.";
            faults.warning(FaultKind::Missing, &folder.path.join("data"), problem, mend);
        }
    }
}
