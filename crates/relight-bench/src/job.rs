//! The trainings that a table needs, as data: scene by model by seed.
//!
//! `jobs.json` holds them, so that any machine can do any of them: a job is told by its place in the list, does not
//! depend on any other, and leaves its [`Record`](crate::Record) in a folder of its own.

use std::collections::BTreeMap;
use std::io::Write;
use std::path::{Path, PathBuf};

use relight_train::recipe::{Preset, Recipe};
use relight_train::run::{RunConfig, write_whole};
use relight_train::schedule::Budget;
use serde::{Deserialize, Serialize};

use crate::error::BenchError;
use crate::versioned;

/// Format and version of `jobs.json`.
const FORMAT: &str = "relight-bench-jobs-1";
/// A list's longest length, bytes: a job takes about 150.
const LONGEST: u64 = 1 << 26;

/// How all jobs of a list are trained.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, rename_all = "kebab-case")]
pub struct Settings {
    /// Preset that the recipe started from.
    pub preset: String,
    /// How long each is trained.
    pub budget: Budget,
    /// How each is trained.
    pub recipe: Recipe,
}

impl Settings {
    /// Whether a run with these settings has the configuration `config`; the grid may have been fitted to the scene.
    ///
    /// # Errors
    /// What differs.
    pub fn check(&self, job: &Job, config: &RunConfig) -> Result<(), String> {
        let grid = self.recipe.grid.or(config.recipe.grid);
        let same = [
            ("model", config.model == job.model),
            ("seed", config.seed == job.seed),
            ("preset", config.preset == self.preset),
            ("steps or minutes", config.budget == self.budget),
            ("recipe", config.recipe == Recipe { grid, ..self.recipe.clone() }),
        ];
        match same.iter().find(|(_, same)| !same) {
            None => Ok(()),
            Some((what, _)) => Err(format!("was trained with other settings ({what})")),
        }
    }

    /// The settings in a few words.
    pub fn told(&self) -> String {
        let steps = self.budget.steps.map(|steps| format!("{steps} steps"));
        let minutes = self.budget.minutes.map(|minutes| format!("{minutes} minutes"));
        let budget = match (steps, minutes) {
            (Some(steps), Some(minutes)) => format!("{steps} or {minutes}, whichever came first"),
            (one, other) => one.or(other).unwrap_or_else(|| "until validation stopped improving".to_owned()),
        };
        let preset = self.preset.parse::<Preset>();
        let changed = if preset.is_ok_and(|p| p.recipe() == self.recipe) { "" } else { ", changed" };
        format!("preset {}{changed}, {budget}", self.preset)
    }
}

/// One training.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, rename_all = "kebab-case")]
pub struct Job {
    /// Name that no other job of the list has: of scene, model and seed, and of nothing else.
    pub id: String,
    /// Absolute path of the scene.
    pub scene: PathBuf,
    /// Name of the scene.
    pub scene_name: String,
    /// Name of the architecture.
    pub model: String,
    /// Seed of every random draw.
    pub seed: u32,
}

impl Job {
    /// The folder of its run, in the folder of the tables.
    pub fn folder(&self, out: &Path) -> PathBuf {
        out.join("runs").join(&self.id)
    }
}

/// Jobs, and how they are done.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, rename_all = "kebab-case")]
pub struct JobList {
    format: String,
    /// How all of them are trained.
    pub settings: Settings,
    /// The jobs, those of a scene together.
    pub jobs: Vec<Job>,
}

impl JobList {
    /// The jobs of every scene with every model and seed. The first seeds of a scene come first, so that a row of each
    /// model is there early.
    ///
    /// # Errors
    /// [`BenchError::Jobs`] if there is none, or if two scenes have one name.
    pub fn new(
        settings: Settings,
        scenes: &[PathBuf],
        models: &[String],
        seeds: &[u32],
    ) -> Result<Self, BenchError> {
        let mut named = BTreeMap::<String, PathBuf>::new();
        let mut jobs = Vec::<Job>::new();
        for scene in scenes {
            // What cannot be found fails as a job does, and stops no other.
            let path = scene.canonicalize().or_else(|_| std::path::absolute(scene));
            let path =
                path.map_err(|e| BenchError::Jobs(format!("{}: {e}: name a scene", scene.display())))?;
            let name =
                path.file_name().map_or_else(|| "scene".into(), |name| name.to_string_lossy().into_owned());
            if let Some(other) = named.insert(name.clone(), path.clone()) {
                return Err(BenchError::Jobs(if other == path {
                    format!("{}: is named twice", scene.display())
                } else {
                    let both = [other.display(), path.display()];
                    format!("two scenes are called {name}: {} and {}; rename one of them", both[0], both[1])
                }));
            }
            for &seed in seeds {
                for model in models {
                    let job = Job {
                        id: format!("{name}-{model}-s{seed}"),
                        scene: path.clone(),
                        scene_name: name.clone(),
                        model: model.clone(),
                        seed,
                    };
                    if jobs.iter().any(|other| other.id == job.id) {
                        return Err(BenchError::Jobs(format!(
                            "model {model} with seed {seed} is named twice"
                        )));
                    }
                    jobs.push(job);
                }
            }
        }
        if jobs.is_empty() {
            return Err(BenchError::Jobs("no jobs: name scenes, models and seeds".into()));
        }
        Ok(Self { format: FORMAT.to_owned(), settings, jobs })
    }

    /// Where the list is kept.
    pub fn path(out: &Path) -> PathBuf {
        out.join("jobs.json")
    }

    /// Reads the list in the folder of the tables; `None` if there is none.
    ///
    /// # Errors
    /// [`BenchError::File`] if it is none of this version, [`BenchError::Scene`] if it cannot be read.
    pub fn load(out: &Path) -> Result<Option<Self>, BenchError> {
        let mend = "remove the file, and the same command makes it anew";
        versioned::read(&Self::path(out), LONGEST, FORMAT, mend)
    }

    /// Puts the list beside what the folder of the tables holds already: jobs that are in both keep their places, new
    /// ones come after them.
    ///
    /// # Errors
    /// [`BenchError::File`] if the jobs there have other settings or other scenes of the same names; as
    /// [`load`](Self::load); [`BenchError::Train`] if it cannot be written.
    pub fn keep(&self, out: &Path) -> Result<(), BenchError> {
        let path = Self::path(out);
        let mut kept = Self::load(out)?.unwrap_or_else(|| Self { jobs: Vec::new(), ..self.clone() });
        if kept.settings != self.settings {
            let problem = format!(
                "the runs here have other settings ({}, and now {}): ask for the same, or choose another folder with --out",
                kept.settings.told(),
                self.settings.told()
            );
            return Err(BenchError::file(&path, problem));
        }
        for job in &self.jobs {
            match kept.jobs.iter().find(|other| other.id == job.id) {
                Some(other) if other != job => {
                    let problem = format!(
                        "{} is another scene here, {}: choose another folder with --out",
                        job.scene_name,
                        other.scene.display()
                    );
                    return Err(BenchError::file(&path, problem));
                }
                Some(_) => {}
                None => kept.jobs.push(job.clone()),
            }
        }
        let text = serde_json::to_string_pretty(&kept).map_err(|e| BenchError::file(&path, e.to_string()))?;
        Ok(write_whole(&path, |file| file.write_all(text.as_bytes()))?)
    }
}
