//! Unpacking one entry, within what it states.

use std::fs::File;
use std::io::{self, BufReader, Read, Seek, SeekFrom};

use flate2::bufread::DeflateDecoder;

use super::archive::Packed;
use super::problem::Code;

/// Why an entry has no bytes.
pub(super) enum EntryError {
    /// The entry's fault.
    Bad(Code, String),
    /// The disk's.
    Io(io::Error),
}

/// Unpacks an entry into `bytes`; nothing beyond the stated size is ever unpacked.
pub(super) fn unpack(mut zip: &File, entry: &Packed, bytes: &mut Vec<u8>) -> Result<(), EntryError> {
    let damaged =
        || EntryError::Bad(Code::PackedDamaged, "cannot be unpacked: write the zip anew".to_owned());
    bytes.clear();
    zip.seek(SeekFrom::Start(entry.start)).map_err(EntryError::Io)?;
    let mut packed = BufReader::with_capacity(1 << 16, zip.take(entry.packed));
    // One byte more than stated shows that there is more.
    let most = entry.unpacked.saturating_add(1);
    if entry.deflated {
        let mut inflated = DeflateDecoder::new(&mut packed);
        match (&mut inflated).take(most).read_to_end(bytes) {
            Ok(_) => {}
            // A system's error has a number, the decoder's has none.
            Err(error) if error.raw_os_error().is_some() => return Err(EntryError::Io(error)),
            Err(_) => return Err(damaged()),
        }
        if bytes.len() as u64 == entry.unpacked && inflated.total_in() != entry.packed {
            let message = "packed bytes follow its end: write the zip anew";
            return Err(EntryError::Bad(Code::HiddenData, message.to_owned()));
        }
    } else {
        packed.take(most).read_to_end(bytes).map_err(EntryError::Io)?;
    }
    if bytes.len() as u64 != entry.unpacked {
        let more = if bytes.len() as u64 > entry.unpacked { "more" } else { "fewer" };
        let message =
            format!("unpacks to {more} than the {} bytes that it states: write the zip anew", entry.unpacked);
        return Err(EntryError::Bad(Code::SizeMismatch, message));
    }
    if crc32fast::hash(bytes) != entry.crc {
        let message = "its bytes do not have the stated checksum: write or send the zip again";
        return Err(EntryError::Bad(Code::ChecksumMismatch, message.to_owned()));
    }
    Ok(())
}
