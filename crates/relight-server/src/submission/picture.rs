//! What a submitted image must be: a PNG file of 8-bit RGB, whole, of its camera's size, and nothing else.
//!
//! The chunks are walked before anything is decoded, so that a file is refused for what it is: decoders differ in what they let
//! pass, and take memory by what a header claims.

use std::io::Cursor;

use super::problem::Code;

const SIGNATURE: &[u8; 8] = b"\x89PNG\r\n\x1a\n";

type Bad = (Code, String);

/// Decodes an image into `rgb`, `3 * width * height` bytes.
///
/// # Errors
/// All that is wrong with it, as far as it can be told without decoding; else why it does not decode.
pub(super) fn decode(
    png: &[u8],
    size: (u32, u32),
    most_pixels: u64,
    rgb: &mut Vec<u8>,
) -> Result<(), Vec<Bad>> {
    let problems = walk(png, size, most_pixels);
    if !problems.is_empty() {
        return Err(problems);
    }
    decode_pixels(png, size, rgb)
        .map_err(|problem| vec![(Code::PngDamaged, format!("does not decode ({problem}): write it anew"))])
}

fn decode_pixels(png: &[u8], (width, height): (u32, u32), rgb: &mut Vec<u8>) -> Result<(), String> {
    let bytes = 3 * width as usize * height as usize;
    // What decoding needs besides the picture: a few rows and windows.
    let limits = png::Limits { bytes: bytes + (1 << 22) };
    let mut decoder = png::Decoder::new_with_limits(Cursor::new(png), limits);
    decoder.set_ignore_text_chunk(true);
    decoder.set_ignore_iccp_chunk(true);
    let mut reader = decoder.read_info().map_err(|error| error.to_string())?;
    if reader.output_buffer_size() != Some(bytes) {
        return Err("it is not of the size that its header states".to_owned());
    }
    rgb.resize(bytes, 0);
    reader.next_frame(rgb).map_err(|error| error.to_string())?;
    Ok(())
}

/// Walks over the chunks of a file.
fn walk(png: &[u8], size: (u32, u32), most_pixels: u64) -> Vec<Bad> {
    let Some(mut rest) = png.strip_prefix(SIGNATURE) else {
        return vec![(Code::NotPng, format!("is {}: write images as PNG", kind(png)))];
    };
    let bad = |code, message: &str| vec![(code, message.to_owned())];
    let damaged = |what: &str| vec![(Code::PngDamaged, format!("{what}: write it anew"))];
    let mut data = Data::Before;
    let mut first = true;
    loop {
        let Some((chunk, after)) = Chunk::split(rest) else {
            return bad(Code::PngTruncated, "the PNG file is cut off: write or send it again");
        };
        rest = after;
        if !chunk.name.iter().all(u8::is_ascii_alphabetic) {
            return damaged("a part of the PNG file has no name");
        }
        let name = String::from_utf8_lossy(&chunk.name);
        if !chunk.is_intact {
            let message =
                format!("the part {name} of the PNG file does not have its checksum: write or send it again");
            return vec![(Code::PngChecksum, message)];
        }
        if first != (&chunk.name == b"IHDR") {
            return damaged("the PNG file does not begin with one header");
        }
        match &chunk.name {
            b"IHDR" => {
                let problems = check_header(chunk.data, size, most_pixels);
                if !problems.is_empty() {
                    return problems;
                }
            }
            b"IDAT" if data == Data::After => return damaged("the PNG file's pixels are not in one piece"),
            b"IDAT" => data = Data::Within,
            b"IEND" => break,
            b"tRNS" => return bad(Code::PngAlpha, "has a transparent colour: write 8-bit RGB"),
            b"acTL" | b"fcTL" | b"fdAT" => {
                return bad(Code::PngAnimated, "is animated: write a plain PNG image");
            }
            b"PLTE" => {}
            [first, ..] if first.is_ascii_uppercase() => {
                return damaged(&format!("the PNG file has an unknown part {name}"));
            }
            _ => {}
        }
        if data == Data::Within && &chunk.name != b"IDAT" {
            data = Data::After;
        }
        first = false;
    }
    if data == Data::Before {
        return damaged("the PNG file has no pixels");
    }
    if rest.is_empty() {
        return Vec::new();
    }
    vec![(
        Code::PngTrailingData,
        format!("{} bytes follow the end of the PNG file: write it anew", rest.len()),
    )]
}

/// Where a walk is.
#[derive(Clone, Copy, PartialEq)]
enum Data {
    Before,
    Within,
    After,
}

/// A part of a PNG file.
struct Chunk<'a> {
    name: [u8; 4],
    data: &'a [u8],
    /// Whether its checksum is right.
    is_intact: bool,
}

impl<'a> Chunk<'a> {
    /// The first chunk and what follows it; none if it is cut off.
    fn split(bytes: &'a [u8]) -> Option<(Chunk<'a>, &'a [u8])> {
        let (length, rest) = bytes.split_first_chunk::<4>()?;
        let (named, after) = rest.split_at_checked((u32::from_be_bytes(*length) as usize).checked_add(4)?)?;
        let (name, data) = named.split_first_chunk::<4>()?;
        let (crc, after) = after.split_first_chunk::<4>()?;
        let is_intact = crc32fast::hash(named) == u32::from_be_bytes(*crc);
        Some((Chunk { name: *name, data, is_intact }, after))
    }
}

/// What is wrong with the header, all of it.
fn check_header(header: &[u8], size: (u32, u32), most_pixels: u64) -> Vec<Bad> {
    let &[w0, w1, w2, w3, h0, h1, h2, h3, depth, colour, compression, filter, interlace] = header else {
        return vec![(Code::PngDamaged, "the PNG header is not of its length: write it anew".to_owned())];
    };
    let (width, height) = (u32::from_be_bytes([w0, w1, w2, w3]), u32::from_be_bytes([h0, h1, h2, h3]));
    let mut problems = Vec::new();
    let mut tell = |code, message: String| problems.push((code, message));
    if u64::from(width) * u64::from(height) > most_pixels {
        tell(
            Code::TooManyPixels,
            format!("states {width}x{height} pixels, and no image has more than {most_pixels}"),
        );
    }
    if (width, height) != size {
        let message = format!(
            "is {width}x{height} pixels, and its camera has {}x{}: render at the camera's size",
            size.0, size.1
        );
        tell(Code::WrongSize, message);
    }
    match colour {
        0 => tell(Code::PngGrey, "is grey: write 8-bit RGB".to_owned()),
        2 => {}
        3 => tell(Code::PngPalette, "has a palette: write 8-bit RGB".to_owned()),
        4 => {
            tell(Code::PngGrey, "is grey: write 8-bit RGB".to_owned());
            tell(Code::PngAlpha, "has an alpha channel: write 8-bit RGB".to_owned());
        }
        6 => tell(Code::PngAlpha, "has an alpha channel: write 8-bit RGB".to_owned()),
        other => tell(Code::PngDamaged, format!("is of the unknown colour type {other}: write 8-bit RGB")),
    }
    match depth {
        8 => {}
        1 | 2 | 4 | 16 => tell(Code::PngBitDepth, format!("has {depth} bits a channel: write 8-bit RGB")),
        other => tell(Code::PngDamaged, format!("states {other} bits a channel: write 8-bit RGB")),
    }
    match interlace {
        0 => {}
        1 => tell(Code::PngInterlaced, "is interlaced: write it without interlacing".to_owned()),
        other => tell(Code::PngDamaged, format!("is interlaced in the unknown way {other}: write it anew")),
    }
    if (compression, filter) != (0, 0) {
        tell(Code::PngDamaged, "is compressed or filtered in an unknown way: write it anew".to_owned());
    }
    problems
}

/// What a file that is no PNG seems to be.
fn kind(bytes: &[u8]) -> &'static str {
    match bytes {
        [] => "empty",
        [0xff, 0xd8, 0xff, ..] => "a JPEG file",
        [b'P', b'K', 3 | 5, 4 | 6, ..] => "a zip file",
        [b'G', b'I', b'F', b'8', ..] => "a GIF file",
        [b'R', b'I', b'F', b'F', _, _, _, _, b'W', b'E', b'B', b'P', ..] => "a WebP file",
        [b'B', b'M', ..] => "a BMP file",
        [b'I', b'I', b'*', 0, ..] | [b'M', b'M', 0, b'*', ..] => "a TIFF file",
        _ if bytes.starts_with(b"\x76\x2f\x31\x01") => "an EXR file",
        _ => "no PNG file",
    }
}
