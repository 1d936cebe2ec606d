//! The structure of a zip: nothing is taken on trust, and every byte must belong to one entry.

use std::fs::File;
use std::io;

use rawzip::{
    CompressionMethod, ErrorKind, FileReader, MAX_CENTRAL_DIRECTORY_RECORD_SIZE, ReaderAt, ZipArchive,
    ZipFileHeaderRecord,
};

use super::Limits;
use super::problem::{Code, Problem, Problems};

/// Bits of Unix file modes.
const KIND: u32 = 0o170_000;
const PLAIN: u32 = 0o100_000;
const SYMLINK: u32 = 0o120_000;
const FOLDER: u32 = 0o040_000;

/// Where an entry's bytes lie, and what is stated of them.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Packed {
    /// First byte in the zip.
    pub(crate) start: u64,
    /// Bytes in the zip.
    pub(crate) packed: u64,
    /// Bytes when unpacked.
    pub(crate) unpacked: u64,
    /// Checksum of the unpacked bytes.
    pub(crate) crc: u32,
    /// Deflated rather than stored.
    pub(crate) deflated: bool,
}

/// Walks over a zip's entries in the order of its directory: `each` is told the name and the place of every entry, and adds what is
/// wrong with it. What is wrong with the structure is added here. False if that leaves entries unseen.
///
/// # Errors
/// Only if the file cannot be read.
pub(super) fn walk(
    file: File,
    limits: &Limits,
    problems: &mut Problems,
    each: &mut dyn FnMut(&[u8], Packed, &mut Problems),
) -> io::Result<bool> {
    let length = file.metadata()?.len();
    let mut buffer = vec![0; MAX_CENTRAL_DIRECTORY_RECORD_SIZE];
    let archive = match ZipArchive::from_file(file, &mut buffer) {
        Ok(archive) => archive,
        Err(error) => {
            problems.push(unreadable(error)?);
            return Ok(false);
        }
    };
    if archive.end_offset() != length {
        let message = format!(
            "{} bytes follow the end of the zip: write it anew",
            length.saturating_sub(archive.end_offset())
        );
        problems.push(Problem::of_zip(Code::HiddenData, message));
    }
    if !check_end(&archive)? {
        let message = "its end states another place of the zip's directory, or further files of the same zip: write it anew as one file";
        problems.push(Problem::of_zip(Code::ZipDamaged, message));
    }
    // The zip's claim is only good for refusing early: what counts is how many entries are found.
    if archive.entries_hint() > limits.entries as u64 {
        problems.push(too_many(limits));
        return Ok(false);
    }
    let mut spans = Vec::new();
    let mut total = 0_u64;
    let mut local = vec![0; 2 * (1 << 16)];
    let mut entries = archive.entries(&mut buffer);
    loop {
        let record = match entries.next_entry() {
            Ok(Some(record)) => record,
            Ok(None) => break,
            Err(error) => {
                problems.push(unreadable(error)?);
                return Ok(false);
            }
        };
        if spans.len() == limits.entries {
            problems.push(too_many(limits));
            return Ok(false);
        }
        total = total.saturating_add(record.uncompressed_size_hint());
        match look(&archive, &record, &mut local, problems)? {
            Some((span, packed)) => {
                each(record.file_path().as_bytes(), packed, problems);
                spans.push(span);
            }
            // Where the entry lies is not known, so the other entries cannot be told from hidden data.
            None => return Ok(false),
        }
    }
    if spans.len() as u64 != archive.entries_hint() {
        let message = format!(
            "the zip's directory lists {} entries and states {}: write the zip anew",
            spans.len(),
            archive.entries_hint()
        );
        problems.push(Problem::of_zip(Code::ZipDamaged, message));
    }
    if total > limits.total_bytes {
        let message = format!(
            "the entries together unpack to {total} bytes, and at most {} are taken: leave out what is not asked for",
            limits.total_bytes
        );
        problems.push(Problem::of_zip(Code::TotalTooLarge, message));
    }
    check_tiling(spans, archive.directory_offset(), problems);
    Ok(true)
}

/// Whether the record at the zip's end says that the zip is one file and has its directory where that was found. In a field of all ones
/// a 64-bit record speaks instead.
fn check_end(archive: &ZipArchive<FileReader>) -> io::Result<bool> {
    const LENGTH: u64 = 22;
    let mut end = [0; LENGTH as usize];
    let at = archive.end_offset().saturating_sub(archive.comment().remaining() + LENGTH);
    archive.get_ref().read_exact_at(&mut end, at)?;
    let [_, _, _, _, d0, d1, f0, f1, .., o0, o1, o2, o3, _, _] = end;
    let place = u32::from_le_bytes([o0, o1, o2, o3]);
    Ok([[d0, d1], [f0, f1]].map(u16::from_le_bytes).iter().all(|&disk| disk == 0 || disk == u16::MAX)
        && (place == u32::MAX || u64::from(place) == archive.directory_offset()))
}

/// Bytes of the zip that an entry takes, from its header to the end of its descriptor.
struct Span {
    name: Vec<u8>,
    start: u64,
    end: u64,
}

/// Reads an entry's own header and holds it against the directory; none if there is no such header.
fn look(
    archive: &ZipArchive<FileReader>,
    record: &ZipFileHeaderRecord<'_>,
    buffer: &mut [u8],
    problems: &mut Problems,
) -> io::Result<Option<(Span, Packed)>> {
    let path = record.file_path();
    let name = path.as_bytes();
    let mut tell = |code, message: &str| problems.push(Problem::of_entry(code, name, message));
    let entry = archive.get_entry(record.wayfinder());
    let read = entry.and_then(|entry| entry.local_header(buffer).map(|header| (entry, header)));
    let (entry, header) = match read {
        Ok(read) => read,
        Err(error) => {
            let problem = unreadable(error)?;
            tell(Code::ZipDamaged, &format!("its header cannot be read: {}", problem.message));
            return Ok(None);
        }
    };
    let (flags, method) = (record.flags(), record.compression_method());
    if flags.is_encrypted() || flags.bits() & (1 << 6 | 1 << 13) != 0 || header.flags().is_encrypted() {
        tell(Code::Encrypted, "is encrypted: zip without a password");
    }
    if method != CompressionMethod::STORE && method != CompressionMethod::DEFLATE {
        tell(Code::CompressionMethod, &format!("is packed by {method:?}: zip as stored or deflated"));
    }
    match record.mode().value() & KIND {
        0 | PLAIN | FOLDER => {}
        SYMLINK => tell(Code::Symlink, "is a symbolic link: put the image itself into the zip"),
        _ => tell(Code::SpecialFile, "is no plain file: put the image itself into the zip"),
    }
    let (start, data_end) = entry.compressed_data_range();
    let packed = Packed {
        start,
        packed: record.compressed_size_hint(),
        unpacked: record.uncompressed_size_hint(),
        crc: record.crc32(),
        deflated: method == CompressionMethod::DEFLATE,
    };
    let (end, sizes_agree) = if flags.has_data_descriptor() {
        let length = descriptor_length(archive.get_ref(), data_end, &packed)?;
        (data_end.saturating_add(length.unwrap_or(0)), length.is_some())
    } else {
        let stated = (header.crc32(), header.compressed_size_hint(), header.uncompressed_size_hint());
        (data_end, stated == (packed.crc, packed.packed, packed.unpacked))
    };
    // Bits 1 and 2 tell how hard the packer tried.
    let agree = header.file_path().as_bytes() == name
        && header.compression_method() == method
        && (header.flags().bits() ^ flags.bits()) & !0b110 == 0
        && sizes_agree;
    if !agree {
        let message = "its own header and the zip's directory do not agree on name, sizes, checksum or method: write the zip anew";
        tell(Code::HeaderMismatch, message);
    }
    if !packed.deflated && method == CompressionMethod::STORE && packed.packed != packed.unpacked {
        tell(Code::SizeMismatch, "is stored, but states two different sizes: write the zip anew");
    }
    Ok(Some((
        Span { name: name[..name.len().min(1024)].to_vec(), start: record.local_header_offset(), end },
        packed,
    )))
}

/// Bytes of the descriptor after an entry's data: with or without signature, with sizes of four bytes or of eight. None if what lies
/// there does not state what the directory states.
fn descriptor_length(zip: &FileReader, at: u64, packed: &Packed) -> io::Result<Option<u64>> {
    let mut found = Vec::new();
    let mut bytes = [0; 24];
    while found.len() < bytes.len() {
        let offset = at.saturating_add(found.len() as u64);
        match zip.read_at(&mut bytes[found.len()..], offset) {
            Ok(0) => break,
            Ok(read) => found.extend_from_slice(&bytes[found.len()..found.len() + read]),
            Err(error) if error.raw_os_error() == Some(INVALID) => break,
            Err(error) => return Err(error),
        }
    }
    let crc = packed.crc.to_le_bytes();
    let sizes = [packed.packed, packed.unpacked];
    let long = sizes.map(u64::to_le_bytes).concat();
    let short = sizes.map(|size| u32::try_from(size).unwrap_or(u32::MAX).to_le_bytes()).concat();
    let forms = [long, short].into_iter().flat_map(|sizes| {
        [b"PK\x07\x08".as_slice(), b""].map(|signature| [signature, &crc, &sizes].concat())
    });
    Ok(forms.into_iter().find(|form| found.starts_with(form)).map(|form| form.len() as u64))
}

/// Adds what shows that entries overlap or leave bytes out.
fn check_tiling(mut spans: Vec<Span>, directory: u64, problems: &mut Problems) {
    spans.sort_by_key(|span| (span.start, span.end));
    let mut end = 0;
    for span in &spans {
        if span.start < end || span.end > directory {
            let message =
                "shares bytes of the zip with another entry or with the zip's directory: write the zip anew";
            problems.push(Problem::of_entry(Code::OverlappingEntries, &span.name, message));
        } else if span.start > end {
            let message =
                format!("{} bytes before it belong to no entry: write the zip anew", span.start - end);
            problems.push(Problem::of_entry(Code::HiddenData, &span.name, message));
        }
        end = end.max(span.end);
    }
    if end < directory {
        let message = format!(
            "{} bytes before the zip's directory belong to no entry: write the zip anew",
            directory - end
        );
        problems.push(Problem::of_zip(Code::HiddenData, message));
    }
}

fn too_many(limits: &Limits) -> Problem {
    let message = format!("holds more than {} entries: leave out what is not asked for", limits.entries);
    Problem::of_zip(Code::TooManyEntries, message)
}

/// What a zip that cannot be read suffers from; an error of the disk is passed on.
fn unreadable(error: rawzip::Error) -> io::Result<Problem> {
    let (code, message) = match error.into_kind() {
        ErrorKind::IO(error)
            if error.kind() != io::ErrorKind::UnexpectedEof && error.raw_os_error() != Some(INVALID) =>
        {
            return Err(error);
        }
        ErrorKind::MissingEndOfCentralDirectory => {
            (Code::NotAZip, "is not a zip file, or is cut off: write or send it again".to_owned())
        }
        kind => (Code::ZipDamaged, format!("is damaged ({kind}): write or send it again")),
    };
    Ok(Problem::of_zip(code, message))
}

/// What systems say (EINVAL) to a read at an offset beyond all files.
const INVALID: i32 = 22;
