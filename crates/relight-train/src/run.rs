//! The folder of a run and the file that tells how to repeat it.
//!
//! ```text
//! RUN/config.toml                      all that is needed to repeat the run
//!     weights.safetensors              the best weights so far, by validation
//!     guide.safetensors                where the engine had learnt to place samples, beside those weights
//!     checkpoint/latest.safetensors    what is needed to continue
//!     metrics.jsonl                    one line a report
//!     previews/                        a validation picture now and then: ground truth | rendering
//! ```

use std::fs;
use std::io::Write;
use std::path::{Path, PathBuf};

use relight_field::architecture::{Architecture, VARIANTS};
use relight_field::parameters::FieldConfig;
use relight_field::sampling::EngineConfig;
use relight_scene::{Bounds, Scene, Splits, UNFINISHED};
use serde::{Deserialize, Serialize};

use crate::TrainError;
use crate::recipe::Recipe;
use crate::schedule::Budget;

/// Format and version of `config.toml`.
pub const FORMAT: &str = "relight-run-1";

/// All that is needed to repeat a run.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, rename_all = "kebab-case")]
pub struct RunConfig {
    /// [`FORMAT`].
    pub format: String,
    /// Absolute path of the scene.
    pub scene: PathBuf,
    /// Name of the scene.
    pub scene_name: String,
    /// Name of the architecture: `v0` to `v5`.
    pub model: String,
    /// Preset that the recipe started from.
    pub preset: String,
    /// Seed of every random draw.
    pub seed: u32,
    /// Fingerprint of the splits, see [`splits_fingerprint`].
    pub splits: String,
    /// How long to train.
    #[serde(default)]
    pub budget: Budget,
    /// World box of the field, metres.
    pub bounds: Bounds,
    /// World box in which stereo looks for surfaces, metres.
    pub search: Bounds,
    /// How to train.
    pub recipe: Recipe,
}

impl RunConfig {
    /// The field to train.
    ///
    /// # Errors
    /// [`TrainError::Recipe`] if the model is unknown; [`TrainError::Parameters`] if the field cannot be made.
    pub fn field(&self) -> Result<FieldConfig, TrainError> {
        let architecture = Architecture::named(&self.model).ok_or_else(|| {
            let names = VARIANTS.map(|(name, _)| name).join(", ");
            TrainError::Recipe(format!("unknown model \"{}\"; the models are {names}", self.model))
        })?;
        let field = FieldConfig {
            architecture,
            grid: self.recipe.grid,
            bounds: self.bounds,
            density_scale: self.recipe.density_scale as f32 / self.bounds.longest_edge(),
        };
        field.validate()?;
        Ok(field)
    }

    /// The engine to train it with.
    pub fn engine(&self) -> EngineConfig {
        EngineConfig {
            sampling: self.recipe.sampling,
            shading: self.recipe.shading,
            seed: u64::from(self.seed),
        }
    }
}

/// A number that changes when any split of the scene changes, or where its cameras and lights stand: FNV-1a over the
/// labels of each split's cameras and lights, their poses and intrinsics, and the sizes of the training images' files
/// (captures of one rig differ in nothing else). Scores of a run mean something only on the scene and splits that it
/// was trained with.
pub fn splits_fingerprint(scene: &Scene, splits: &Splits) -> String {
    let mut hash = 0xcbf2_9ce4_8422_2325_u64;
    let mut eat = |value: u64| {
        for byte in value.to_le_bytes() {
            hash = (hash ^ u64::from(byte)).wrapping_mul(0x0000_0100_0000_01b3);
        }
    };
    for frames in [&splits.train, &splits.val, &splits.easy, &splits.hard] {
        eat(frames.len() as u64);
        for &frame in frames {
            let frame = &scene.frames[frame];
            eat(scene.cameras[frame.camera].label as u64);
            eat(scene.lights[frame.light].label as u64);
        }
    }
    for &frame in &splits.train {
        eat(fs::metadata(&scene.frames[frame].path).map_or(0, |m| m.len()));
    }
    for camera in &scene.cameras {
        let lens = &camera.intrinsics;
        eat(u64::from(lens.width) << 32 | u64::from(lens.height));
        [lens.fx, lens.fy, lens.cx, lens.cy].iter().chain(&lens.distortion).for_each(|v| eat(v.to_bits()));
    }
    let poses = scene.cameras.iter().map(|c| &c.pose).chain(scene.lights.iter().map(|l| &l.pose));
    poses.flat_map(|pose| pose.0.as_flattened()).for_each(|v| eat(v.to_bits()));
    format!("{hash:016x}")
}

/// What a training that failed before its first checkpoint leaves behind.
const LEFT_BY_A_START: [&str; 4] = ["config.toml", "metrics.jsonl", "previews", "checkpoint"];

/// The folder of a run.
#[derive(Clone, Debug)]
pub struct RunFolder {
    root: PathBuf,
}

impl RunFolder {
    /// Starts a run in `root`, which must not exist, or be empty but for a run that never got anywhere.
    ///
    /// # Errors
    /// [`TrainError::Run`] if something is there already; [`TrainError::Io`] if it cannot be written.
    pub fn create(root: &Path, config: &RunConfig) -> Result<Self, TrainError> {
        if Self::exists(root) {
            return Err(TrainError::run(
                root,
                "holds a run already: continue it with --resume, or choose another folder",
            ));
        }
        fs::create_dir_all(root).map_err(TrainError::io(root))?;
        for entry in fs::read_dir(root).map_err(TrainError::io(root))? {
            let name = entry.map_err(TrainError::io(root))?.file_name();
            let name = name.to_string_lossy();
            if !name.ends_with(UNFINISHED) && !LEFT_BY_A_START.contains(&name.as_ref()) {
                return Err(TrainError::run(root, "is not empty and holds no run: choose another folder"));
            }
        }
        let run = Self { root: root.to_owned() };
        run.write_config(config)?;
        Ok(run)
    }

    /// Whether `root` holds a run that something was learnt in.
    pub fn exists(root: &Path) -> bool {
        let run = Self { root: root.to_owned() };
        run.config().is_file() && (run.checkpoint().is_file() || run.weights().is_file())
    }

    /// Opens the run in `root`.
    ///
    /// # Errors
    /// [`TrainError::Run`] if there is none, or one of another version; [`TrainError::Io`] if it cannot be read.
    pub fn open(root: &Path) -> Result<(Self, RunConfig), TrainError> {
        if !root.join("config.toml").is_file() {
            return Err(TrainError::run(root, "holds no run (no config.toml): train one with relight train"));
        }
        let run = Self { root: root.to_owned() };
        let path = run.config();
        let text = fs::read_to_string(&path).map_err(TrainError::io(&path))?;
        let table: toml::Table = toml::from_str(&text).map_err(|e| TrainError::run(&path, e.to_string()))?;
        match table.get("format").and_then(toml::Value::as_str) {
            Some(FORMAT) => {}
            Some(other) => {
                let problem =
                    format!("format \"{other}\" is unknown to this version, which reads \"{FORMAT}\"");
                return Err(TrainError::run(&path, problem));
            }
            None => return Err(TrainError::run(&path, "has no format: not the configuration of a run")),
        }
        let config: RunConfig = toml::from_str(&text).map_err(|e| TrainError::run(&path, e.to_string()))?;
        config.recipe.validate().map_err(|e| TrainError::run(&path, e.to_string()))?;
        Ok((run, config))
    }

    /// Writes the configuration anew.
    ///
    /// # Errors
    /// [`TrainError::Io`] if it cannot be written.
    pub fn write_config(&self, config: &RunConfig) -> Result<(), TrainError> {
        let text = toml::to_string(config).map_err(|e| TrainError::run(&self.config(), e.to_string()))?;
        write_whole(&self.config(), |file| file.write_all(text.as_bytes()))
    }

    /// The folder itself.
    pub fn root(&self) -> &Path {
        &self.root
    }

    /// The configuration.
    pub fn config(&self) -> PathBuf {
        self.root.join("config.toml")
    }

    /// The best weights so far.
    pub fn weights(&self) -> PathBuf {
        self.root.join("weights.safetensors")
    }

    /// Where to place samples, beside the best weights.
    pub fn guide(&self) -> PathBuf {
        self.root.join("guide.safetensors")
    }

    /// The checkpoint.
    pub fn checkpoint(&self) -> PathBuf {
        self.root.join("checkpoint").join("latest.safetensors")
    }

    /// The metrics, one JSON object a line.
    pub fn metrics(&self) -> PathBuf {
        self.root.join("metrics.jsonl")
    }

    /// The folder of the previews.
    pub fn previews(&self) -> PathBuf {
        self.root.join("previews")
    }

    /// The preview of `step`.
    pub fn preview(&self, step: u64) -> PathBuf {
        self.previews().join(format!("{step:08}.png"))
    }
}

/// Writes a file, in a folder that is made if need be: whoever reads `path` finds the old content or the new, whole.
///
/// # Errors
/// [`TrainError::Io`] if it cannot be written.
pub fn write_whole(
    path: &Path,
    write: impl FnOnce(&mut fs::File) -> std::io::Result<()>,
) -> Result<(), TrainError> {
    let folder = path.parent().map_or(Ok(()), fs::create_dir_all);
    folder.and_then(|()| relight_scene::write_whole(path, write)).map_err(TrainError::io(path))
}
