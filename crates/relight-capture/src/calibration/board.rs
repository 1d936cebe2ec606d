//! The ChArUco board: a chessboard with a marker in every white square.

use calib_targets_charuco::{CharucoBoardSpec, MarkerLayout};
use relight_scene::Pose;
use serde::{Deserialize, Serialize};

use super::dictionary::Dictionary;

/// Fewest squares a side: four corners at least, that not all lie on a line.
const FEWEST: u32 = 3;
/// Longest side of a square, metres.
const LARGEST_SQUARE: f64 = 10.0;
/// Smallest marker, as a share of its square: smaller ones cannot be read.
const SMALLEST_MARKER: f64 = 0.1;

/// A ChArUco board as OpenCV's `CharucoBoard` lays it out (not its legacy pattern): the square at the top left is black, the
/// white squares hold markers 0, 1, 2 … row by row, and inner corners are numbered row by row.
///
/// The board's frame is OpenCV's: its origin is the outer corner at the top left, +X runs along the columns, +Y down the rows,
/// +Z into the paper. A camera that sees the board has a negative z.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "Measures")]
pub struct Board {
    columns: u32,
    rows: u32,
    square: f64,
    marker: f64,
    dictionary: Dictionary,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Measures {
    columns: u32,
    rows: u32,
    square: f64,
    marker: f64,
    dictionary: Dictionary,
}

/// Why there can be no such board.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum BoardError {
    /// Too few squares.
    #[error(
        "a board of {columns}x{rows} squares has too few corners; it needs {FEWEST} squares a side at least"
    )]
    TooFewSquares {
        /// Squares along x.
        columns: u32,
        /// Squares along y.
        rows: u32,
    },
    /// The sizes are no lengths of a board.
    #[error(
        "squares of {square} m with markers of {marker} m: both are lengths in metres, the square at most {LARGEST_SQUARE} m, the \
         marker smaller than the square and no less than a tenth of it"
    )]
    Lengths {
        /// Side of a square, metres.
        square: f64,
        /// Side of a marker, metres.
        marker: f64,
    },
    /// The dictionary has fewer markers than the board has white squares.
    #[error(
        "a board of {columns}x{rows} squares needs {needed} markers, but {dictionary} has {markers}; take a larger dictionary"
    )]
    TooFewMarkers {
        /// Squares along x.
        columns: u32,
        /// Squares along y.
        rows: u32,
        /// White squares.
        needed: u64,
        /// The dictionary's name.
        dictionary: &'static str,
        /// The dictionary's markers.
        markers: usize,
    },
}

impl Board {
    /// A board of `columns` x `rows` squares; `square` and `marker` are their sides in metres, the marker's with its black rim.
    ///
    /// # Errors
    /// If there can be no such board.
    pub fn new(
        columns: u32,
        rows: u32,
        square: f64,
        marker: f64,
        dictionary: Dictionary,
    ) -> Result<Board, BoardError> {
        if columns < FEWEST || rows < FEWEST {
            return Err(BoardError::TooFewSquares { columns, rows });
        }
        let is_length = |v: f64| v.is_finite() && v > 0.0;
        let fits = marker < square && marker >= SMALLEST_MARKER * square;
        if !(is_length(square) && is_length(marker) && square <= LARGEST_SQUARE && fits) {
            return Err(BoardError::Lengths { square, marker });
        }
        let (needed, markers) = (u64::from(columns) * u64::from(rows) / 2, dictionary.markers());
        if needed > markers as u64 {
            return Err(BoardError::TooFewMarkers {
                columns,
                rows,
                needed,
                dictionary: dictionary.name(),
                markers,
            });
        }
        Ok(Board { columns, rows, square, marker, dictionary })
    }

    /// Squares along x.
    pub fn columns(&self) -> u32 {
        self.columns
    }

    /// Squares along y.
    pub fn rows(&self) -> u32 {
        self.rows
    }

    /// Side of a square, metres.
    pub fn square(&self) -> f64 {
        self.square
    }

    /// Side of a marker with its rim, metres.
    pub fn marker(&self) -> f64 {
        self.marker
    }

    /// The markers' dictionary.
    pub fn dictionary(&self) -> Dictionary {
        self.dictionary
    }

    /// Width and height, metres.
    pub fn size(&self) -> [f64; 2] {
        [f64::from(self.columns) * self.square, f64::from(self.rows) * self.square]
    }

    /// Number of inner corners.
    pub fn corners(&self) -> u32 {
        (self.columns - 1) * (self.rows - 1)
    }

    /// Where inner corner `id` lies in the board's plane, metres; `None` if the board has no such corner.
    pub fn corner(&self, id: u32) -> Option<[f64; 2]> {
        let along = self.columns - 1;
        (id < self.corners())
            .then(|| [f64::from(id % along + 1) * self.square, f64::from(id / along + 1) * self.square])
    }

    /// Whether the board is black at a point of its plane, metres; paper around it is white.
    pub fn is_black(&self, x: f64, y: f64) -> bool {
        let [width, height] = self.size();
        if !((0.0..width).contains(&x) && (0.0..height).contains(&y)) {
            return false;
        }
        let square_of = |v: f64, squares: u32| ((v / self.square) as u32).min(squares - 1);
        let (column, row) = (square_of(x, self.columns), square_of(y, self.rows));
        let Some(marker) = self.marker_in(column, row) else { return true };
        let cells = self.dictionary.cells() as f64;
        let cell_of = |v: f64, square: u32| {
            let from = v - (f64::from(square) + 0.5) * self.square + self.marker / 2.0;
            (from / self.marker * (cells + 2.0) - 1.0).floor() as isize
        };
        self.dictionary.is_black(marker, cell_of(y, row), cell_of(x, column)).unwrap_or(false)
    }

    /// The marker in a square; `None` in a black one.
    pub(super) fn marker_in(&self, column: u32, row: u32) -> Option<usize> {
        let is_white = (column + row) % 2 == 1;
        // Counted row by row, every pair of squares holds one white one.
        let before = u64::from(row) * u64::from(self.columns) + u64::from(column);
        is_white.then_some((before / 2) as usize)
    }

    /// Board-to-world of a board that lies face up in the middle of the world: +X along its columns, +Y up its rows, +Z out of
    /// the paper.
    pub fn lying_flat(&self) -> Pose {
        let [width, height] = self.size();
        Pose([[1.0, 0.0, 0.0, -width / 2.0], [0.0, -1.0, 0.0, height / 2.0], [0.0, 0.0, -1.0, 0.0]])
    }

    /// The board in units of its squares, for the detector.
    pub(super) fn specification(&self) -> CharucoBoardSpec {
        let ratio = (self.marker / self.square) as f32;
        CharucoBoardSpec::new(self.rows, self.columns, 1.0, ratio, self.dictionary.codes())
            .with_marker_layout(MarkerLayout::OpenCvCharuco)
    }
}

impl TryFrom<Measures> for Board {
    type Error = BoardError;

    fn try_from(m: Measures) -> Result<Board, BoardError> {
        Board::new(m.columns, m.rows, m.square, m.marker, m.dictionary)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn dictionary() -> Dictionary {
        Dictionary::named("4X4_50").unwrap()
    }

    #[test]
    fn corners_are_numbered_row_by_row() {
        let board = Board::new(7, 5, 0.03, 0.02, dictionary()).unwrap();
        assert_eq!(board.corners(), 24);
        assert_eq!(board.corner(0), Some([0.03, 0.03]));
        assert_eq!(board.corner(6), Some([0.03, 0.06]));
        assert_eq!(board.corner(24), None);
    }

    #[test]
    fn a_board_that_lies_flat_faces_up_around_the_origin() {
        let board = Board::new(8, 6, 0.025, 0.02, dictionary()).unwrap();
        let pose = board.lying_flat();
        let lies = |on_board: [f64; 3], at: [f64; 3]| {
            let found = pose.transform(on_board);
            assert!((0..3).all(|i| (found[i] - at[i]).abs() < 1e-12), "{found:?} {at:?}");
        };
        lies([0.1, 0.075, 0.0], [0.0, 0.0, 0.0]);
        lies([0.0, 0.0, -1.0], [-0.1, 0.075, 1.0]);
    }

    #[test]
    fn boards_that_cannot_be_are_refused() {
        let fault = |columns, rows, square, marker| {
            Board::new(columns, rows, square, marker, dictionary()).unwrap_err().to_string()
        };
        assert!(fault(2, 9, 0.03, 0.02).contains("2x9"));
        assert!(fault(7, 5, 0.03, 0.03).contains("smaller than the square"));
        for bad in [0.0, -1.0, f64::NAN, f64::INFINITY, 11.0] {
            assert!(fault(7, 5, bad, 0.02).contains("metres"), "{bad}");
        }
        assert!(fault(7, 5, 0.03, f64::NAN).contains("metres"));
        assert!(fault(11, 10, 0.03, 0.02).contains("needs 55 markers, but DICT_4X4_50 has 50"));
        assert!(fault(u32::MAX, u32::MAX, 0.03, 0.02).contains("larger dictionary"));
    }
}
