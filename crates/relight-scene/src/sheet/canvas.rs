//! Pixels to draw on.

use crate::image_file::Image;

const BACKGROUND: u8 = 24;
const TEXT: [u8; 3] = [220; 3];
/// Digits of 3 x 5 pixels, a row in three bits, the top row first.
const DIGITS: [[u8; 5]; 10] = [
    [7, 5, 5, 5, 7],
    [2, 6, 2, 2, 7],
    [7, 1, 7, 4, 7],
    [7, 1, 7, 1, 7],
    [5, 5, 7, 1, 1],
    [7, 4, 7, 1, 7],
    [7, 4, 7, 5, 7],
    [7, 1, 1, 1, 1],
    [7, 5, 7, 5, 7],
    [7, 5, 7, 1, 7],
];

pub(super) struct Canvas(Image);

impl Canvas {
    pub(super) fn new(width: u32, height: u32) -> Canvas {
        let data = vec![BACKGROUND; 3 * width as usize * height as usize];
        Canvas(Image { width, height, data })
    }

    pub(super) fn into_image(self) -> Image {
        self.0
    }

    /// Sets a pixel, if it is on the canvas.
    pub(super) fn dot(&mut self, x: i64, y: i64, colour: [u8; 3]) {
        if (0..i64::from(self.0.width)).contains(&x) && (0..i64::from(self.0.height)).contains(&y) {
            let at = 3 * (y as usize * self.0.width as usize + x as usize);
            self.0.data[at..at + 3].copy_from_slice(&colour);
        }
    }

    pub(super) fn line(&mut self, from: [f64; 2], to: [f64; 2], colour: [u8; 3]) {
        let steps = (to[0] - from[0]).abs().max((to[1] - from[1]).abs()).ceil().clamp(1.0, 1e4) as u32;
        for step in 0..=steps {
            let t = f64::from(step) / f64::from(steps);
            let at = |axis: usize| (from[axis] + t * (to[axis] - from[axis])).round() as i64;
            self.dot(at(0), at(1), colour);
        }
    }

    pub(super) fn disc(&mut self, centre: [f64; 2], radius: i64, colour: [u8; 3]) {
        for dy in -radius..=radius {
            for dx in -radius..=radius {
                if dx * dx + dy * dy <= radius * radius {
                    self.dot(centre[0].round() as i64 + dx, centre[1].round() as i64 + dy, colour);
                }
            }
        }
    }

    pub(super) fn paste(&mut self, image: &Image, left: u32, top: u32) {
        let rows = image.data.chunks_exact(3 * image.width as usize);
        for (y, row) in rows.enumerate() {
            for (x, colour) in row.as_chunks::<3>().0.iter().enumerate() {
                self.dot(i64::from(left) + x as i64, i64::from(top) + y as i64, *colour);
            }
        }
    }

    /// Writes a number, twice the size of its digits.
    pub(super) fn number(&mut self, number: usize, left: u32, top: u32) {
        for (place, digit) in number.to_string().bytes().enumerate() {
            for (y, row) in DIGITS[usize::from(digit - b'0')].iter().enumerate() {
                for x in (0..3).filter(|x| row >> (2 - x) & 1 == 1) {
                    for (dx, dy) in [(0, 0), (1, 0), (0, 1), (1, 1)] {
                        let (x, y) = (8 * place + 2 * x + dx, 2 * y + dy);
                        self.dot(i64::from(left) + x as i64, i64::from(top) + y as i64, TEXT);
                    }
                }
            }
        }
    }
}
