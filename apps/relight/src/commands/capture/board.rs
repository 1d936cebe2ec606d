//! `relight capture board`: a ChArUco board to print; and the options that describe one.

use std::io::Write;
use std::path::PathBuf;

use anyhow::{Context, bail};
use relight_capture::calibration::{Board, BoardSettings, Dictionary, Sheet};
use relight_capture::rig::RigFile;
use relight_scene::write_whole;

use crate::console::print_line;

/// Draw a ChArUco board to print, in true millimetres.
///
/// Print at 100 % (no fitting to the page), glue it to something flat and stiff, and measure some squares: the measured side is
/// what the other commands want.
#[derive(clap::Args)]
#[command(
    after_help = "Example:\n  relight capture board --board 7x5 --square 0.03 --marker 0.0225 --dictionary \
                        DICT_4X4_50 --out board.pdf\n  relight capture board --rig rig.toml --out board.pdf"
)]
pub struct Args {
    #[command(flatten)]
    board: BoardOfRig,
    /// The file: .svg or .pdf.
    #[arg(long)]
    out: PathBuf,
}

pub fn run(args: &Args) -> anyhow::Result<()> {
    let sheet = Sheet::new(&args.board.board()?);
    let file = args.out.display();
    let bytes = match args.out.extension().and_then(|e| e.to_str()) {
        Some("svg") => sheet.svg().into_bytes(),
        Some("pdf") => sheet.pdf().into_bytes(),
        _ => bail!("{file}: boards are drawn as .svg or .pdf; end the name in one of them"),
    };
    write_whole(&args.out, |out| out.write_all(&bytes)).with_context(|| file.to_string())?;
    let [width, height] = sheet.size_mm();
    print_line(&format!("{file}: {width:.1} x {height:.1} mm; print at 100 %"))
}

/// Which board; if nothing else is said, one that fills the rig's photographs and prints on A3.
#[derive(clap::Args)]
pub struct BoardOptions {
    /// Squares along x and y [default: 12x9, or the rig file's].
    #[arg(long, value_name = "COLUMNSxROWS", value_parser = squares)]
    board: Option<(u32, u32)>,
    /// Side of a square, metres [default: 0.027, or the rig file's].
    #[arg(long, value_name = "METRES")]
    square: Option<f64>,
    /// Side of a marker with its black rim, metres [default: 0.02025, or the rig file's].
    #[arg(long, value_name = "METRES")]
    marker: Option<f64>,
    /// The markers' dictionary, by OpenCV's name: DICT_4X4_50, … [default: DICT_5X5_100, or the rig file's].
    #[arg(long, value_name = "NAME", value_parser = Dictionary::named)]
    dictionary: Option<Dictionary>,
}

impl BoardOptions {
    /// The board that a rig file's table describes, with what was said here.
    pub fn board(&self, of_rig: Option<&BoardSettings>) -> anyhow::Result<Board> {
        let usual = || -> anyhow::Result<BoardSettings> {
            let dictionary = Dictionary::named("DICT_5X5_100")?;
            Ok(BoardSettings {
                columns: 12,
                rows: 9,
                square_metres: 0.027,
                marker_metres: 0.02025,
                dictionary,
            })
        };
        let BoardSettings { columns, rows, square_metres, marker_metres, dictionary } =
            of_rig.map_or_else(usual, |board| Ok(*board))?;
        let (columns, rows) = self.board.unwrap_or((columns, rows));
        let (square, marker) = (self.square.unwrap_or(square_metres), self.marker.unwrap_or(marker_metres));
        Ok(Board::new(columns, rows, square, marker, self.dictionary.unwrap_or(dictionary))?)
    }
}

/// Which board, where nothing else is asked of a rig file.
#[derive(clap::Args)]
pub struct BoardOfRig {
    /// A rig file with a table `[board]`.
    #[arg(long, value_name = "FILE")]
    rig: Option<PathBuf>,
    #[command(flatten)]
    options: BoardOptions,
}

impl BoardOfRig {
    pub fn board(&self) -> anyhow::Result<Board> {
        let file = self.rig.as_deref().map(RigFile::read).transpose()?;
        self.options.board(file.as_ref().and_then(|file| file.board.as_ref()))
    }
}

/// A board for people.
pub fn described(board: &Board) -> String {
    let (columns, rows) = (board.columns(), board.rows());
    format!("board of {columns}x{rows} squares with markers of {}", board.dictionary().name())
}

fn squares(text: &str) -> Result<(u32, u32), String> {
    let numbers = text.split_once(['x', 'X']).map(|(columns, rows)| (columns.parse(), rows.parse()));
    match numbers {
        Some((Ok(columns), Ok(rows))) => Ok((columns, rows)),
        _ => Err("this wants columns and rows of squares, as in 7x5".to_owned()),
    }
}
