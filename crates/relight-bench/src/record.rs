//! What a finished job leaves beside its run: scores, pictures, and how they came about.

use std::io::Write;
use std::path::{Path, PathBuf};

use relight_scene::Split;
use relight_train::evaluation::{Evaluation, Scores};
use relight_train::run::{RunConfig, write_whole};
use serde::{Deserialize, Serialize};

use crate::error::BenchError;
use crate::job::Job;
use crate::scoring::Scored;
use crate::versioned;

/// Format and version of `result.json`.
const FORMAT: &str = "relight-bench-result-1";
/// A record's longest length, bytes: an image takes about 80.
const LONGEST: u64 = 1 << 28;

/// All that is known of a finished job.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, rename_all = "kebab-case")]
pub struct Record {
    format: String,
    /// The job.
    pub job: Job,
    /// How its run is repeated.
    pub config: RunConfig,
    /// By what the scores were made.
    pub made: Made,
    /// Validation, easy and hard.
    pub splits: Vec<SplitRecord>,
    /// One image, to look at; `None` if no split could be scored.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub shown: Option<Shown>,
}

/// By what, and with how much work.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, rename_all = "kebab-case")]
pub struct Made {
    /// Version of the program.
    pub version: String,
    /// Commit that it was built of.
    pub commit: String,
    /// What it ran on.
    pub device: String,
    /// Steps taken.
    pub steps: u64,
    /// Seconds of training, validation and stereo included.
    pub seconds: f64,
}

/// What came of a split.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, rename_all = "kebab-case")]
pub struct SplitRecord {
    /// The split.
    pub split: Split,
    /// Its scores, or why there are none.
    pub outcome: Outcome,
}

/// Scores of a split, or why there are none.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Outcome {
    /// It was scored.
    Scored(Evaluation),
    /// It cannot be scored, for this reason.
    Skipped(String),
}

/// The image whose pictures were kept.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, rename_all = "kebab-case")]
pub struct Shown {
    /// The split that it is of.
    pub split: Split,
    /// Label of the camera.
    pub camera: usize,
    /// Label of the light.
    pub light: usize,
    /// Its scores.
    pub scores: Scores,
    /// File of the photograph, in the folder of the run.
    pub truth: PathBuf,
    /// File of the rendering.
    pub prediction: PathBuf,
    /// File of the error between both.
    pub error: PathBuf,
    /// File of the visibility, for a model that has it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub visibility: Option<PathBuf>,
}

impl Record {
    /// A record of a job.
    pub fn new(job: Job, config: RunConfig, made: Made, scored: Scored) -> Self {
        let Scored { splits, shown } = scored;
        Self { format: FORMAT.to_owned(), job, config, made, splits, shown }
    }

    fn path(folder: &Path) -> PathBuf {
        folder.join("result.json")
    }

    /// Reads the record in the folder of a run; `None` if there is none.
    ///
    /// # Errors
    /// [`BenchError::File`] if it is none of this version, [`BenchError::Scene`] if it cannot be read.
    pub fn load(folder: &Path) -> Result<Option<Self>, BenchError> {
        let mend = "remove the file, and the same command scores the run anew";
        versioned::read(&Self::path(folder), LONGEST, FORMAT, mend)
    }

    /// Writes the record into the folder of its run.
    ///
    /// # Errors
    /// [`BenchError::Train`] if it cannot be written.
    pub fn save(&self, folder: &Path) -> Result<(), BenchError> {
        let path = Self::path(folder);
        let text = serde_json::to_string(self).map_err(|e| BenchError::file(&path, e.to_string()))?;
        Ok(write_whole(&path, |file| file.write_all(text.as_bytes()))?)
    }

    /// The scores on a split, if there are any.
    pub fn evaluation(&self, split: Split) -> Option<&Evaluation> {
        self.splits.iter().find(|s| s.split == split).and_then(|s| match &s.outcome {
            Outcome::Scored(evaluation) => Some(evaluation),
            Outcome::Skipped(_) => None,
        })
    }

    /// How the scores came about, in a line.
    pub fn told(&self) -> String {
        let Made { version, commit, device, steps, .. } = &self.made;
        let (model, seed, preset) = (&self.job.model, self.job.seed, &self.config.preset);
        format!(
            "{model}, seed {seed}, preset {preset}, {steps} steps, {device}, relight {version} ({commit})"
        )
    }
}
