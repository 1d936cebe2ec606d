//! Decoded pixels in a file, for the next start.
//!
//! The fingerprint lists cameras, lights and image files with their sizes and times: a changed image makes the file
//! stale. The file's name depends on the scene's path and the frames.

use std::fmt::Write as _;
use std::fs;
use std::io;
use std::path::Path;
use std::time::SystemTime;

use memmap2::{Mmap, MmapOptions};

use super::View;
use crate::cache_file::{CacheEntry, CacheKind, Found};
use crate::scene::Scene;

const PIXELS: CacheKind = CacheKind { magic: *b"RELIGHTP", version: 1, ending: "pixels" };

/// The place in `folder` for some views; `None` if an image cannot be looked at or the folder is within the dataset.
pub(super) fn entry(folder: &Path, scene: &Scene, views: &[View]) -> Option<CacheEntry> {
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
            writeln!(frames, "{light} {}", path.strip_prefix(&scene.root).unwrap_or(path).display()).ok()?;
            writeln!(times, "{} {}", metadata.len(), time.as_nanos()).ok()?;
        }
    }
    let place = format!("{}\n{frames}", root.display());
    Some(CacheEntry::new(PIXELS, folder, &scene.name, &place, &times))
}

/// The pixels in the file of `entry`, if they are there and still hold.
pub(super) fn open(entry: &CacheEntry, length: usize) -> Option<Mmap> {
    map(entry.open().filter(|found| found.length == length as u64)?).ok()
}

/// The pixels in a file.
pub(super) fn map(Found { file, offset, length }: Found) -> io::Result<Mmap> {
    let length = usize::try_from(length).map_err(|_| io::ErrorKind::FileTooLarge)?;
    // SAFETY: the mapping is read-only, any bytes are valid pixels, and the file has the length that is mapped. A file
    // under this name is never changed in place by this program: it is written under another name and renamed, so an
    // existing mapping keeps its old contents. Only someone who truncates files in the user's own cache folder by hand
    // could make a read fail, by a signal and not by undefined contents.
    unsafe { MmapOptions::new().offset(offset).len(length).map(&file) }
}
