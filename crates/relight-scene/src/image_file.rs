//! Images in files.

use std::fs::File;
use std::io::{BufRead, BufReader, Cursor, Seek};
use std::path::Path;

use image::{DynamicImage, ImageDecoder, ImageFormat, ImageReader};

use crate::camera::LONGEST_SIDE;
use crate::error::{FaultKind, SceneError};
use crate::files;

/// An image file's longest length.
const LONGEST_FILE: u64 = 1 << 29;
/// Pixels of the largest image.
const MOST_PIXELS: u64 = 1 << 26;
/// What a decoder may take for one image: 16-bit RGBA at the largest size.
const MOST_MEMORY: u64 = MOST_PIXELS * 8 + (1 << 24);
/// An image no byte of which is brighter is black: lossy codecs leave a trace.
const BLACK: u8 = 2;

/// Extensions of image files, in the order in which they are looked for.
pub(crate) const EXTENSIONS: [&str; 4] = ["png", "jpg", "jpeg", "webp"];

/// An image: sRGB, 8 bits a channel.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Image {
    /// Pixels a row.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// RGB interleaved, row-major, origin at the top left: `3 * width * height` bytes.
    pub data: Vec<u8>,
}

impl Image {
    /// Whether the image shows nothing at all.
    pub fn is_black(&self) -> bool {
        self.data.iter().all(|&byte| byte <= BLACK)
    }

    /// Writes the image as PNG, to a temporary file first.
    ///
    /// # Errors
    /// If the data are not of the stated size or the file cannot be written.
    pub fn write_png(&self, path: &Path) -> Result<(), SceneError> {
        let bytes = self.png().map_err(|error| {
            SceneError::fault(FaultKind::Image, path, format!("cannot be encoded: {error}"), "")
        })?;
        files::write(path, &bytes)
    }

    /// The bytes of the image as a PNG file.
    ///
    /// # Errors
    /// If the data are not of the stated size.
    pub fn png(&self) -> std::io::Result<Vec<u8>> {
        self.check_length()?;
        let mut bytes = Cursor::new(Vec::new());
        image::ImageEncoder::write_image(
            image::codecs::png::PngEncoder::new(&mut bytes),
            &self.data,
            self.width,
            self.height,
            image::ExtendedColorType::Rgb8,
        )
        .map_err(std::io::Error::other)?;
        Ok(bytes.into_inner())
    }

    /// The bytes of the image as a JPEG file of a quality from 1 to 100: small, for people to look at.
    ///
    /// # Errors
    /// As [`png`](Self::png); also if a side is longer than such a file can say.
    pub fn jpeg(&self, quality: u8) -> std::io::Result<Vec<u8>> {
        self.check_length()?;
        let mut bytes = Vec::new();
        image::codecs::jpeg::JpegEncoder::new_with_quality(&mut bytes, quality.clamp(1, 100))
            .encode(&self.data, self.width, self.height, image::ExtendedColorType::Rgb8)
            .map_err(std::io::Error::other)?;
        Ok(bytes)
    }

    fn check_length(&self) -> std::io::Result<()> {
        let (stated, held) = (3 * u64::from(self.width) * u64::from(self.height), self.data.len());
        if stated == held as u64 {
            return Ok(());
        }
        let problem = format!("{held} bytes are not an image of {}x{}", self.width, self.height);
        Err(std::io::Error::new(std::io::ErrorKind::InvalidInput, problem))
    }

    /// The image made smaller by a whole factor of both sides: each pixel the mean of those that it stands for, in sRGB.
    /// Rows and columns that fill no whole pixel are cut off, but never the last.
    pub fn reduced(&self, factor: u32) -> Image {
        let factor = factor.clamp(1, self.width.min(self.height).max(1));
        let (width, height) = (self.width / factor, self.height / factor);
        let (k, row) = (factor as usize, 3 * self.width as usize);
        let mut data = Vec::with_capacity(3 * width as usize * height as usize);
        for v in 0..height as usize {
            for u in 0..width as usize {
                for channel in 0..3 {
                    let lines = self.data.chunks(row).skip(v * k).take(k);
                    let sum: u32 = lines
                        .flat_map(|line| line.iter().skip(3 * u * k + channel).step_by(3).take(k))
                        .map(|&byte| u32::from(byte))
                        .sum();
                    let pixels = factor * factor;
                    data.push(((sum + pixels / 2) / pixels) as u8);
                }
            }
        }
        Image { width, height, data }
    }
}

/// Reads a PNG, JPEG or WebP file, whatever its name says. Sixteen bits are rounded to eight, grey becomes RGB, and
/// transparent pixels are laid over black.
///
/// # Errors
/// [`SceneError::Fault`] if the file cannot be read, is no such image, is truncated or damaged, or claims a size beyond
/// 16384 pixels a side or 64 megapixels.
pub fn read_image(path: &Path) -> Result<Image, SceneError> {
    read_sized(path, None)
}

/// As [`read_image`], for a file's bytes; `path` is only named in errors.
///
/// # Errors
/// As [`read_image`].
pub fn decode_image(path: &Path, bytes: &[u8]) -> Result<Image, SceneError> {
    decode(path, bytes, None)
}

/// As [`read_image`]; an image of another size than the expected one is refused before it is decoded.
pub(crate) fn read_sized(path: &Path, expected: Option<(u32, u32)>) -> Result<Image, SceneError> {
    decode(path, &files::read_bytes(path, LONGEST_FILE)?, expected)
}

/// The image in a file's bytes.
pub(crate) fn decode(path: &Path, bytes: &[u8], expected: Option<(u32, u32)>) -> Result<Image, SceneError> {
    if is_cut_short(bytes) {
        return Err(damaged(path, "the file is truncated"));
    }
    let decoder = decoder(path, Cursor::new(bytes))?;
    let (width, height) = decoder.dimensions();
    if let Some((w, h)) = expected.filter(|&size| size != (width, height)) {
        let problem = format!("the image is {width}x{height}, but its camera's image size is {w}x{h}");
        let mend = "All images of a camera must have the camera's size: put the right image in place, or set the \
                    image size and scale the camera matrix with it.";
        return Err(SceneError::fault(FaultKind::Size, path, problem, mend));
    }
    let decoded = DynamicImage::from_decoder(decoder).map_err(|error| damaged(path, &error.to_string()))?;
    let data =
        if decoded.color().has_alpha() { over_black(&decoded) } else { decoded.into_rgb8().into_raw() };
    Ok(Image { width, height, data })
}

/// Width and height as the file's header states them.
pub(crate) fn read_size(path: &Path) -> Result<(u32, u32), SceneError> {
    files::plain_file_length(path)?;
    let file = File::open(path).map_err(|error| SceneError::io(path, "be read", &error))?;
    Ok(decoder(path, BufReader::new(file))?.dimensions())
}

fn decoder<'a>(path: &Path, from: impl BufRead + Seek + 'a) -> Result<impl ImageDecoder + 'a, SceneError> {
    let unknown = || {
        let problem = "is not a PNG, JPEG or WebP image";
        SceneError::fault(
            FaultKind::Image,
            path,
            problem,
            "Convert it to one of these, PNG if it should lose nothing.",
        )
    };
    let mut reader = ImageReader::new(from).with_guessed_format().map_err(|_| unknown())?;
    if !matches!(reader.format(), Some(ImageFormat::Png | ImageFormat::Jpeg | ImageFormat::WebP)) {
        return Err(unknown());
    }
    let too_large = |size: &str| {
        let problem = format!(
            "the image claims {size}: more than {LONGEST_SIDE} pixels a side or {MOST_PIXELS} in all are refused"
        );
        SceneError::fault(FaultKind::Size, path, problem, "Resize the images.")
    };
    let mut limits = image::Limits::default();
    limits.max_image_width = Some(LONGEST_SIDE);
    limits.max_image_height = Some(LONGEST_SIDE);
    limits.max_alloc = Some(MOST_MEMORY);
    reader.limits(limits);
    let decoder = reader.into_decoder().map_err(|error| match error {
        image::ImageError::Limits(_) => too_large("a size beyond all limits"),
        other => damaged(path, &other.to_string()),
    })?;
    let (width, height) = decoder.dimensions();
    if u64::from(width) * u64::from(height) > MOST_PIXELS || width == 0 || height == 0 {
        return Err(too_large(&format!("{width}x{height} pixels")));
    }
    Ok(decoder)
}

fn damaged(path: &Path, problem: &str) -> SceneError {
    SceneError::fault(
        FaultKind::Image,
        path,
        format!("the image cannot be decoded: {problem}"),
        "The file is truncated or damaged: fetch or capture it again.",
    )
}

/// Whether a file that starts as JPEG or WebP lacks its end. JPEG and WebP decoders fill what is missing with grey and
/// say nothing; PNG's do say so.
fn is_cut_short(bytes: &[u8]) -> bool {
    if bytes.starts_with(&[0xff, 0xd8, 0xff]) {
        // Neither marker occurs inside compressed data, so the last end of image must follow the last scan.
        let last = |marker: u8| bytes.windows(2).rposition(|pair| pair == [0xff, marker]);
        return last(0xd9) < last(0xda) || last(0xd9).is_none();
    }
    if bytes.len() >= 12 && bytes.starts_with(b"RIFF") && &bytes[8..12] == b"WEBP" {
        let stated = u32::from_le_bytes([bytes[4], bytes[5], bytes[6], bytes[7]]);
        return (bytes.len() as u64) < u64::from(stated) + 8;
    }
    false
}

fn over_black(image: &DynamicImage) -> Vec<u8> {
    let blend = |colour: u8, alpha: u8| ((u32::from(colour) * u32::from(alpha) + 127) / 255) as u8;
    let rgba = image.to_rgba8();
    rgba.pixels().flat_map(|pixel| [0, 1, 2].map(|channel| blend(pixel[channel], pixel[3]))).collect()
}
