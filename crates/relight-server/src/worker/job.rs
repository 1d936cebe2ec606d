//! What server and child process tell each other: JSON, a line each.

use std::path::PathBuf;

use serde::{Deserialize, Serialize};

use crate::method::Phase;
use crate::scoring::Scores;
use crate::submission::Refusal;

/// What is to be scored. Both sides are the same program, so that there is no version to tell.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Job {
    /// The zip.
    pub zip: PathBuf,
    /// Folder of the benchmark.
    pub benchmark: PathBuf,
    /// Which images it is said to be about.
    pub phase: Phase,
    /// What the zip's SHA-256 was when it came.
    pub sha256: String,
    /// Folder to make, for pictures.
    pub pictures: PathBuf,
    /// Bytes of address space that the process may have.
    pub memory: u64,
    /// Bytes that a zip may have.
    pub zip_bytes: u64,
    /// The server's process: nobody else asks for the scores.
    pub server: u32,
}

/// What the process that scores has to say.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Report {
    /// How far it is.
    Progress {
        /// Images done.
        done: usize,
        /// Images in all.
        all: usize,
    },
    /// The end: scores.
    Scored {
        /// They.
        scores: Box<Scores>,
    },
    /// The end: no submission.
    Refused {
        /// Why.
        reason: String,
        /// What is wrong with the zip, if that is why.
        problems: Option<Refusal>,
    },
    /// The end: something else is wrong, such as the ground truth.
    Failed {
        /// What.
        why: String,
    },
}
