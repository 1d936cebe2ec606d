//! Pixels to draw on.

use noto_sans_mono_bitmap::{FontWeight, RasterHeight, get_raster, get_raster_width};

use crate::image_file::Image;

/// sRGB, 8 bits a channel.
pub type Colour = [u8; 3];

/// What an empty canvas shows.
pub const BACKGROUND: Colour = [24; 3];

const WEIGHT: FontWeight = FontWeight::Regular;
const HEIGHT: RasterHeight = RasterHeight::Size16;

/// A picture under way. Places are in pixels from the top left, pixel centres at integers; edges are smooth, and what
/// lies outside is left out.
pub struct Canvas(Image);

impl Canvas {
    /// Height of a line of text, pixels.
    pub const TEXT_HEIGHT: u32 = HEIGHT.val() as u32;

    /// An empty canvas.
    pub fn new(width: u32, height: u32) -> Canvas {
        let pixels = width as usize * height as usize;
        Canvas(Image { width, height, data: BACKGROUND.repeat(pixels) })
    }

    /// The picture.
    pub fn into_image(self) -> Image {
        self.0
    }

    /// Lays a colour over a pixel, with a share of 0 to 1.
    fn blend(&mut self, x: i64, y: i64, colour: Colour, share: f64) {
        if (0..i64::from(self.0.width)).contains(&x) && (0..i64::from(self.0.height)).contains(&y) {
            let at = 3 * (y as usize * self.0.width as usize + x as usize);
            for (old, new) in self.0.data[at..at + 3].iter_mut().zip(colour) {
                *old = (f64::from(*old) + share * (f64::from(new) - f64::from(*old))).round() as u8;
            }
        }
    }

    /// A line of a width in pixels, round at its ends.
    pub fn line(&mut self, from: [f64; 2], to: [f64; 2], width: f64, colour: Colour) {
        let along = [to[0] - from[0], to[1] - from[1]];
        let length2 = along[0] * along[0] + along[1] * along[1];
        if !length2.is_finite() {
            return;
        }
        let distance = |x: f64, y: f64| {
            let offset = [x - from[0], y - from[1]];
            let share = (offset[0] * along[0] + offset[1] * along[1]) / length2.max(f64::MIN_POSITIVE);
            let share = share.clamp(0.0, 1.0);
            (offset[0] - share * along[0]).hypot(offset[1] - share * along[1])
        };
        // Walks the axis along which the line is longer, and at each step the few pixels across.
        let major = usize::from(along[1].abs() > along[0].abs());
        let minor = 1 - major;
        let slope = if along[major] == 0.0 { 0.0 } else { along[minor] / along[major] };
        let margin = width / 2.0 + 1.0;
        let across = margin * std::f64::consts::SQRT_2;
        let limit = f64::from([self.0.width, self.0.height][major]);
        let first = (from[major].min(to[major]) - margin).floor().clamp(0.0, limit);
        let last = (from[major].max(to[major]) + margin).ceil().clamp(0.0, limit);
        for step in first as i64..=last as i64 {
            let middle = from[minor] + slope * (step as f64 - from[major]);
            for beside in (middle - across).floor() as i64..=(middle + across).ceil() as i64 {
                let (x, y) = if major == 0 { (step, beside) } else { (beside, step) };
                let share = (width / 2.0 + 0.5 - distance(x as f64, y as f64)).clamp(0.0, 1.0);
                self.blend(x, y, colour, share);
            }
        }
    }

    /// A filled circle.
    pub fn disc(&mut self, centre: [f64; 2], radius: f64, colour: Colour) {
        self.line(centre, centre, 2.0 * radius, colour);
    }

    /// Lays another picture over this one.
    pub fn paste(&mut self, image: &Image, left: u32, top: u32) {
        let rows = image.data.chunks_exact(3 * image.width as usize);
        for (y, row) in rows.enumerate() {
            for (x, colour) in row.as_chunks::<3>().0.iter().enumerate() {
                self.blend(i64::from(left) + x as i64, i64::from(top) + y as i64, *colour, 1.0);
            }
        }
    }

    /// Writes a line of ASCII; other characters leave a gap.
    pub fn text(&mut self, text: &str, left: f64, top: f64, colour: Colour) {
        let (left, top) = (left.round() as i64, top.round() as i64);
        for (place, character) in text.chars().enumerate() {
            let Some(glyph) = get_raster(character, WEIGHT, HEIGHT) else { continue };
            for (y, row) in glyph.rows().enumerate() {
                for (x, &ink) in row.iter().enumerate() {
                    let x = left + (place * get_raster_width(WEIGHT, HEIGHT) + x) as i64;
                    self.blend(x, top + y as i64, colour, f64::from(ink) / 255.0);
                }
            }
        }
    }

    /// Width of a line of text, pixels.
    pub fn text_width(text: &str) -> u32 {
        (text.chars().count() * get_raster_width(WEIGHT, HEIGHT)) as u32
    }
}
