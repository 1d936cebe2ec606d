//! A board to print.

use std::fmt::Write;

use super::board::Board;

/// White around the board, millimetres: the outer squares need it, and printers cannot print to the edge.
const MARGIN: f64 = 10.0;
/// Height of the line of text below the board, millimetres.
const TEXT: f64 = 3.0;
/// Points a millimetre.
const POINTS: f64 = 72.0 / 25.4;

/// A board on a sheet of paper, in millimetres from the sheet's top left.
#[derive(Clone, Debug)]
pub struct Sheet {
    size: [f64; 2],
    /// Left, top, width, height.
    black: Vec<[f64; 4]>,
    caption: String,
}

impl Sheet {
    /// The board with a white margin and a line that says what it is.
    pub fn new(board: &Board) -> Sheet {
        let side = board.square() * 1e3;
        let mut black = Vec::new();
        for row in 0..board.rows() {
            for column in 0..board.columns() {
                let corner = [column, row].map(|k| MARGIN + f64::from(k) * side);
                match board.marker_in(column, row) {
                    None => black.push([corner[0], corner[1], side, side]),
                    Some(marker) => draw_marker(board, marker, corner, &mut black),
                }
            }
        }
        let [width, height] = board.size().map(|v| v * 1e3);
        let caption = format!(
            "{} x {} squares of {:.3} mm, markers of {:.3} mm, {}; the board is {width:.1} mm wide. Print at 100 %.",
            board.columns(),
            board.rows(),
            side,
            board.marker() * 1e3,
            board.dictionary().name()
        );
        Sheet { size: [width + 2.0 * MARGIN, height + 2.0 * MARGIN], black, caption }
    }

    /// Width and height of the sheet, millimetres.
    pub fn size_mm(&self) -> [f64; 2] {
        self.size
    }

    /// The sheet as SVG.
    pub fn svg(&self) -> String {
        let [width, height] = self.size;
        let mut path = String::new();
        for [x, y, w, h] in &self.black {
            // Writing to a string does not fail.
            let _ = write!(path, "M{x:.4} {y:.4}h{w:.4}v{h:.4}h{:.4}z", -w);
        }
        format!(
            "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{width:.4}mm\" height=\"{height:.4}mm\" \
             viewBox=\"0 0 {width:.4} {height:.4}\">\n\
             <rect width=\"100%\" height=\"100%\" fill=\"white\"/>\n\
             <path shape-rendering=\"crispEdges\" d=\"{path}\"/>\n\
             <text x=\"{MARGIN}\" y=\"{:.4}\" font-family=\"sans-serif\" font-size=\"{TEXT}\">{}</text>\n</svg>\n",
            height - MARGIN / 2.0 + TEXT / 2.0,
            self.caption
        )
    }

    /// The sheet as PDF: one page of its size.
    pub fn pdf(&self) -> String {
        let [width, height] = self.size.map(|v| v * POINTS);
        let mut content = format!("{POINTS} 0 0 {} 0 {height:.4} cm\n", -POINTS);
        for [x, y, w, h] in &self.black {
            let _ = writeln!(content, "{x:.4} {y:.4} {w:.4} {h:.4} re");
        }
        let baseline = self.size[1] - MARGIN / 2.0 + TEXT / 2.0;
        let _ = write!(
            content,
            "f\nBT /F1 {TEXT} Tf 1 0 0 -1 {MARGIN} {baseline:.4} Tm ({}) Tj ET",
            self.caption
        );
        let objects = [
            "<</Type/Catalog/Pages 2 0 R>>".to_owned(),
            "<</Type/Pages/Kids[3 0 R]/Count 1>>".to_owned(),
            format!(
                "<</Type/Page/Parent 2 0 R/MediaBox[0 0 {width:.4} {height:.4}]/Contents 4 0 R\
                 /Resources<</Font<</F1 5 0 R>>>>>>"
            ),
            format!("<</Length {}>>\nstream\n{content}\nendstream", content.len()),
            "<</Type/Font/Subtype/Type1/BaseFont/Helvetica>>".to_owned(),
        ];
        let mut file = "%PDF-1.4\n".to_owned();
        let mut table = format!("xref\n0 {}\n0000000000 65535 f \n", objects.len() + 1);
        for (number, object) in (1..).zip(&objects) {
            let _ = writeln!(table, "{:010} 00000 n ", file.len());
            let _ = writeln!(file, "{number} 0 obj\n{object}\nendobj");
        }
        let start = file.len();
        let _ = write!(
            file,
            "{table}trailer\n<</Size {}/Root 1 0 R>>\nstartxref\n{start}\n%%EOF\n",
            objects.len() + 1
        );
        file
    }
}

/// The black cells of a marker, neighbours in a row as one.
fn draw_marker(board: &Board, marker: usize, corner: [f64; 2], black: &mut Vec<[f64; 4]>) {
    let dictionary = board.dictionary();
    let (cells, margin) = (dictionary.cells() as isize, (board.square() - board.marker()) / 2.0 * 1e3);
    let cell = board.marker() * 1e3 / (cells + 2) as f64;
    let is_black = |row: isize, column: isize| dictionary.is_black(marker, row, column).unwrap_or(false);
    for row in -1..=cells {
        let mut column = -1;
        while column <= cells {
            let from = column;
            while is_black(row, column) {
                column += 1;
            }
            if column > from {
                let at = [from, row].map(|k| margin + (k + 1) as f64 * cell);
                black.push([corner[0] + at[0], corner[1] + at[1], (column - from) as f64 * cell, cell]);
            }
            column += 1;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::calibration::Dictionary;

    fn board() -> Board {
        Board::new(5, 4, 0.03, 0.0225, Dictionary::named("DICT_5X5_50").unwrap()).unwrap()
    }

    #[test]
    fn the_sheet_is_black_where_the_board_is() {
        let sheet = Sheet::new(&board());
        assert_eq!(sheet.size_mm(), [170.0, 140.0]);
        for i in 0..340 {
            for j in 0..280 {
                let (x, y) = (f64::from(i) * 0.5 + 0.2, f64::from(j) * 0.5 + 0.2);
                let covers = |[left, top, w, h]: &[f64; 4]| {
                    (*left..left + w).contains(&x) && (*top..top + h).contains(&y)
                };
                let drawn = sheet.black.iter().any(covers);
                assert_eq!(drawn, board().is_black((x - MARGIN) / 1e3, (y - MARGIN) / 1e3), "{x} {y}");
            }
        }
    }

    #[test]
    fn both_files_are_in_true_millimetres() {
        let sheet = Sheet::new(&board());
        assert!(
            sheet
                .svg()
                .contains("width=\"170.0000mm\" height=\"140.0000mm\" viewBox=\"0 0 170.0000 140.0000\"")
        );
        assert!(sheet.pdf().contains("MediaBox[0 0 481.8898 396.8504]"), "{}", sheet.pdf());
    }

    #[test]
    fn the_table_of_the_pdf_points_at_its_objects() {
        let pdf = Sheet::new(&board()).pdf();
        let table = pdf.find("xref").unwrap();
        let offsets = pdf[table..].lines().skip(3).take(5).map(|line| line[..10].parse::<usize>().unwrap());
        for (number, offset) in (1..).zip(offsets) {
            assert!(pdf[offset..].starts_with(&format!("{number} 0 obj")), "{number}");
        }
        let start: usize = pdf.lines().rev().nth(1).unwrap().parse().unwrap();
        assert_eq!(start, table);
    }
}
