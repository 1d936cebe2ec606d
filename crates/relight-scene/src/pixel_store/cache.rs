//! Decoded pixels in a file, for the next start.
//!
//! The file: `RELIGHTP`, version (u32), length of the fingerprint (u32), offset and length of the pixels (u64 each), all
//! little endian; the fingerprint; zeros up to the offset; the pixels. The fingerprint lists cameras, lights and image
//! files with their sizes and times, and must match byte for byte: a changed image makes the file stale. Its name
//! depends on the scene's path and the frames, so that a stale file is replaced and not left lying.

use std::fmt::Write as _;
use std::fs::{self, File};
use std::io::{self, BufWriter, Read, Write};
use std::path::{Path, PathBuf};
use std::time::{Duration, SystemTime};

use memmap2::{Mmap, MmapOptions};
use tempfile::NamedTempFile;

use super::View;
use crate::scene::Scene;

const MAGIC: [u8; 8] = *b"RELIGHTP";
const VERSION: u32 = 1;
const HEADER: usize = 32;
/// Pixels start at a page.
const PAGE: usize = 4096;
/// Unfinished files of programs that died are removed after this time.
const ABANDONED: Duration = Duration::from_secs(3600);
const UNFINISHED: &str = ".unfinished";

/// The folder for cache files: `$RELIGHT_CACHE`, else `$XDG_CACHE_HOME/relight`, else `~/.cache/relight`.
pub(super) fn folder() -> Option<PathBuf> {
    let set = |name| std::env::var_os(name).filter(|value| !value.is_empty()).map(PathBuf::from);
    set("RELIGHT_CACHE")
        .or_else(|| Some(set("XDG_CACHE_HOME")?.join("relight")))
        .or_else(|| Some(set("HOME")?.join(".cache").join("relight")))
}

/// A place for the pixels of certain frames.
pub(super) struct Entry {
    folder: PathBuf,
    path: PathBuf,
    fingerprint: Vec<u8>,
    length: usize,
}

impl Entry {
    /// The place in `folder` for some views; `None` if an image cannot be looked at or the folder is within the dataset.
    pub(super) fn new(folder: &Path, scene: &Scene, views: &[View], length: usize) -> Option<Entry> {
        let root = fs::canonicalize(&scene.root).ok()?;
        let existing = folder.ancestors().find_map(|ancestor| fs::canonicalize(ancestor).ok())?;
        if existing.starts_with(&root) {
            tracing::warn!("{}: is inside the dataset: decoded pixels are not kept there", folder.display());
            return None;
        }
        let mut frames = String::new();
        let mut times = String::new();
        for view in views {
            let lens = &scene.cameras[view.camera].intrinsics;
            writeln!(frames, "view {} {}x{}", view.camera, lens.width, lens.height).ok()?;
            for (&light, &frame) in view.lights.iter().zip(&view.frames) {
                let path = &scene.frames[frame].path;
                let metadata = fs::metadata(path).ok()?;
                let time = metadata.modified().ok()?.duration_since(SystemTime::UNIX_EPOCH).ok()?;
                writeln!(frames, "{light} {}", path.strip_prefix(&scene.root).unwrap_or(path).display())
                    .ok()?;
                writeln!(times, "{} {}", metadata.len(), time.as_nanos()).ok()?;
            }
        }
        let place = format!("{}\n{frames}", root.display());
        let short: String = scene.name.chars().filter(|c| c.is_ascii_alphanumeric()).take(32).collect();
        let path = folder.join(format!("{short}-{:016x}.pixels", fnv1a(place.as_bytes())));
        let fingerprint = format!("{place}{times}").into_bytes();
        Some(Entry { folder: folder.to_owned(), path, fingerprint, length })
    }

    /// The file.
    pub(super) fn path(&self) -> &Path {
        &self.path
    }

    fn offset(&self) -> usize {
        (HEADER + self.fingerprint.len()).next_multiple_of(PAGE)
    }

    fn header(&self) -> Vec<u8> {
        let mut header = Vec::with_capacity(self.offset());
        header.extend(MAGIC);
        header.extend(VERSION.to_le_bytes());
        header.extend((self.fingerprint.len() as u32).to_le_bytes());
        header.extend((self.offset() as u64).to_le_bytes());
        header.extend((self.length as u64).to_le_bytes());
        header.extend(&self.fingerprint);
        header.resize(self.offset(), 0);
        header
    }

    /// The pixels, if they are there and still hold.
    pub(super) fn open(&self) -> Option<Mmap> {
        let mut file = File::open(&self.path).ok()?;
        let expected = self.header();
        if file.metadata().ok()?.len() != (expected.len() + self.length) as u64 {
            return None;
        }
        let mut header = vec![0; expected.len()];
        file.read_exact(&mut header).ok()?;
        if header != expected {
            return None;
        }
        self.map(&file).ok()
    }

    fn map(&self, file: &File) -> io::Result<Mmap> {
        // SAFETY: the mapping is read-only, any bytes are valid pixels, and the file has the length that is mapped. A
        // file under this name is never changed in place by this program: it is written under another name and renamed,
        // so an existing mapping keeps its old contents. Only someone who truncates files in the user's own cache folder
        // by hand could make a read fail, by a signal and not by undefined contents.
        unsafe { MmapOptions::new().offset(self.offset() as u64).len(self.length).map(file) }
    }

    /// Starts to write the pixels, if the disk has room for them.
    pub(super) fn create(&self) -> io::Result<Writer<'_>> {
        fs::create_dir_all(&self.folder)?;
        self.remove_abandoned()?;
        let (needed, free) = ((self.offset() + self.length) as u64, fs4::available_space(&self.folder)?);
        if needed > free {
            let problem = format!("the disk has {free} bytes free, and {needed} are needed");
            return Err(io::Error::new(io::ErrorKind::StorageFull, problem));
        }
        let file = tempfile::Builder::new().suffix(UNFINISHED).tempfile_in(&self.folder)?;
        let mut file = BufWriter::with_capacity(1 << 16, file);
        file.write_all(&self.header())?;
        Ok(Writer { entry: self, file })
    }

    fn remove_abandoned(&self) -> io::Result<()> {
        for entry in fs::read_dir(&self.folder)? {
            let entry = entry?;
            let is_old = |time: SystemTime| time.elapsed().is_ok_and(|age| age > ABANDONED);
            if entry.file_name().to_string_lossy().ends_with(UNFINISHED)
                && is_old(entry.metadata()?.modified()?)
            {
                fs::remove_file(entry.path())?;
            }
        }
        Ok(())
    }
}

/// A cache file that is being written; it vanishes unless it is finished.
pub(super) struct Writer<'a> {
    entry: &'a Entry,
    file: BufWriter<NamedTempFile>,
}

impl Writer<'_> {
    /// Adds pixels.
    pub(super) fn write(&mut self, part: &[u8]) -> io::Result<()> {
        self.file.write_all(part)
    }

    /// Puts the file in its place and maps it.
    pub(super) fn finish(self) -> io::Result<Mmap> {
        let file = self.file.into_inner().map_err(io::IntoInnerError::into_error)?;
        let file = file.persist(&self.entry.path).map_err(|error| error.error)?;
        self.entry.map(&file)
    }
}

/// The FNV-1a hash, which is the same on every machine and in every release.
fn fnv1a(bytes: &[u8]) -> u64 {
    bytes
        .iter()
        .fold(0xcbf2_9ce4_8422_2325, |hash, &byte| (hash ^ u64::from(byte)).wrapping_mul(0x0100_0000_01b3))
}
