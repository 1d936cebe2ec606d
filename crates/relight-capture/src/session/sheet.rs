//! A contact sheet of what is shot so far: a row a view, a column a light.

use std::io::Write;
use std::path::Path;
use std::time::{Duration, Instant};

use relight_scene::drawing::Canvas;
use relight_scene::{Image, write_whole};

use super::{Progress, STATE, SessionError, Shots};

/// The sheet, in the folder [`STATE`].
pub const SHEET: &str = "sheet.png";
/// Width of a picture on it, pixels.
const WIDTH: u32 = 32;
/// How often it is written anew while the session runs.
const PERIOD: Duration = Duration::from_secs(3);
/// The least width of a sheet that tells how far the session is, pixels.
const WORDS: u32 = 320;
/// Colour of the bar and of its words.
const INK: [u8; 3] = [150, 190, 240];

/// The sheet as it stands.
pub(super) struct Sheet {
    canvas: Image,
    /// Width and height of a picture on it.
    cell: [u32; 2],
    started: Instant,
    /// When it was last written.
    written: Option<Instant>,
}

impl Sheet {
    /// An empty sheet.
    pub(super) fn new(shots: &Shots) -> Sheet {
        let lens = &shots.intrinsics;
        let cell = [WIDTH, (WIDTH * lens.height / lens.width).clamp(1, 4 * WIDTH)];
        let (width, height) = (cell[0] * shots.lights.len() as u32, cell[1] * shots.cameras.len() as u32);
        let canvas = Canvas::new(width, height).into_image();
        Sheet { canvas, cell, started: Instant::now(), written: None }
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

    /// Writes the sheet with how far the session is and how long it will take, unless that was done a moment ago.
    pub(super) fn live(&mut self, out: &Path, progress: Progress) -> Result<(), SessionError> {
        if self.written.is_some_and(|written| written.elapsed() < PERIOD) {
            return Ok(());
        }
        self.write_image(out, &self.with_progress(progress, self.started.elapsed()))?;
        self.written = Some(Instant::now());
        Ok(())
    }

    /// Writes the sheet alone: nothing on it tells times, so that equal sessions end in equal bytes.
    pub(super) fn write(&self, out: &Path) -> Result<(), SessionError> {
        self.write_image(out, &self.canvas)
    }

    /// The sheet under a line of words and a bar.
    fn with_progress(&self, progress: Progress, elapsed: Duration) -> Image {
        let Progress { done, resumed, total } = progress;
        let top = Canvas::TEXT_HEIGHT + 8;
        let width = self.canvas.width.max(WORDS);
        let mut canvas = Canvas::new(width, self.canvas.height + top);
        canvas.paste(&self.canvas, 0, top);
        let mut words = format!("{done} of {total}");
        if done > resumed {
            let seconds = elapsed.as_secs_f64() / (done - resumed) as f64 * total.saturating_sub(done) as f64;
            words = format!("{words}, {} left", duration(seconds));
        }
        canvas.text(&words, 2.0, 0.0, INK);
        let end = f64::from(width) * done as f64 / total.max(1) as f64;
        let height = f64::from(Canvas::TEXT_HEIGHT + 3);
        if end >= 4.0 {
            canvas.line([2.0, height], [end - 2.0, height], 3.0, INK);
        }
        canvas.into_image()
    }

    fn write_image(&self, out: &Path, image: &Image) -> Result<(), SessionError> {
        let path = out.join(STATE).join(SHEET);
        let png = image.png().map_err(SessionError::io(&path))?;
        write_whole(&path, |file| file.write_all(&png)).map_err(SessionError::io(&path))
    }
}

/// A time in two units.
fn duration(seconds: f64) -> String {
    let minutes = (seconds / 60.0).ceil() as u64;
    match minutes {
        0 | 1 => format!("{seconds:.0} s"),
        2..60 => format!("{minutes} min"),
        _ => format!("{} h {} min", minutes / 60, minutes % 60),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use relight_scene::drawing::BACKGROUND;

    #[test]
    fn times_are_told_in_two_units() {
        assert_eq!([3.2, 61.0, 3600.0, 5000.0].map(duration), ["3 s", "2 min", "1 h 0 min", "1 h 24 min"]);
    }

    #[test]
    fn the_bar_grows_and_the_pictures_stay() {
        let canvas = Image { width: 64, height: 24, data: vec![200; 3 * 64 * 24] };
        let sheet = Sheet { canvas, cell: [32, 24], started: Instant::now(), written: None };
        let ink = |done: usize| {
            let image = sheet.with_progress(Progress { done, resumed: 0, total: 8 }, Duration::from_secs(8));
            assert_eq!((image.width, image.height), (WORDS, 24 + Canvas::TEXT_HEIGHT + 8));
            let at = |x: u32, y: u32| 3 * (y * image.width + x) as usize;
            assert_eq!(image.data[at(63, Canvas::TEXT_HEIGHT + 8)], 200);
            assert_eq!(image.data[at(64, Canvas::TEXT_HEIGHT + 8)], BACKGROUND[0]);
            (0..WORDS).filter(|&x| image.data[at(x, Canvas::TEXT_HEIGHT + 3)..][..3] == INK).count()
        };
        let [none, some, all] = [0, 4, 8].map(ink);
        assert!(none == 0 && some > 130 && all > some + 130, "{none} {some} {all}");
    }
}
