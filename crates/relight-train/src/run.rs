//! The folder of a run and the file that tells how to repeat it.
//!
//! ```text
//! RUN/config.toml                      all that is needed to repeat the run
//!     weights.safetensors              the best weights so far, by validation
//!     guide.safetensors                where the engine had learnt to place samples, beside those weights; once training has ended,
//!                                      where the whole field holds anything
//!     checkpoint/latest.safetensors    what is needed to continue
//!     metrics.jsonl                    one line a report
//!     previews/                        a validation picture now and then: ground truth | rendering
//!     lock                             empty; locked by the training that is at work
//! ```

use std::fs::{self, File, OpenOptions, TryLockError};
use std::io::{ErrorKind, Write};
use std::path::{Path, PathBuf};

use relight_field::architecture::{Architecture, VARIANTS};
use relight_field::parameters::FieldConfig;
use relight_field::sampling::EngineConfig;
use relight_scene::{Bounds, Scene, Splits, UNFINISHED, fnv1a, read_text};
use serde::{Deserialize, Serialize};

use crate::TrainError;
use crate::recipe::Recipe;
use crate::schedule::Budget;

/// Format and version of `config.toml`.
pub const FORMAT: &str = "relight-run-1";

/// A configuration's longest length, bytes: those written have about 2 kB.
const LONGEST_CONFIG: u64 = 1 << 20;

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
    /// World box of the field, metres; `None` until the surfaces that decide it were looked for.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub bounds: Option<Bounds>,
    /// World box in which stereo looks for surfaces, metres.
    pub search: Bounds,
    /// How to train; the grid may be open as long as the box is.
    pub recipe: Recipe,
}

impl RunConfig {
    /// The field to train.
    ///
    /// # Errors
    /// As [`field_of`], and [`TrainError::Recipe`] if box or grid are open.
    pub fn field(&self) -> Result<FieldConfig, TrainError> {
        let missing = |what: &str| TrainError::Recipe(format!("the run's config.toml has no {what}"));
        let bounds = self.bounds.ok_or_else(|| missing("[bounds], the box of its field"))?;
        if self.recipe.grid.is_none() {
            return Err(missing("[recipe.grid], of which its weights have the shape"));
        }
        field_of(&self.recipe, &self.model, bounds)
    }

    /// The engine to train it with.
    pub fn engine(&self) -> EngineConfig {
        EngineConfig {
            sampling: self.recipe.sampling,
            shading: self.recipe.shading,
            optimiser: self.recipe.optimiser,
            beta2: self.recipe.beta2,
            seed: u64::from(self.seed),
        }
    }
}

/// The field that a recipe makes of a model in a box; with torch-ngp's grid if the recipe leaves that open.
///
/// # Errors
/// [`TrainError::Recipe`] if the model is unknown; [`TrainError::Parameters`] if the field cannot be made.
pub fn field_of(recipe: &Recipe, model: &str, bounds: Bounds) -> Result<FieldConfig, TrainError> {
    let architecture = Architecture::named(model).ok_or_else(|| {
        let names = VARIANTS.map(|(name, _)| name).join(", ");
        TrainError::Recipe(format!("unknown model \"{model}\"; the models are {names}"))
    })?;
    let density_scale = recipe.density_scale as f32 / bounds.longest_edge();
    let field = FieldConfig { architecture, grid: recipe.grid.unwrap_or_default(), bounds, density_scale };
    field.validate()?;
    Ok(field)
}

/// A number that changes when any split of the scene changes, or where its cameras and lights stand: FNV-1a over the
/// labels of each split's cameras and lights, their poses and intrinsics, and the sizes of the training images' files
/// (captures of one rig differ in nothing else). Scores of a run mean something only on the scene and splits that it
/// was trained with.
pub fn splits_fingerprint(scene: &Scene, splits: &Splits) -> String {
    let mut bytes = Vec::new();
    let mut eat = |value: u64| bytes.extend(value.to_le_bytes());
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
    format!("{:016x}", fnv1a(&bytes))
}

/// What a training that failed before its first checkpoint leaves behind.
const FILES_LEFT: [&str; 3] = ["config.toml", "metrics.jsonl", LOCK];
const FOLDERS_LEFT: [&str; 2] = ["previews", "checkpoint"];
/// The file that a training locks.
const LOCK: &str = "lock";

/// The folder of a run.
#[derive(Debug)]
pub struct RunFolder {
    root: PathBuf,
    /// Held by the one that trains, until it is dropped; none for those that only read.
    _lock: Option<File>,
}

impl RunFolder {
    /// Starts a run in `root`, which must be [vacant](Self::check_vacant), and keeps others from training there.
    ///
    /// # Errors
    /// [`TrainError::Run`] if something is there already; [`TrainError::Io`] if it cannot be written.
    pub fn create(root: &Path, config: &RunConfig) -> Result<Self, TrainError> {
        Self::check_contents(root)?;
        fs::create_dir_all(root).map_err(|error| match error.kind() {
            ErrorKind::AlreadyExists => {
                TrainError::run(root, "is a link to what is not there: remove it, or choose another folder")
            }
            _ => TrainError::io(root)(error),
        })?;
        let run = Self { root: root.to_owned(), _lock: Some(lock(root)?) };
        // Another may have trained there from its first step to its last since.
        Self::check_contents(root)?;
        run.write_config(config)?;
        Ok(run)
    }

    /// Gives up a run that was created and never trained: removes it, but for what else is in its folder.
    pub fn abandon(self) {
        // What cannot be removed does no harm: the folder is still vacant.
        let files = [self.config(), self.root.join(LOCK)];
        let _ = files.iter().try_for_each(fs::remove_file).and_then(|()| fs::remove_dir(&self.root));
    }

    /// Checks that a run can be started in `root`: that it does not exist, or is empty but for a run that never got
    /// anywhere, and that nobody trains there.
    ///
    /// # Errors
    /// [`TrainError::Run`] if something is there already; [`TrainError::Io`] if it cannot be looked at.
    pub fn check_vacant(root: &Path) -> Result<(), TrainError> {
        Self::check_contents(root)?;
        if root.join(LOCK).is_file() {
            lock(root)?;
        }
        Ok(())
    }

    fn check_contents(root: &Path) -> Result<(), TrainError> {
        if Self::exists(root) {
            return Err(TrainError::run(
                root,
                "holds a run already: continue it with --resume, or choose another folder",
            ));
        }
        let entries = match fs::read_dir(root) {
            Ok(entries) => entries,
            Err(error) if error.kind() == ErrorKind::NotFound => return Ok(()),
            Err(error) if error.kind() == ErrorKind::NotADirectory => {
                let what = if root.exists() { "is" } else { "lies under" };
                let problem = format!("{what} a file, and a run needs a folder: choose another name");
                return Err(TrainError::run(root, problem));
            }
            Err(error) => return Err(TrainError::io(root)(error)),
        };
        for entry in entries {
            let entry = entry.map_err(TrainError::io(root))?;
            let name = entry.file_name();
            let name = name.to_string_lossy();
            let is_folder = FOLDERS_LEFT.contains(&name.as_ref());
            if !is_folder && !name.ends_with(UNFINISHED) && !FILES_LEFT.contains(&name.as_ref()) {
                return Err(TrainError::run(root, "is not empty and holds no run: choose another folder"));
            }
            if entry.path().is_dir() != is_folder {
                let kind = if is_folder { "folder" } else { "file" };
                let problem =
                    format!("is no {kind}, and a run has one there: remove it, or choose another folder");
                return Err(TrainError::run(&entry.path(), problem));
            }
        }
        Ok(())
    }

    /// Whether `root` holds a run that something was learnt in.
    pub fn exists(root: &Path) -> bool {
        let run = Self { root: root.to_owned(), _lock: None };
        run.config().is_file() && (run.checkpoint().is_file() || run.weights().is_file())
    }

    /// Whether a run was begun in `root`, even if nothing was learnt in it yet.
    pub fn is_begun(root: &Path) -> bool {
        Self { root: root.to_owned(), _lock: None }.config().is_file()
    }

    /// Opens the run in `root` to train it further, and keeps others from doing so.
    ///
    /// # Errors
    /// As [`open`](Self::open); also [`TrainError::Run`] if another training is at work.
    pub fn resume(root: &Path) -> Result<(Self, RunConfig), TrainError> {
        let (run, config) = Self::open(root)?;
        Ok((Self { _lock: Some(lock(root)?), ..run }, config))
    }

    /// Opens the run in `root` to read it.
    ///
    /// # Errors
    /// [`TrainError::Run`] if there is none, or one of another version; [`TrainError::Scene`] if its configuration cannot
    /// be read.
    pub fn open(root: &Path) -> Result<(Self, RunConfig), TrainError> {
        if !root.join("config.toml").is_file() {
            return Err(TrainError::run(root, "holds no run (no config.toml): train one with relight train"));
        }
        let run = Self { root: root.to_owned(), _lock: None };
        let path = run.config();
        let text = read_text(&path, LONGEST_CONFIG)?;
        let broken = |e: &dyn std::fmt::Display| {
            TrainError::run(&path, format!("{e}. Mend the file, or train anew into another folder"))
        };
        let table: toml::Table = toml::from_str(&text).map_err(|e| broken(&e))?;
        match table.get("format").and_then(toml::Value::as_str) {
            Some(FORMAT) => {}
            Some(other) => {
                let problem =
                    format!("format \"{other}\" is unknown to this version, which reads \"{FORMAT}\"");
                return Err(TrainError::run(&path, problem));
            }
            None => return Err(TrainError::run(&path, "has no format: not the configuration of a run")),
        }
        let config: RunConfig = toml::from_str(&text).map_err(|e| broken(&e))?;
        config.recipe.validate().map_err(|e| broken(&e))?;
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

/// Locks the folder of a run for as long as the file is open: also a kill gives it free.
fn lock(root: &Path) -> Result<File, TrainError> {
    let path = root.join(LOCK);
    refuse_special(&path)?;
    let file = OpenOptions::new().write(true).create(true).truncate(false).open(&path);
    let file = file.map_err(TrainError::io(&path))?;
    match file.try_lock() {
        Ok(()) => Ok(file),
        Err(TryLockError::WouldBlock) => {
            let problem =
                "another training is at work in this folder: wait for its end or stop it, or choose another";
            Err(TrainError::run(root, problem))
        }
        // Some network file systems have no locks. That is no reason not to train there.
        Err(TryLockError::Error(error)) => {
            tracing::warn!("{}: cannot be locked ({error}): start no second training there", path.display());
            Ok(file)
        }
    }
}

/// Refuses what is there already and is no plain file: opening a pipe may never end.
pub(crate) fn refuse_special(path: &Path) -> Result<(), TrainError> {
    match fs::symlink_metadata(path) {
        Ok(found) if !found.is_file() => Err(TrainError::run(path, "is not a plain file: remove it")),
        Ok(_) => Ok(()),
        Err(error) if error.kind() == ErrorKind::NotFound => Ok(()),
        Err(error) => Err(TrainError::io(path)(error)),
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
