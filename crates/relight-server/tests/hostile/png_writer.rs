//! Writes PNG files chunk by chunk, right or wrong.

use std::io::Write;

pub const SIGNATURE: &[u8] = b"\x89PNG\r\n\x1a\n";

pub fn chunk(name: &[u8; 4], data: &[u8]) -> Vec<u8> {
    let named = [name.as_slice(), data].concat();
    [&(data.len() as u32).to_be_bytes()[..], &named, &crc32fast::hash(&named).to_be_bytes()].concat()
}

/// What a PNG file states of itself.
#[derive(Clone, Copy)]
pub struct Header {
    pub size: (u32, u32),
    pub depth: u8,
    pub colour: u8,
    pub interlace: u8,
}

impl Header {
    pub fn chunk(&self) -> Vec<u8> {
        let (w, h) = (self.size.0.to_be_bytes(), self.size.1.to_be_bytes());
        chunk(b"IHDR", &[&w[..], &h, &[self.depth, self.colour, 0, 0, self.interlace]].concat())
    }

    /// Bytes of a row, the filter's name included, and rows; of an interlaced file more than that is left out.
    fn rows(&self) -> (usize, usize) {
        let channels = match self.colour {
            2 => 3,
            4 => 2,
            6 => 4,
            _ => 1,
        };
        let bits = self.size.0 as usize * channels * usize::from(self.depth);
        (1 + bits.div_ceil(8), self.size.1 as usize)
    }
}

pub fn zlib(bytes: &[u8]) -> Vec<u8> {
    let mut encoder = flate2::write::ZlibEncoder::new(Vec::new(), flate2::Compression::fast());
    encoder.write_all(bytes).unwrap();
    encoder.finish().unwrap()
}

/// A PNG file with these chunks between header and end.
pub fn file(header: Header, middle: &[Vec<u8>]) -> Vec<u8> {
    [SIGNATURE, &header.chunk(), &middle.concat(), &chunk(b"IEND", &[])].concat()
}

/// The pixels of a file of this header, some pattern.
pub fn pixels(header: Header) -> Vec<u8> {
    let (row, rows) = header.rows();
    let bytes: Vec<u8> =
        (0..row * rows).map(|i| if i % row == 0 { 0 } else { (i * 7 % 256) as u8 }).collect();
    chunk(b"IDAT", &zlib(&bytes))
}
