//! Whether a zip is a submission.

use std::fmt;
use std::ops::ControlFlow;
use std::path::{Path, PathBuf};

use relight_scene::Split;
use serde::{Deserialize, Serialize};

use crate::benchmark::Benchmark;
use crate::scoring::Progress;

/// What a zip may hold at most.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Limits {
    /// Bytes of the zip.
    pub zip_bytes: u64,
    /// Entries of the zip.
    pub entries: usize,
    /// Bytes of one entry, unpacked. Besides, an entry may not be much longer than its image's pixels.
    pub entry_bytes: u64,
    /// Bytes of all entries together, unpacked.
    pub total_bytes: u64,
    /// Unpacked bytes of an entry for each of its packed ones.
    pub ratio: u64,
    /// Pixels of an image.
    pub pixels: u64,
    /// Problems told; the others are only counted.
    pub problems: usize,
}

impl Default for Limits {
    fn default() -> Limits {
        Limits {
            zip_bytes: 16 << 30,
            entries: 20_000,
            entry_bytes: 256 << 20,
            total_bytes: 16 << 30,
            ratio: 200,
            pixels: 1 << 26,
            problems: 1000,
        }
    }
}

/// A zip whose entries are the images that a benchmark asks for.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Submission {
    /// The zip.
    pub zip: PathBuf,
    /// Bytes of the zip.
    pub bytes: u64,
    /// The splits that it shows, each whole: `[Val]`, `[Easy, Hard]` or all three.
    pub splits: Vec<Split>,
    /// Its images, in the benchmark's order.
    pub images: Vec<SubmittedImage>,
}

/// An image of a submission.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct SubmittedImage {
    /// Index of its scene in the benchmark.
    pub scene: usize,
    /// Index of the image in its scene.
    pub image: usize,
}

/// What is wrong with an entry or with the zip: stable names for machines.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
#[non_exhaustive]
pub enum Code {
    /// Not a zip file.
    NotAZip,
}

/// One thing wrong with a zip.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Problem {
    /// What it is, for machines.
    pub code: Code,
    /// The entry at fault, made fit to print; none if it is the zip itself.
    pub entry: Option<String>,
    /// What is wrong and how to mend it.
    pub message: String,
}

impl fmt::Display for Problem {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}: {}", self.entry.as_deref().unwrap_or("the zip"), self.message)
    }
}

/// Why a zip is no submission.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, thiserror::Error)]
#[error("the zip is not a submission to this benchmark: {} problems", problems.len() + more)]
pub struct Refusal {
    /// What is wrong, at least one thing.
    pub problems: Vec<Problem>,
    /// How many more problems there are.
    pub more: usize,
}

/// Why a zip was not checked to its end.
#[derive(Debug, thiserror::Error)]
pub enum SubmissionError {
    /// It was, and is no submission.
    #[error(transparent)]
    Refused(#[from] Refusal),
    /// The zip cannot be read from the disk.
    #[error("{path}: cannot be read: {source}")]
    Io {
        /// The zip.
        path: PathBuf,
        /// Why.
        source: std::io::Error,
    },
    /// The caller asked to stop.
    #[error("stopped before all images were checked")]
    Stopped,
}

/// Holds a zip against a benchmark as far as that goes without unpacking its images: structure, names, declared sizes and
/// ratios, which images are there. Takes milliseconds; ground truth is not looked at.
///
/// # Errors
/// [`SubmissionError::Refused`] with all that is wrong.
pub fn inspect(zip: &Path, benchmark: &Benchmark, limits: &Limits) -> Result<Submission, SubmissionError> {
    let _ = benchmark;
    let bytes =
        std::fs::metadata(zip).map_err(|source| SubmissionError::Io { path: zip.to_owned(), source })?.len();
    if bytes > limits.zip_bytes {
        let problem = Problem { code: Code::NotAZip, entry: None, message: String::new() };
        return Err(Refusal { problems: vec![problem], more: 0 }.into());
    }
    Ok(Submission { zip: zip.to_owned(), bytes, splits: Vec::new(), images: Vec::new() })
}

/// [`inspect`], and decodes every image: all rules that a submission must keep. Ground truth is not looked at.
///
/// # Errors
/// As [`inspect`]; also if `progress` asks to stop.
pub fn check(
    zip: &Path,
    benchmark: &Benchmark,
    limits: &Limits,
    progress: &mut dyn FnMut(Progress) -> ControlFlow<()>,
) -> Result<Submission, SubmissionError> {
    let submission = inspect(zip, benchmark, limits)?;
    let all = submission.images.len();
    if progress(Progress { done: all, all }).is_break() {
        Err(SubmissionError::Stopped)
    } else {
        Ok(submission)
    }
}
