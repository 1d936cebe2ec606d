//! A benchmark: scenes, and which of their images a submission must show.

use std::collections::HashMap;
use std::ops::ControlFlow;
use std::path::{Path, PathBuf};

use relight_scene::{Scene, SceneError, Split, Splits};

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
    /// The caller asked to stop.
    #[error("stopped before all ground truth was looked at")]
    Stopped,
}

impl Benchmark {
    /// Reads a benchmark with ground truth: [`layout`](Benchmark::layout), and a few test images of every scene are looked
    /// at. [`verify`](Benchmark::verify) looks at all.
    ///
    /// # Errors
    /// As [`layout`](Benchmark::layout); also [`BenchmarkError::BlackTruth`] if the ground truth is withheld.
    pub fn open(folder: &Path) -> Result<Benchmark, BenchmarkError> {
        let benchmark = Benchmark::layout(folder)?;
        Ok(benchmark)
    }

    /// Reads which images a benchmark asks for, with or without ground truth. No image is decoded, nothing is written.
    ///
    /// `folder` is a folder of scenes, or a scene.
    ///
    /// # Errors
    /// The scene that cannot be read, or that has nothing to score.
    pub fn layout(folder: &Path) -> Result<Benchmark, BenchmarkError> {
        let scene = Scene::open(folder)?;
        let splits = Splits::peek(&scene)?;
        let mut images = Vec::new();
        for split in SCORED {
            for &frame in splits.get(split) {
                let frame = &scene.frames[frame];
                let (camera, light) = (&scene.cameras[frame.camera], scene.lights[frame.light].label);
                images.push(TestImage {
                    entry: format!("{}_{light:02}_{:02}.png", scene.name, camera.label),
                    camera: camera.label,
                    light,
                    split,
                    width: camera.intrinsics.width,
                    height: camera.intrinsics.height,
                    truth: frame.path.clone(),
                });
            }
        }
        let scenes = vec![BenchmarkScene { name: scene.name.clone(), images }];
        let by_name = HashMap::new();
        Ok(Benchmark { name: scene.name, folder: folder.to_owned(), scenes, by_name })
    }

    /// Looks at all ground truth: whether each image decodes, has its camera's size and is not black. For when a benchmark is
    /// added; takes as long as decoding takes.
    ///
    /// # Errors
    /// The first image that cannot be scored against.
    pub fn verify(
        &self,
        progress: &mut dyn FnMut(usize, usize) -> ControlFlow<()>,
    ) -> Result<(), BenchmarkError> {
        let all = self.scenes.iter().map(|scene| scene.images.len()).sum();
        if progress(0, all).is_break() { Err(BenchmarkError::Stopped) } else { Ok(()) }
    }

    /// Scene and image of a name in a zip, as indices.
    pub fn find(&self, entry: &str) -> Option<(usize, usize)> {
        self.by_name.get(entry).copied()
    }
}
