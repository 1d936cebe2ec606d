//! What can be wrong with a folder, and how it is said.

use std::borrow::Cow;
use std::fmt;
use std::path::{Path, PathBuf};

use serde::Serialize;

/// Characters of a path or a problem that are shown.
const SHOWN: usize = 400;

/// How bad a fault is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Severity {
    /// Worth knowing; nothing needs mending.
    Note,
    /// The scene can be used, but probably not as it was meant.
    Warning,
    /// The scene cannot be used.
    Error,
}

impl fmt::Display for Severity {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Severity::Note => "note",
            Severity::Warning => "warning",
            Severity::Error => "error",
        })
    }
}

/// What sort of thing a fault is about.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
#[non_exhaustive]
pub enum FaultKind {
    /// A file or folder that should be there is not.
    Missing,
    /// A file or folder that should not be there is.
    Extra,
    /// A file cannot be read or written.
    Unreadable,
    /// A file's text is not what it should be.
    Malformed,
    /// A matrix is not a pose.
    Pose,
    /// Poses follow another convention than they should.
    Convention,
    /// A lens model that cannot be.
    Lens,
    /// Files of one scene contradict each other.
    Inconsistent,
    /// An image cannot be decoded whole.
    Image,
    /// An image's size is not its camera's, or beyond all reason.
    Size,
    /// An image is all black.
    Black,
    /// A light stands where no light can be.
    Placement,
    /// A file was written by a program that this one does not know.
    Version,
    /// Too little is left to train or score on.
    Split,
}

/// One thing wrong with a folder.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Fault {
    /// How bad it is.
    pub severity: Severity,
    /// What it is about.
    pub kind: FaultKind,
    /// The file or folder at fault.
    pub path: PathBuf,
    /// What is wrong, without a full stop at the end.
    pub problem: String,
    /// How to mend it: whole sentences; may be empty for notes.
    pub mend: String,
}

impl fmt::Display for Fault {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}: {}.", shortened(&self.path.to_string_lossy()), shortened(&self.problem))?;
        if self.mend.is_empty() { Ok(()) } else { write!(f, " {}", self.mend) }
    }
}

/// A text that may be quoted from a hostile file, without its middle if it is long.
fn shortened(text: &str) -> Cow<'_, str> {
    let length = text.chars().count();
    if length <= SHOWN {
        return text.into();
    }
    let part = |skip| text.chars().skip(skip).take(SHOWN / 2).collect::<String>();
    format!("{} […] {}", part(0), part(length - SHOWN / 2)).into()
}

/// Why a scene, a split or pixels cannot be had.
#[derive(Debug, thiserror::Error)]
pub enum SceneError {
    /// A file or folder is at fault; the message names it, says what is wrong and how to mend it.
    #[error("{0}")]
    Fault(Fault),
    /// The caller asked for a frame that the scene does not have.
    #[error("there is no frame {frame}: the scene has {frames}")]
    NoSuchFrame {
        /// What was asked for.
        frame: usize,
        /// How many there are.
        frames: usize,
    },
    /// A split was asked for by a name that is none.
    #[error("there is no split {0:?}: the splits are train, val, easy and hard")]
    NoSuchSplit(String),
    /// The caller's progress function asked to stop.
    #[error("stopped before all images were loaded")]
    Cancelled,
    /// There are too many training pixels for the memory and for the disk.
    #[error(
        "{bytes} bytes of training pixels are too many to be held in memory, and cannot be kept in a cache file either \
         ({cache}). Set RELIGHT_CACHE to a folder outside the dataset with that many bytes free, or choose fewer or \
         smaller images."
    )]
    Memory {
        /// What would be needed.
        bytes: usize,
        /// Why there is no cache file.
        cache: String,
    },
}

impl SceneError {
    /// An error about a file.
    pub(crate) fn fault(
        kind: FaultKind,
        path: &Path,
        problem: impl Into<String>,
        mend: impl Into<String>,
    ) -> SceneError {
        SceneError::Fault(Fault {
            severity: Severity::Error,
            kind,
            path: path.to_owned(),
            problem: problem.into(),
            mend: mend.into(),
        })
    }

    /// An error of the file system.
    pub(crate) fn io(path: &Path, doing: &str, error: &std::io::Error) -> SceneError {
        let (kind, mend) = match error.kind() {
            std::io::ErrorKind::NotFound => (FaultKind::Missing, "Check the path."),
            std::io::ErrorKind::PermissionDenied => (FaultKind::Unreadable, "Check its permissions."),
            _ => (FaultKind::Unreadable, "Check the disk and the path."),
        };
        SceneError::fault(kind, path, format!("cannot {doing}: {error}"), mend)
    }
}

/// Faults in the order in which they were found.
#[derive(Debug, Default)]
pub(crate) struct Faults(pub(crate) Vec<Fault>);

impl Faults {
    fn push(&mut self, severity: Severity, kind: FaultKind, path: &Path, problem: String, mend: &str) {
        self.0.push(Fault { severity, kind, path: path.to_owned(), problem, mend: mend.to_owned() });
    }

    pub(crate) fn error(&mut self, kind: FaultKind, path: &Path, problem: impl Into<String>, mend: &str) {
        self.push(Severity::Error, kind, path, problem.into(), mend);
    }

    pub(crate) fn warning(&mut self, kind: FaultKind, path: &Path, problem: impl Into<String>, mend: &str) {
        self.push(Severity::Warning, kind, path, problem.into(), mend);
    }

    pub(crate) fn note(&mut self, kind: FaultKind, path: &Path, problem: impl Into<String>, mend: &str) {
        self.push(Severity::Note, kind, path, problem.into(), mend);
    }

    /// Keeps the value, or notes why there is none.
    pub(crate) fn keep<T>(&mut self, result: Result<T, SceneError>) -> Option<T> {
        match result {
            Ok(value) => Some(value),
            Err(SceneError::Fault(fault)) => {
                self.0.push(fault);
                None
            }
            Err(other) => {
                self.error(FaultKind::Unreadable, Path::new(""), other.to_string(), "");
                None
            }
        }
    }

    pub(crate) fn first_error(&self) -> Option<&Fault> {
        self.0.iter().find(|fault| fault.severity == Severity::Error)
    }
}
