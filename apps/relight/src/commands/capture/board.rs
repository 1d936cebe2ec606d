//! `relight capture board`: a ChArUco board to print; and the options that describe one.

use std::fmt;
use std::io::Write;
use std::path::PathBuf;

use anyhow::{Context, bail};
use relight_capture::calibration::{Board, Dictionary, Sheet};
use relight_scene::write_whole;

use crate::console::print_line;

/// Draw a ChArUco board to print, in true millimetres.
///
/// Print at 100 % (no fitting to the page), glue it to something flat and stiff, and measure some squares: the measured side is
/// what the other commands want.
#[derive(clap::Args)]
#[command(
    after_help = "Example:\n  relight capture board --board 7x5 --square 0.03 --marker 0.0225 --dictionary \
                        DICT_4X4_50 --out board.pdf"
)]
pub struct Args {
    #[command(flatten)]
    board: BoardOptions,
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
    /// Squares along x and y.
    #[arg(long, value_name = "COLUMNSxROWS", default_value = "12x9", value_parser = squares)]
    board: (u32, u32),
    /// Side of a square, metres.
    #[arg(long, value_name = "METRES", default_value_t = 0.027)]
    square: f64,
    /// Side of a marker with its black rim, metres.
    #[arg(long, value_name = "METRES", default_value_t = 0.02025)]
    marker: f64,
    /// The markers' dictionary, by OpenCV's name: DICT_4X4_50, …
    #[arg(long, value_name = "NAME", default_value = "DICT_5X5_100", value_parser = Dictionary::named)]
    dictionary: Dictionary,
}

impl BoardOptions {
    pub fn board(&self) -> anyhow::Result<Board> {
        let (columns, rows) = self.board;
        Ok(Board::new(columns, rows, self.square, self.marker, self.dictionary)?)
    }
}

impl fmt::Display for BoardOptions {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (columns, rows) = self.board;
        write!(f, "board of {columns}x{rows} squares with markers of {}", self.dictionary.name())
    }
}

fn squares(text: &str) -> Result<(u32, u32), String> {
    let numbers = text.split_once(['x', 'X']).map(|(columns, rows)| (columns.parse(), rows.parse()));
    match numbers {
        Some((Ok(columns), Ok(rows))) => Ok((columns, rows)),
        _ => Err("this wants columns and rows of squares, as in 7x5".to_owned()),
    }
}
