//! `relight capture detect`: corners of a ChArUco board in an image.

use std::path::PathBuf;

use anyhow::Context;
use relight_capture::calibration::{Corner, detect};
use relight_scene::read_image;
use serde::Serialize;

use super::board::{BoardOfRig, described};
use crate::console::{print_json, print_line};

/// Find the corners of a ChArUco board in an image.
///
/// Corners are numbered and placed as OpenCV's CharucoDetector does: row by row from the board's top left, pixel centres at
/// integers. A corner that is not clearly seen is left out. If the image shows no such board, there are no corners, and a
/// warning says so.
#[derive(clap::Args)]
#[command(
    after_help = "Example:\n  relight capture detect view.png --board 7x5 --square 0.03 --marker 0.0225 \
                        --dictionary DICT_4X4_50 --json\n\nWrites {\"corners\":[{\"id\",\"x\",\"y\"},…]}."
)]
pub struct Args {
    /// A PNG, JPEG or WebP image.
    image: PathBuf,
    #[command(flatten)]
    board: BoardOfRig,
    /// One JSON object on standard output.
    #[arg(long)]
    json: bool,
}

#[derive(Serialize)]
struct Answer {
    corners: Vec<Corner>,
}

pub fn run(args: &Args) -> anyhow::Result<()> {
    let board = args.board.board()?;
    let file = args.image.display().to_string();
    let corners = detect(&read_image(&args.image)?, &board).with_context(|| file.clone())?;
    if corners.is_empty() {
        tracing::warn!(
            "{file}: no {} is seen; check columns, rows and dictionary, and that the board is lit, sharp and mostly inside the image",
            described(&board)
        );
    }
    if args.json {
        return print_json(&Answer { corners });
    }
    print_line(&format!("{} of {} corners", corners.len(), board.corners()))?;
    corners.iter().try_for_each(|c| print_line(&format!("{:4} {:10.3} {:10.3}", c.id, c.x, c.y)))
}
