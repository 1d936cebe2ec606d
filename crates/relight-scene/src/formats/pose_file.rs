//! Text files that hold one 4x4 matrix.

use std::path::Path;

use crate::error::{FaultKind, SceneError};
use crate::files;
use crate::pose::{Pose, PoseFault};

const LONGEST: u64 = 1 << 16;

/// Reads a pose: 16 numbers apart by white space, row by row.
pub(crate) fn read(path: &Path) -> Result<Pose, SceneError> {
    parse(&files::read_text(path, LONGEST)?)
        .map_err(|(kind, problem, mend)| SceneError::fault(kind, path, problem, mend))
}

type Problem = (FaultKind, String, &'static str);

/// The pose in a text.
pub(crate) fn parse(text: &str) -> Result<Pose, Problem> {
    const SHAPE: &str = "A pose file holds a 4x4 matrix, row by row, its numbers apart by spaces.";
    let mut numbers = Vec::new();
    for word in text.split_whitespace() {
        let number: f64 = word.parse().map_err(|_| {
            let shown: String = word.chars().take(20).collect();
            (FaultKind::Malformed, format!("{shown:?} is not a number"), SHAPE)
        })?;
        numbers.push(number);
    }
    let matrix: [f64; 16] = numbers.as_slice().try_into().map_err(|_| {
        (FaultKind::Malformed, format!("holds {} numbers instead of 16", numbers.len()), SHAPE)
    })?;
    Pose::from_matrix(&matrix).map_err(|fault| (FaultKind::Pose, fault.to_string(), mend(&fault)))
}

/// How a matrix that is no pose may be mended.
pub(crate) fn mend(fault: &PoseFault) -> &'static str {
    match fault {
        PoseFault::NotFinite => "Write the pose anew from where it came from.",
        PoseFault::Transposed => {
            "Transpose it: poses are to-world matrices, row-major, with the translation in the last column."
        }
        PoseFault::LastRow => "Poses are rigid 4x4 to-world matrices, row-major, whose last row is 0 0 0 1.",
        PoseFault::Scaled(_) => {
            "Divide the rotation part by its scale: poses are rigid, to-world, in metres."
        }
        PoseFault::NotOrthonormal(_) => {
            "Poses are rigid to-world matrices in metres; this one shears, or its numbers are mixed up: write it anew."
        }
        PoseFault::Mirrored => {
            "An axis is reversed: poses are right-handed, with OpenCV's camera axes (+X right, +Y down, +Z forward)."
        }
        PoseFault::TooFar => "Poses are in metres: divide the translation by its unit.",
    }
}
