//! A benchmark: scenes, and which of their images a submission must show.

use std::collections::HashMap;
use std::ops::ControlFlow;
use std::path::{Path, PathBuf};

use relight_scene::{Frame, Image, Scene, SceneError, Split, Splits, read_image};

use crate::parallel::{Progress, in_parallel};

/// The splits that are scored, in the order in which they are told.
pub const SCORED: [Split; 3] = [Split::Val, Split::Easy, Split::Hard];

/// A folder of scenes, each with its test images.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Benchmark {
    /// The folder's name.
    pub name: String,
    /// The folder.
    pub folder: PathBuf,
    /// Its scenes, by name.
    pub scenes: Vec<BenchmarkScene>,
    /// Scene and image by name in a zip.
    by_name: HashMap<String, (usize, usize)>,
}

/// A scene of a benchmark.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct BenchmarkScene {
    /// The scene's name.
    pub name: String,
    /// Its validation, easy and hard images, by split, then light, then camera.
    pub images: Vec<TestImage>,
}

/// An image that a submission shows.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct TestImage {
    /// Its name in a zip: `{scene}_{light:02}_{camera:02}.png`.
    pub entry: String,
    /// The camera's label.
    pub camera: usize,
    /// The light's label.
    pub light: usize,
    /// `Val`, `Easy` or `Hard`.
    pub split: Split,
    /// Pixels a row.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// The photograph. Participants' copies of test images are black.
    pub truth: PathBuf,
}

/// Why a folder is no benchmark.
#[derive(Debug, thiserror::Error)]
pub enum BenchmarkError {
    /// The folder or one of its scenes cannot be used.
    #[error(transparent)]
    Scene(#[from] SceneError),
    /// There is no scene in the folder.
    #[error("{0}: holds no scene. A benchmark is a folder of scene folders, such as the ReNe release")]
    Empty(PathBuf),
    /// A scene has no image to score.
    #[error("{0}: the scene has no validation or test image, so nothing can be scored")]
    NothingToScore(PathBuf),
    /// Two images have the same name in a zip.
    #[error("{folder}: two images would be called {entry} in a submission. Rename one of the scenes")]
    SameName {
        /// The benchmark.
        folder: PathBuf,
        /// The name.
        entry: String,
    },
    /// Ground truth is withheld.
    #[error(
        "{0}: the ground truth is all black, as in the official ReNe release, which withholds its test images. A server \
         that scores needs the photographs themselves"
    )]
    BlackTruth(PathBuf),
    /// Ground truth is not of its camera's size.
    #[error("{path}: is {}x{} pixels, and its camera has {}x{}. Put the right photograph in its place", found.0, found.1, wanted.0, wanted.1)]
    TruthSize {
        /// The photograph.
        path: PathBuf,
        /// Width and height that it has.
        found: (u32, u32),
        /// Width and height of the camera.
        wanted: (u32, u32),
    },
    /// The folder cannot be listed.
    #[error("{folder}: cannot be listed: {source}. A benchmark is a folder of scene folders")]
    Unreadable {
        /// The folder.
        folder: PathBuf,
        /// Why.
        source: std::io::Error,
    },
    /// The caller asked to stop.
    #[error("stopped before all ground truth was looked at")]
    Stopped,
}

impl Benchmark {
    /// Reads a benchmark with ground truth: as [`layout`](Benchmark::layout), and looks at one image of every scene and split.
    /// [`verify`](Benchmark::verify) looks at all.
    ///
    /// # Errors
    /// As [`layout`](Benchmark::layout); also [`BenchmarkError::BlackTruth`] if the ground truth is withheld.
    pub fn open(folder: &Path) -> Result<Benchmark, BenchmarkError> {
        let benchmark = Benchmark::layout(folder)?;
        for scene in &benchmark.scenes {
            for split in SCORED {
                if let Some(image) = scene.images.iter().find(|image| image.split == split) {
                    image.read_truth()?;
                }
            }
        }
        Ok(benchmark)
    }

    /// Reads which images a benchmark asks for, with or without ground truth. Nothing is written.
    ///
    /// `folder` is a folder of scenes, or a scene.
    ///
    /// # Errors
    /// The scene that cannot be read, or that has nothing to score.
    pub fn layout(folder: &Path) -> Result<Benchmark, BenchmarkError> {
        let scenes = scene_folders(folder)?
            .iter()
            .map(|folder| BenchmarkScene::layout(folder))
            .collect::<Result<Vec<_>, BenchmarkError>>()?;
        if scenes.is_empty() {
            return Err(BenchmarkError::Empty(folder.to_owned()));
        }
        let mut by_name = HashMap::new();
        for (s, scene) in scenes.iter().enumerate() {
            for (i, image) in scene.images.iter().enumerate() {
                if by_name.insert(image.entry.clone(), (s, i)).is_some() {
                    let entry = image.entry.clone();
                    return Err(BenchmarkError::SameName { folder: folder.to_owned(), entry });
                }
            }
        }
        let absolute = folder.canonicalize().unwrap_or_else(|_| folder.to_owned());
        let name = absolute
            .file_name()
            .map_or_else(|| "benchmark".to_owned(), |name| name.to_string_lossy().into_owned());
        Ok(Benchmark { name, folder: folder.to_owned(), scenes, by_name })
    }

    /// Looks at all ground truth: whether each image decodes, has its camera's size and is not black. For when a benchmark is
    /// added; takes as long as decoding takes.
    ///
    /// # Errors
    /// The first image that cannot be scored against.
    pub fn verify(
        &self,
        progress: &mut dyn FnMut(Progress) -> ControlFlow<()>,
    ) -> Result<(), BenchmarkError> {
        let images: Vec<&TestImage> = self.scenes.iter().flat_map(|scene| &scene.images).collect();
        let look = |_: &mut (), index: usize| images[index].read_truth().map(drop);
        let looked = in_parallel(images.len(), || (), look, progress).ok_or(BenchmarkError::Stopped)?;
        looked.into_iter().collect()
    }

    /// Scene and image of a name in a zip, as indices.
    pub fn find(&self, entry: &str) -> Option<(usize, usize)> {
        self.by_name.get(entry).copied()
    }
}

impl BenchmarkScene {
    /// Reads which images of a scene are scored.
    fn layout(folder: &Path) -> Result<BenchmarkScene, BenchmarkError> {
        let scene = Scene::open(folder)?;
        let splits = Splits::peek(&scene)?;
        let image = |split, frame: &Frame| {
            let (camera, light) = (&scene.cameras[frame.camera], scene.lights[frame.light].label);
            TestImage {
                entry: format!("{}_{light:02}_{:02}.png", scene.name, camera.label),
                camera: camera.label,
                light,
                split,
                width: camera.intrinsics.width,
                height: camera.intrinsics.height,
                truth: frame.path.clone(),
            }
        };
        let mut images = Vec::new();
        for split in SCORED {
            let start = images.len();
            images.extend(splits.get(split).iter().map(|&frame| image(split, &scene.frames[frame])));
            images[start..].sort_by_key(|image| (image.light, image.camera));
        }
        if images.is_empty() {
            return Err(BenchmarkError::NothingToScore(folder.to_owned()));
        }
        Ok(BenchmarkScene { name: scene.name, images })
    }
}

impl TestImage {
    /// Reads the photograph.
    ///
    /// # Errors
    /// If it cannot be read, is not of its camera's size or is black.
    pub fn read_truth(&self) -> Result<Image, BenchmarkError> {
        let image = read_image(&self.truth)?;
        if (image.width, image.height) != (self.width, self.height) {
            return Err(BenchmarkError::TruthSize {
                path: self.truth.clone(),
                found: (image.width, image.height),
                wanted: (self.width, self.height),
            });
        }
        if image.is_black() { Err(BenchmarkError::BlackTruth(self.truth.clone())) } else { Ok(image) }
    }
}

/// The folders of a benchmark's scenes, sorted: the folder itself if it is a scene, else all that it holds.
fn scene_folders(folder: &Path) -> Result<Vec<PathBuf>, BenchmarkError> {
    let unreadable = |source| BenchmarkError::Unreadable { folder: folder.to_owned(), source };
    let mut folders = Vec::new();
    for entry in folder.read_dir().map_err(unreadable)? {
        let entry = entry.map_err(unreadable)?;
        let name = entry.file_name().to_string_lossy().into_owned();
        let path = entry.path();
        if path.is_dir() {
            if name.strip_prefix("lset").is_some_and(|number| number.parse::<usize>().is_ok()) {
                return Ok(vec![folder.to_owned()]);
            }
            if !name.starts_with('.') {
                folders.push(path);
            }
        } else if name.starts_with("transforms") && name.ends_with(".json") {
            return Ok(vec![folder.to_owned()]);
        }
    }
    folders.sort();
    Ok(folders)
}
