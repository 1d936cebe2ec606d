//! `board.toml`: the board of a session, where it lies, and where the light's arm touched it.

use std::path::{Path, PathBuf};

use relight_scene::{Pose, PoseFault, SceneError, read_text};
use serde::{Deserialize, Serialize};

use super::board::{Board, BoardError};
use super::dictionary::{Dictionary, UnknownDictionary};
use super::light::Touch;

/// The file's longest length, bytes.
const LONGEST: u64 = 1 << 20;

/// A board as a person writes it in a rig file, measured after printing.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields, rename_all = "kebab-case")]
pub struct BoardSettings {
    /// Squares along x.
    pub columns: u32,
    /// Squares along y.
    pub rows: u32,
    /// Side of a square.
    pub square_metres: f64,
    /// Side of a marker with its black rim.
    pub marker_metres: f64,
    /// The markers' dictionary.
    pub dictionary: Dictionary,
}

impl BoardSettings {
    /// The board.
    ///
    /// # Errors
    /// If there can be no such board.
    pub fn board(&self) -> Result<Board, BoardError> {
        Board::new(self.columns, self.rows, self.square_metres, self.marker_metres, self.dictionary)
    }
}

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
    /// Not all is said of the board.
    #[error(
        "{}: tells of no board. It wants columns, rows, square-metres, marker-metres and dictionary; or none of them, and a rig \
         file with a table [board] (--rig).",
        .0.display()
    )]
    NoBoard(PathBuf),
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
    columns: Option<u32>,
    rows: Option<u32>,
    square_metres: Option<f64>,
    marker_metres: Option<f64>,
    dictionary: Option<String>,
    #[serde(skip_serializing_if = "Option::is_none")]
    board_to_world: Option<[f64; 16]>,
    #[serde(skip_serializing_if = "Option::is_none")]
    light_base_to_world: Option<[f64; 16]>,
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    touches: Vec<TouchFile>,
}

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields, rename_all = "kebab-case")]
struct TouchFile {
    on_board_metres: [f64; 3],
    in_arm_metres: [f64; 3],
}

impl BoardFile {
    /// Reads a file. Where it says nothing of the board, that is the rig's; with one, there need be no file.
    ///
    /// # Errors
    /// [`BoardFileError`], which names the file.
    pub fn read(path: &Path, of_rig: Option<Board>) -> Result<BoardFile, BoardFileError> {
        let text = if of_rig.is_some() && !path.exists() { String::new() } else { read_text(path, LONGEST)? };
        let path = || path.to_owned();
        let file: File =
            toml::from_str(&text).map_err(|error| BoardFileError::Malformed { path: path(), error })?;
        let said = (file.columns, file.rows, file.square_metres, file.marker_metres, &file.dictionary);
        let board = match (said, of_rig) {
            ((Some(columns), Some(rows), Some(square), Some(marker), Some(dictionary)), _) => {
                let dictionary = Dictionary::named(dictionary)
                    .map_err(|error| BoardFileError::Dictionary { path: path(), error })?;
                Board::new(columns, rows, square, marker, dictionary)
                    .map_err(|error| BoardFileError::Board { path: path(), error })?
            }
            ((None, None, None, None, None), Some(board)) => board,
            _ => return Err(BoardFileError::NoBoard(path())),
        };
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
            columns: Some(self.board.columns()),
            rows: Some(self.board.rows()),
            square_metres: Some(self.board.square()),
            marker_metres: Some(self.board.marker()),
            dictionary: Some(self.board.dictionary().name().to_owned()),
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
            assert_eq!(BoardFile::read(&path, None).unwrap(), file);
        }
        // A rig's board stands in where nothing is said of one, and nowhere else.
        let other = Board::new(5, 4, 0.03, 0.02, dictionary).unwrap();
        assert_eq!(BoardFile::read(&path, Some(other)).unwrap().board, board);
        std::fs::write(&path, "columns = 9").unwrap();
        assert!(matches!(BoardFile::read(&path, Some(other)), Err(BoardFileError::NoBoard(_))));
        std::fs::write(&path, "").unwrap();
        assert_eq!(BoardFile::read(&path, Some(other)).unwrap().board, other);
        assert!(matches!(BoardFile::read(&path, None), Err(BoardFileError::NoBoard(_))));
        std::fs::remove_file(&path).unwrap();
        assert_eq!(BoardFile::read(&path, Some(other)).unwrap().touches, []);
        assert!(matches!(BoardFile::read(&path, None), Err(BoardFileError::Read(_))));
    }
}
