//! What takes long to make, in files for the next start.
//!
//! A file: magic number (8 bytes) and version (u32) of what it holds, length of the fingerprint (u32), offset and length
//! of the contents (u64 each), all little endian; the fingerprint; zeros up to the offset; the contents. The fingerprint
//! says what the contents were made from, and must match byte for byte.

use std::fs::{self, File};
use std::io::{self, BufWriter, Read, Write};
use std::path::{Path, PathBuf};
use std::time::{Duration, SystemTime};

use tempfile::NamedTempFile;

const HEADER: usize = 32;
/// Contents start at a page, so that they can be mapped.
const PAGE: usize = 4096;
/// Unfinished files of programs that died are removed after this time.
const ABANDONED: Duration = Duration::from_secs(3600);
const UNFINISHED: &str = ".unfinished";
/// Contents that are read at once, with their sum, are no longer than this, bytes.
const LARGEST: u64 = 1 << 30;

/// The folder for cache files: `$RELIGHT_CACHE`, else `$XDG_CACHE_HOME/relight`, else `~/.cache/relight`.
pub(crate) fn folder() -> Option<PathBuf> {
    let set = |name| std::env::var_os(name).filter(|value| !value.is_empty()).map(PathBuf::from);
    set("RELIGHT_CACHE")
        .or_else(|| Some(set("XDG_CACHE_HOME")?.join("relight")))
        .or_else(|| Some(set("HOME")?.join(".cache").join("relight")))
}

/// What a cache file holds.
#[derive(Clone, Copy, Debug)]
pub struct CacheKind {
    /// First bytes of the file.
    pub magic: [u8; 8],
    /// To be raised when the format changes, or what is made from the same things.
    pub version: u32,
    /// Ending of the file's name, without the dot.
    pub ending: &'static str,
}

/// A place in the cache, and what the contents of its file are made from.
#[derive(Clone, Debug)]
pub struct CacheEntry {
    kind: CacheKind,
    path: PathBuf,
    fingerprint: Vec<u8>,
}

impl CacheEntry {
    /// A place in `folder`. What is made from other `things` of the same `name` and `place` replaces its file, so that no
    /// stale one is left lying.
    pub(crate) fn new(kind: CacheKind, folder: &Path, name: &str, place: &str, things: &str) -> CacheEntry {
        let short: String = name.chars().filter(|c| c.is_ascii_alphanumeric()).take(32).collect();
        let path = folder.join(format!("{short}-{:016x}.{}", fnv1a(place.as_bytes()), kind.ending));
        CacheEntry { kind, path, fingerprint: format!("{place}{things}").into_bytes() }
    }

    /// The place beside this one for another kind, made from the same things and `more`.
    pub(crate) fn beside(&self, kind: CacheKind, more: &str) -> CacheEntry {
        let fingerprint = [&self.fingerprint, more.as_bytes()].concat();
        CacheEntry { kind, path: self.path.with_extension(kind.ending), fingerprint }
    }

    /// The file, which need not be there.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// The contents that [`write`](CacheEntry::write) left, at an earlier start too; `None` if there are none, if they
    /// were made from other things, or if the file is damaged.
    pub fn read(&self) -> Option<Vec<u8>> {
        let Found { file, length, .. } = self.open().filter(|found| found.length <= LARGEST)?;
        let mut contents = Vec::new();
        contents.try_reserve_exact(usize::try_from(length).ok()?).ok()?;
        file.take(length).read_to_end(&mut contents).ok()?;
        let (made, sum) = contents.split_last_chunk()?;
        let kept = made.len();
        (fnv1a(made).to_le_bytes() == *sum).then(|| {
            contents.truncate(kept);
            contents
        })
    }

    /// Keeps contents, with a sum that tells damage. They are in place whole or not at all.
    ///
    /// # Errors
    /// If they are longer than 1 GiB, the disk has no room for them, or the file cannot be written.
    pub fn write(&self, contents: &[u8]) -> io::Result<()> {
        let sum = fnv1a(contents).to_le_bytes();
        let length = (contents.len() + sum.len()) as u64;
        if length > LARGEST {
            return Err(io::Error::new(io::ErrorKind::FileTooLarge, "is longer than such a file may be"));
        }
        let mut writer = self.create(length)?;
        writer.write(contents)?;
        writer.write(&sum)?;
        writer.finish().map(drop)
    }

    fn offset(&self) -> usize {
        (HEADER + self.fingerprint.len()).next_multiple_of(PAGE)
    }

    fn header(&self, length: u64) -> Vec<u8> {
        let mut header = Vec::with_capacity(self.offset());
        header.extend(self.kind.magic);
        header.extend(self.kind.version.to_le_bytes());
        header.extend((self.fingerprint.len() as u32).to_le_bytes());
        header.extend((self.offset() as u64).to_le_bytes());
        header.extend(length.to_le_bytes());
        header.extend(&self.fingerprint);
        header.resize(self.offset(), 0);
        header
    }

    /// The file, at its contents, if it is there and still holds.
    pub(crate) fn open(&self) -> Option<Found> {
        // Opening a pipe may never end.
        let whole = fs::metadata(&self.path).ok().filter(fs::Metadata::is_file)?.len();
        let length = whole.checked_sub(self.offset() as u64)?;
        let expected = self.header(length);
        let mut file = File::open(&self.path).ok()?;
        let mut header = vec![0; expected.len()];
        file.read_exact(&mut header).ok()?;
        (header == expected).then(|| Found { file, offset: self.offset() as u64, length })
    }

    /// Starts to write contents of `length` bytes, if the disk has room for them.
    pub(crate) fn create(&self, length: u64) -> io::Result<Writer<'_>> {
        let folder = self.path.parent().unwrap_or(Path::new("."));
        fs::create_dir_all(folder)?;
        remove_abandoned(folder)?;
        let (needed, free) = (self.offset() as u64 + length, fs4::available_space(folder)?);
        if needed > free {
            let problem = format!("the disk has {free} bytes free, and {needed} are needed");
            return Err(io::Error::new(io::ErrorKind::StorageFull, problem));
        }
        let file = tempfile::Builder::new().suffix(UNFINISHED).tempfile_in(folder)?;
        let mut file = BufWriter::with_capacity(1 << 16, file);
        file.write_all(&self.header(length))?;
        Ok(Writer { entry: self, length, file })
    }
}

/// A cache file that holds what it should, as far as its header tells.
pub(crate) struct Found {
    pub(crate) file: File,
    /// Where its contents start, bytes.
    pub(crate) offset: u64,
    /// How long they are, bytes.
    pub(crate) length: u64,
}

/// A cache file that is being written; it vanishes unless it is finished.
pub(crate) struct Writer<'a> {
    entry: &'a CacheEntry,
    length: u64,
    file: BufWriter<NamedTempFile>,
}

impl Writer<'_> {
    /// Adds to the contents.
    pub(crate) fn write(&mut self, part: &[u8]) -> io::Result<()> {
        self.file.write_all(part)
    }

    /// Puts the file in its place.
    pub(crate) fn finish(self) -> io::Result<Found> {
        let file = self.file.into_inner().map_err(io::IntoInnerError::into_error)?;
        // Whole even after a loss of power, since no sum tells whether pixels are.
        file.as_file().sync_data()?;
        let file = file.persist(&self.entry.path).map_err(|error| error.error)?;
        Ok(Found { file, offset: self.entry.offset() as u64, length: self.length })
    }
}

fn remove_abandoned(folder: &Path) -> io::Result<()> {
    for entry in fs::read_dir(folder)? {
        let entry = entry?;
        let is_old = |time: SystemTime| time.elapsed().is_ok_and(|age| age > ABANDONED);
        if entry.file_name().to_string_lossy().ends_with(UNFINISHED) && is_old(entry.metadata()?.modified()?)
        {
            fs::remove_file(entry.path())?;
        }
    }
    Ok(())
}

/// The FNV-1a hash, which is the same on every machine and in every release.
pub fn fnv1a(bytes: &[u8]) -> u64 {
    bytes
        .iter()
        .fold(0xcbf2_9ce4_8422_2325, |hash, &byte| (hash ^ u64::from(byte)).wrapping_mul(0x0100_0000_01b3))
}
