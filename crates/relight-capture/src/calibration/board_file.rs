//! `board.toml`: the board of a session, where it lies, and where the light's arm touched it.

use std::path::{Path, PathBuf};

use relight_scene::{Pose, PoseFault, SceneError, read_text};
use serde::{Deserialize, Serialize};

use super::board::{Board, BoardError};
use super::dictionary::{Dictionary, UnknownDictionary};
use super::light::Touch;

/// The file's longest length, bytes.
const LONGEST: u64 = 1 << 20;

/// What a person says about the board of a session.
#[derive(Clone, Debug, PartialEq)]
pub struct BoardFile {
    /// The board, measured after printing.
    pub board: Board,
    /// Where it lies, if not [flat in the middle of the world](Board::lying_flat).
    pub board_to_world: Option<Pose>,
    /// Base-of-the-light's-arm-to-world, whose rotation is taken as declared.
    pub light_base_to_world: Option<Pose>,
    /// Where the light's arm touched the board.
    pub touches: Vec<Touch>,
}

/// Why a `board.toml` tells of no board.
#[derive(Debug, thiserror::Error)]
pub enum BoardFileError {
    /// The file cannot be read.
    #[error(transparent)]
    Read(#[from] SceneError),
    /// The file is no TOML of a board.
    #[error("{}: {error}", .path.display())]
    Malformed {
        /// The file.
        path: PathBuf,
        /// Where it goes wrong.
        error: toml::de::Error,
    },
    /// The dictionary is not known.
    #[error("{}: {error}", .path.display())]
    Dictionary {
        /// The file.
        path: PathBuf,
        /// Which are known.
        error: UnknownDictionary,
    },
    /// There can be no such board.
    #[error("{}: {error}", .path.display())]
    Board {
        /// The file.
        path: PathBuf,
        /// Why.
        error: BoardError,
    },
    /// Sixteen numbers are no pose.
    #[error("{}: {key}: {fault}", .path.display())]
    Pose {
        /// The file.
        path: PathBuf,
        /// Which numbers.
        key: &'static str,
        /// What is wrong with them.
        fault: PoseFault,
    },
}

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields, rename_all = "kebab-case")]
struct File {
    columns: u32,
    rows: u32,
    square_metres: f64,
    marker_metres: f64,
    dictionary: String,
    #[serde(skip_serializing_if = "Option::is_none")]
    board_to_world: Option<[f64; 16]>,
    #[serde(skip_serializing_if = "Option::is_none")]
    light_base_to_world: Option<[f64; 16]>,
    #[serde(default)]
    touches: Vec<TouchFile>,
}

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields, rename_all = "kebab-case")]
struct TouchFile {
    on_board_metres: [f64; 3],
    in_arm_metres: [f64; 3],
}

impl BoardFile {
    /// Reads a file.
    ///
    /// # Errors
    /// [`BoardFileError`], which names the file.
    pub fn read(path: &Path) -> Result<BoardFile, BoardFileError> {
        let text = read_text(path, LONGEST)?;
        let path = || path.to_owned();
        let file: File =
            toml::from_str(&text).map_err(|error| BoardFileError::Malformed { path: path(), error })?;
        let dictionary = Dictionary::named(&file.dictionary)
            .map_err(|error| BoardFileError::Dictionary { path: path(), error })?;
        let board = Board::new(file.columns, file.rows, file.square_metres, file.marker_metres, dictionary)
            .map_err(|error| BoardFileError::Board { path: path(), error })?;
        let pose = |key, numbers: Option<[f64; 16]>| {
            let pose = numbers.as_ref().map(Pose::from_matrix).transpose();
            pose.map_err(|fault| BoardFileError::Pose { path: path(), key, fault })
        };
        Ok(BoardFile {
            board,
            board_to_world: pose("board-to-world", file.board_to_world)?,
            light_base_to_world: pose("light-base-to-world", file.light_base_to_world)?,
            touches: file
                .touches
                .iter()
                .map(|t| Touch { on_board: t.on_board_metres, in_arm: t.in_arm_metres })
                .collect(),
        })
    }

    /// The file's text.
    ///
    /// # Errors
    /// If TOML cannot hold a number.
    pub fn to_toml(&self) -> Result<String, toml::ser::Error> {
        let touch = |t: &Touch| TouchFile { on_board_metres: t.on_board, in_arm_metres: t.in_arm };
        toml::to_string(&File {
            columns: self.board.columns(),
            rows: self.board.rows(),
            square_metres: self.board.square(),
            marker_metres: self.board.marker(),
            dictionary: self.board.dictionary().name().to_owned(),
            board_to_world: self.board_to_world.as_ref().map(Pose::to_matrix),
            light_base_to_world: self.light_base_to_world.as_ref().map(Pose::to_matrix),
            touches: self.touches.iter().map(touch).collect(),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_written_is_read_again() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("board.toml");
        let dictionary = Dictionary::named("DICT_5X5_100").unwrap();
        let board = Board::new(12, 9, 0.027, 0.02025, dictionary).unwrap();
        let turned = Pose([[0.0, -1.0, 0.0, 0.1], [1.0, 0.0, 0.0, 0.2], [0.0, 0.0, 1.0, 0.3]]);
        let touch = Touch { on_board: [0.324, 0.0, 0.0], in_arm: [-0.123_456_789_012_345_67, 0.5, 1e-9] };
        for (pose, touches) in [(None, vec![]), (Some(turned), vec![touch, touch])] {
            let file = BoardFile { board, board_to_world: pose, light_base_to_world: pose, touches };
            std::fs::write(&path, file.to_toml().unwrap()).unwrap();
            assert_eq!(BoardFile::read(&path).unwrap(), file);
        }
    }
}
