//! Blender's and nerfstudio's `transforms.json` with a point light a frame, as NRHints and GS3 write it.
//!
//! `{"camera_angle_x": …, "frames": [{"file_path", "transform_matrix", "pl_pos": [x, y, z]}, …]}`, in one file
//! `transforms.json` or in a pair `transforms_train.json` and `transforms_test.json` (and perhaps `transforms_val.json`).
//! The lens is `camera_angle_x` (radians), or `fl_x fl_y cx cy w h k1 k2 k3 p1 p2`, or `camera_intrinsics`
//! `[cx, cy, fx, fy]`; each frame may state its own. Matrices are camera-to-world with OpenGL's camera axes, and
//! principal points count from the image's corner: both are converted. Lights are made to look at the focus.

mod lens;
mod nearby;

use std::collections::{BTreeMap, HashMap, HashSet};
use std::path::{Path, PathBuf};

use serde::Deserialize;

use super::{Found, lenses, pose_file};
use crate::camera::{Camera, Intrinsics};
use crate::error::{FaultKind, Faults, SceneError};
use crate::files;
use crate::focus::focus;
use crate::frame::Frame;
use crate::image_file::{EXTENSIONS, read_size};
use crate::light::Light;
use crate::pose::Pose;
use crate::reading::Reading;
use crate::scene::{Layout, Scene};
use crate::splits::{Split, Splits};
use lens::Lens;
use nearby::{Nearby, ROUNDING};

const LONGEST: u64 = 1 << 26;

/// What a file states. Lenses lie open among the other keys: they are read in passes of their own, since flattening them
/// in would hold all unknown keys in memory.
pub(crate) struct File {
    lens: Lens,
    camera_model: Option<String>,
    frames: Vec<(Lens, Entry)>,
}

/// A file whose frames are read as one kind of thing.
#[derive(Deserialize)]
struct Frames<T> {
    frames: Vec<T>,
}

#[derive(Deserialize)]
struct Model {
    camera_model: Option<String>,
}

#[derive(Deserialize)]
struct Entry {
    file_path: PathBuf,
    transform_matrix: Vec<Vec<f64>>,
    pl_pos: Option<Vec<f64>>,
}

/// The files of a folder, with the split that each stands for.
pub(super) fn find(entries: &[(String, PathBuf)]) -> Vec<(PathBuf, Option<Split>)> {
    let named = |name: &str| Some(entries.iter().find(|(entry, _)| entry == name)?.1.clone());
    let splits = [("train", Split::Train), ("val", Split::Val), ("test", Split::Easy)];
    if let Some(whole) = named("transforms.json") {
        return vec![(whole, None)];
    }
    let found: Vec<_> = splits
        .into_iter()
        .filter_map(|(name, split)| Some((named(&format!("transforms_{name}.json"))?, Some(split))))
        .collect();
    // Without a test the split is ours to draw.
    let has_test = found.iter().any(|(_, split)| *split == Some(Split::Easy));
    found.into_iter().map(|(path, split)| (path, split.filter(|_| has_test))).collect()
}

/// Reads the files.
pub(super) fn read(root: &Path, found: &[(PathBuf, Option<Split>)], faults: &mut Faults) -> Option<Found> {
    let mut reader = Reader { root: root.to_owned(), ..Reader::default() };
    for (path, split) in found {
        if let Some(file) = faults.keep(parse_file(path)) {
            reader.add(path, &file, *split, faults);
        }
    }
    if reader.frames.is_empty() {
        let path = found.first().map_or(root, |(path, _)| path);
        let mend = "Every frame needs file_path, transform_matrix and pl_pos.";
        faults.error(FaultKind::Missing, path, "holds no frame that can be used", mend);
        return None;
    }
    for (mend, (path, mut problem, count)) in std::mem::take(&mut reader.odd_lenses) {
        if count > 1 {
            problem += &format!("; {} more lenses are like that", count - 1);
        }
        faults.warning(FaultKind::Lens, &path, problem, mend);
    }
    if reader.rounded > 0 {
        let path = found.first().map_or(root, |(path, _)| path);
        let problem = format!(
            "{} frames have a camera or a light that differs from an earlier one by rounding: they are taken for the same",
            reader.rounded
        );
        faults.note(FaultKind::Inconsistent, path, problem, "");
    }
    // Cameras and lights first appear without knowing what they look at.
    let target = focus(&reader.cameras, &reader.lights);
    for light in &mut reader.lights {
        light.pose = Pose::look_at(light.pose.position(), target);
    }
    let declared = found.iter().all(|(_, split)| split.is_some()).then_some(reader.splits);
    let scene = Scene {
        name: super::name_of(root),
        root: root.to_owned(),
        layout: Layout::Transforms,
        cameras: reader.cameras,
        lights: reader.lights,
        frames: reader.frames,
        declared,
    };
    Some(Found { scene, camera_files: reader.camera_files, light_files: reader.light_files })
}

fn parse_file(path: &Path) -> Result<File, SceneError> {
    let text = files::read_text(path, LONGEST)?;
    parse(&text).map_err(|error| {
        let mend = "A transforms file is a JSON object with a lens (camera_angle_x, or fl_x, fl_y, cx, cy, w and h) and \
                    frames, each with file_path, transform_matrix and pl_pos.";
        SceneError::fault(FaultKind::Malformed, path, format!("is not a transforms file: {error}"), mend)
    })
}

pub(crate) fn parse(text: &str) -> Result<File, serde_json::Error> {
    let entries: Frames<Entry> = serde_json::from_str(text)?;
    let lenses: Frames<Lens> = serde_json::from_str(text)?;
    let Model { camera_model } = serde_json::from_str(text)?;
    let frames = lenses.frames.into_iter().zip(entries.frames).collect();
    Ok(File { lens: serde_json::from_str(text)?, camera_model, frames })
}

/// What has been read so far. Cameras that differ by rounding are one camera, and so are lights.
#[derive(Default)]
struct Reader {
    root: PathBuf,
    cameras: Vec<Camera>,
    camera_index: Nearby,
    lenses: HashSet<Vec<u64>>,
    camera_files: Vec<PathBuf>,
    lights: Vec<Light>,
    light_index: Nearby,
    light_files: Vec<PathBuf>,
    frames: Vec<Frame>,
    pairs: HashMap<(usize, usize), PathBuf>,
    splits: Splits,
    /// Frames whose camera or light is another's but for rounding.
    rounded: usize,
    /// By how to mend it, what looks wrong about a lens: the first, with its file, and how many there are.
    odd_lenses: BTreeMap<&'static str, (PathBuf, String, usize)>,
}

impl Reader {
    fn add(&mut self, path: &Path, file: &File, split: Option<Split>, faults: &mut Faults) {
        if let Some(model) = &file.camera_model
            && !["OPENCV", "PINHOLE", "SIMPLE_PINHOLE", "PERSPECTIVE"]
                .contains(&model.to_ascii_uppercase().as_str())
        {
            let mend = "Undistort the images to a pinhole or OPENCV model first.";
            faults.error(FaultKind::Lens, path, format!("camera_model {model:?} is not supported"), mend);
            return;
        }
        let mut size = None;
        for (lens, entry) in &file.frames {
            let Some((intrinsics, pose, position, image)) =
                faults.keep(self.read_entry(path, &lens.over(&file.lens), entry, &mut size))
            else {
                continue;
            };
            if self.lenses.insert(intrinsics.bits()) {
                for (problem, mend) in lenses::odd(&intrinsics) {
                    let problem = format!("frame {}: {problem}", entry.file_path.display());
                    self.odd_lenses.entry(mend).or_insert((path.to_owned(), problem, 0)).2 += 1;
                }
            }
            let camera = self.camera(intrinsics, pose, path);
            let light = self.light(position, path);
            let is_rounded =
                self.cameras[camera].pose != pose || self.lights[light].pose.position() != position;
            self.rounded += usize::from(is_rounded);
            if let Some(other) = self.pairs.insert((camera, light), image.clone()) {
                let problem = format!("shows the same view under the same light as {}", other.display());
                faults.warning(FaultKind::Extra, &image, problem, "It is left out: remove one of the two.");
                self.pairs.insert((camera, light), other);
                continue;
            }
            if let Some(split) = split {
                self.splits.get_mut(split).push(self.frames.len());
            }
            self.frames.push(Frame { camera, light, path: image });
        }
    }

    fn read_entry(
        &self,
        file: &Path,
        lens: &Lens,
        entry: &Entry,
        size: &mut Option<(u32, u32)>,
    ) -> Result<(Intrinsics, Pose, [f64; 3], PathBuf), SceneError> {
        let name = entry.file_path.display();
        let fault = |kind, problem: String, mend: &str| {
            Err(SceneError::fault(kind, file, format!("frame {name}: {problem}"), mend))
        };
        let mut numbers: Vec<f64> = entry.transform_matrix.iter().take(5).flatten().copied().collect();
        if numbers.len() == 12 {
            numbers.extend([0.0, 0.0, 0.0, 1.0]);
        }
        let Ok(matrix) = <[f64; 16]>::try_from(numbers) else {
            return fault(
                FaultKind::Malformed,
                "transform_matrix is not 4x4".to_owned(),
                "Write it as four rows of four.",
            );
        };
        let pose = match Pose::from_matrix(&matrix) {
            Ok(matrix) => Reading::of(Layout::Transforms).pose(&matrix),
            Err(problem) => {
                return fault(
                    FaultKind::Pose,
                    format!("transform_matrix: {problem}"),
                    pose_file::mend(&problem),
                );
            }
        };
        let position = match entry.pl_pos.as_deref() {
            Some(&[x, y, z]) if Pose::check_position([x, y, z]).is_ok() => [x, y, z],
            Some(_) => {
                return fault(
                    FaultKind::Malformed,
                    "pl_pos is not a position".to_owned(),
                    "Write the point light's x, y and z in the world, metres.",
                );
            }
            None => {
                return fault(
                    FaultKind::Missing,
                    "has no light position (pl_pos)".to_owned(),
                    "Relighting needs one light at a time: write the point light's x, y and z in the world for each frame.",
                );
            }
        };
        let image = self.find_image(&entry.file_path)?;
        if let (None, None) = (*size, lens.size()) {
            *size = Some(read_size(&image)?);
        }
        match lens.intrinsics(*size) {
            Ok(intrinsics) => Ok((intrinsics, pose, position, image)),
            Err(problem) => {
                let mend = "State camera_angle_x (radians), or fl_x, fl_y, cx, cy, w and h in pixels.";
                fault(FaultKind::Lens, problem, mend)
            }
        }
    }

    /// The image file, whose extension may have been left out.
    fn find_image(&self, file_path: &Path) -> Result<PathBuf, SceneError> {
        let path = self.root.join(file_path);
        if path.is_file() {
            return Ok(path);
        }
        let with = |extension: &str| {
            let mut name = path.clone().into_os_string();
            name.push(".");
            name.push(extension);
            PathBuf::from(name)
        };
        EXTENSIONS.iter().map(|extension| with(extension)).find(|path| path.is_file()).ok_or_else(|| {
            let mend = "Images are PNG, JPEG or WebP files, named relative to the folder: fetch the file, or convert it if \
                        it is of another format.";
            let problem = if path.exists() { "is not a file" } else { "is missing" };
            SceneError::fault(FaultKind::Missing, &path, problem, mend)
        })
    }

    fn camera(&mut self, intrinsics: Intrinsics, pose: Pose, file: &Path) -> usize {
        let is_same = |other: usize| {
            let other = &self.cameras[other];
            other.pose.difference(&pose) <= ROUNDING && other.intrinsics.is_nearly(&intrinsics)
        };
        if let Some(known) = self.camera_index.find(&pose, is_same) {
            return known;
        }
        let label = self.cameras.len();
        self.camera_index.add(&pose, label);
        self.cameras.push(Camera { label, intrinsics, pose });
        self.camera_files.push(file.to_owned());
        label
    }

    fn light(&mut self, position: [f64; 3], file: &Path) -> usize {
        let [x, y, z] = position;
        let pose = Pose([[1.0, 0.0, 0.0, x], [0.0, 1.0, 0.0, y], [0.0, 0.0, 1.0, z]]);
        let is_same = |other: usize| self.lights[other].pose.difference(&pose) <= ROUNDING;
        if let Some(known) = self.light_index.find(&pose, is_same) {
            return known;
        }
        let label = self.lights.len();
        self.light_index.add(&pose, label);
        self.lights.push(Light { label, pose });
        self.light_files.push(file.to_owned());
        label
    }
}
