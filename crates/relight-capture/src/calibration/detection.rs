//! Corners of a ChArUco board in an image.

use calib_targets_charuco::{CharucoCorner, CharucoDetector, CharucoParams, ChessCorner, GrayImageView};
use nalgebra::Vector2;
use relight_scene::Image;
use serde::{Deserialize, Serialize};

use super::board::Board;
use super::recovery::{self, Found};
use super::saddle::Grey;

/// Smallest image, pixels a side: smaller ones hold no square.
const SMALLEST: usize = 32;
/// So many corners are enough to find the others by: fewer, and a larger picture is searched.
const ENOUGH: usize = 12;
/// Largest standard error, radians, of the directions of edges that cross at a corner of the chessboard.
const STRAIGHT: f32 = 0.04;

/// An inner corner of a board in an image. Pixel centres lie at integers.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Corner {
    /// The corner's number on the board.
    pub id: u32,
    /// Pixels from the centre of the leftmost pixel.
    pub x: f64,
    /// Pixels from the centre of the topmost pixel.
    pub y: f64,
}

/// Why an image could not be searched.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum DetectionError {
    /// The pixels are not as many as the image's size says.
    #[error("{held} bytes are no RGB image of {width}x{height} pixels")]
    Size {
        /// Stated width.
        width: u32,
        /// Stated height.
        height: u32,
        /// Bytes held.
        held: usize,
    },
    /// The detector refuses the board.
    #[error("this board cannot be searched for: {0}")]
    Board(String),
}

/// The inner corners of `board` that `image` shows, by rising id; empty if the board is not seen.
///
/// Squares and markers are found by `calib-targets-charuco`; each corner is then fitted to a small part of a pixel, those that
/// were missed are looked for beside those that were found, and what does not look like its corner is left out.
///
/// # Errors
/// If the image's size contradicts its pixels.
pub fn detect(image: &Image, board: &Board) -> Result<Vec<Corner>, DetectionError> {
    let grey = grey_of(image)?;
    if grey.width < SMALLEST || grey.height < SMALLEST {
        return Ok(Vec::new());
    }
    let mut searched = search(&grey, board)?;
    if searched.len() < ENOUGH {
        // Squares that are small, or steep, are larger in a larger picture.
        let larger = search(&grey.doubled(), board)?;
        if larger.len() > searched.len() {
            searched = larger.into_iter().map(|f| Found { at: Grey::halved(f.at), ..f }).collect();
        }
    }
    let found = recovery::refine(&grey, board, &searched);
    Ok(found.into_iter().map(|f| Corner { id: f.id, x: f.at.x, y: f.at.y }).collect())
}

/// The corners that the detector finds.
fn search(grey: &Grey, board: &Board) -> Result<Vec<Found>, DetectionError> {
    let view = GrayImageView { width: grey.width, height: grey.height, data: &grey.data };
    let found = richest(&view, board)?.unwrap_or_default();
    let corner = |corner: &CharucoCorner| {
        let at = Vector2::new(f64::from(corner.position.x), f64::from(corner.position.y));
        Some(Found { id: corner.id, on_board: Vector2::from(board.corner(corner.id)?), at })
    };
    Ok(found.iter().filter_map(corner).collect())
}

/// What the detector finds with the settings that find most: crossings inside markers, sharp and bright, can keep it from the
/// grid, and some settings, or leaving out crossings without straight edges, are then better than others.
fn richest(view: &GrayImageView, board: &Board) -> Result<Option<Vec<CharucoCorner>>, DetectionError> {
    let detectors = CharucoParams::sweep_for_board(&board.specification())
        .into_iter()
        .map(CharucoDetector::new)
        .collect::<Result<Vec<_>, _>>()
        .map_err(|error| DetectionError::Board(error.to_string()))?;
    let Some(first) = detectors.first() else { return Ok(None) };
    let all = first.detect_corners(view);
    let is_straight = |corner: &&ChessCorner| corner.axes.iter().all(|axis| axis.fit_std_error < STRAIGHT);
    let straight: Vec<ChessCorner> = all.iter().filter(is_straight).cloned().collect();
    let mut best: Option<Vec<CharucoCorner>> = None;
    for (detector, crossings) in detectors.iter().flat_map(|d| [(d, &all), (d, &straight)]) {
        let Ok(found) = detector.detect_with_corners(view, crossings) else { continue };
        let count = best.as_ref().map_or(0, Vec::len);
        if found.corners.len() > count {
            best = Some(found.corners);
        }
        if 2 * best.as_ref().map_or(0, Vec::len) > board.corners() as usize {
            break;
        }
    }
    Ok(best)
}

/// Luma as OpenCV has it (ITU-R BT.601).
fn grey_of(image: &Image) -> Result<Grey, DetectionError> {
    let Image { width, height, ref data } = *image;
    if 3 * u64::from(width) * u64::from(height) != data.len() as u64 {
        return Err(DetectionError::Size { width, height, held: data.len() });
    }
    let luma = |rgb: &[u8; 3]| {
        let [r, g, b] = rgb.map(f64::from);
        (0.299 * r + 0.587 * g + 0.114 * b).round() as u8
    };
    let (pixels, _) = data.as_chunks::<3>();
    Ok(Grey { width: width as usize, height: height as usize, data: pixels.iter().map(luma).collect() })
}
