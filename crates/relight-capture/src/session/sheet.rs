//! A contact sheet of what is shot so far: a row a view, a column a light.

use std::io::Write;
use std::path::Path;

use relight_scene::{Image, write_whole};

use super::{STATE, SessionError, Shots};

/// The sheet, in the folder [`STATE`].
pub const SHEET: &str = "sheet.png";
/// Width of a picture on it, pixels.
const WIDTH: u32 = 32;
/// Where nothing is shot yet.
const GROUND: u8 = 24;

/// The sheet as it stands.
pub(super) struct Sheet {
    canvas: Image,
    /// Width and height of a picture on it.
    cell: [u32; 2],
}

impl Sheet {
    /// An empty sheet.
    pub(super) fn new(shots: &Shots) -> Sheet {
        let lens = &shots.intrinsics;
        let cell = [WIDTH, (WIDTH * lens.height / lens.width).clamp(1, 4 * WIDTH)];
        let (width, height) = (cell[0] * shots.lights.len() as u32, cell[1] * shots.cameras.len() as u32);
        let data = vec![GROUND; 3 * width as usize * height as usize];
        Sheet { canvas: Image { width, height, data }, cell }
    }

    /// Puts a photograph in its place, each of its pixels the mean of those it stands for.
    pub(super) fn put(&mut self, view: usize, light: usize, image: &Image) {
        let [w, h] = self.cell.map(|side| side as usize);
        let (wide, high) = (image.width as usize, image.height as usize);
        let span =
            |i: usize, n: usize, full: usize| (i * full / n)..((i + 1) * full / n).max(i * full / n + 1);
        for y in 0..h {
            for x in 0..w {
                let (rows, columns) = (span(y, h, high), span(x, w, wide));
                let pixels = (rows.len() * columns.len()) as u32;
                let mut sums = [0u32; 3];
                for row in rows {
                    for column in columns.clone() {
                        (0..3).for_each(|c| sums[c] += u32::from(image.data[3 * (row * wide + column) + c]));
                    }
                }
                let at = 3 * ((view * h + y) * self.canvas.width as usize + light * w + x);
                self.canvas.data[at..at + 3].copy_from_slice(&sums.map(|sum| (sum / pixels) as u8));
            }
        }
    }

    /// Writes the sheet as it stands.
    pub(super) fn write(&self, out: &Path) -> Result<(), SessionError> {
        let path = out.join(STATE).join(SHEET);
        let png = self.canvas.png().map_err(SessionError::io(&path))?;
        write_whole(&path, |file| file.write_all(&png)).map_err(SessionError::io(&path))
    }
}
