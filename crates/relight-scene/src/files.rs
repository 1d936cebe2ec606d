//! Reading files that may be anything, and writing files so that no half of one is ever seen.

use std::fs;
use std::io::{self, Read, Write};
use std::path::{Path, PathBuf};

use crate::error::{FaultKind, SceneError};

/// Folders with more entries than this are not captures.
const MOST_ENTRIES: usize = 200_000;
/// Ending of a file that [`write_whole`] is at.
pub const UNFINISHED: &str = ".part";

/// The length of a plain file. Pipes and devices, on which a read may never end, are refused.
pub(crate) fn plain_file_length(path: &Path) -> Result<u64, SceneError> {
    let metadata = fs::metadata(path).map_err(|error| SceneError::io(path, "be read", &error))?;
    if !metadata.is_file() {
        return Err(SceneError::fault(
            FaultKind::Unreadable,
            path,
            "is not a file",
            "Put the real file in its place.",
        ));
    }
    Ok(metadata.len())
}

/// Reads a file of at most `limit` bytes, whatever the path may name: for files that come from elsewhere.
///
/// # Errors
/// [`SceneError::Fault`] that names the file, if it is no regular file (a read from a pipe or a device may never end), is
/// longer or cannot be read.
pub fn read_bytes(path: &Path, limit: u64) -> Result<Vec<u8>, SceneError> {
    let length = plain_file_length(path)?;
    let too_long = || {
        let problem = format!("is longer than the {limit} bytes that such a file can need");
        SceneError::fault(FaultKind::Malformed, path, problem, "Put the right file in its place.")
    };
    if length > limit {
        return Err(too_long());
    }
    let io = |error| SceneError::io(path, "be read", &error);
    let mut bytes = Vec::with_capacity(length as usize);
    fs::File::open(path).map_err(io)?.take(limit + 1).read_to_end(&mut bytes).map_err(io)?;
    if bytes.len() as u64 > limit { Err(too_long()) } else { Ok(bytes) }
}

/// Reads a text file, as [`read_bytes`] does.
///
/// # Errors
/// As [`read_bytes`]; also if it is not UTF-8.
pub fn read_text(path: &Path, limit: u64) -> Result<String, SceneError> {
    String::from_utf8(read_bytes(path, limit)?).map_err(|_| {
        SceneError::fault(FaultKind::Malformed, path, "is not text", "Put the right file in its place.")
    })
}

/// Names and paths of a folder's entries, sorted; hidden ones are left out.
pub(crate) fn list(folder: &Path) -> Result<Vec<(String, PathBuf)>, SceneError> {
    let io = |error| SceneError::io(folder, "be listed", &error);
    let mut entries = Vec::new();
    for entry in fs::read_dir(folder).map_err(io)? {
        let entry = entry.map_err(io)?;
        let name = entry.file_name().to_string_lossy().into_owned();
        if name.starts_with('.') {
            continue;
        }
        if entries.len() == MOST_ENTRIES {
            let problem = format!("holds more than {MOST_ENTRIES} entries");
            return Err(SceneError::fault(FaultKind::Extra, folder, problem, "This is not a capture."));
        }
        entries.push((name, entry.path()));
    }
    entries.sort();
    Ok(entries)
}

/// Writes a file that a later start must find whole, after a loss of power too: beside `path`, then renamed to it. A kill
/// leaves at most the one file of that name with the ending [`UNFINISHED`], which the next attempt replaces.
///
/// # Errors
/// If `path` names a folder or the file cannot be written; nothing is left then.
pub fn write_whole(path: &Path, write: impl FnOnce(&mut fs::File) -> io::Result<()>) -> io::Result<()> {
    if path.is_dir() {
        return Err(io::Error::new(io::ErrorKind::IsADirectory, "is a folder: name a file"));
    }
    let mut name = path.as_os_str().to_owned();
    name.push(UNFINISHED);
    let unfinished = PathBuf::from(name);
    let written = fs::File::create(&unfinished).and_then(|mut file| {
        write(&mut file)?;
        file.sync_data()?;
        fs::rename(&unfinished, path)
    });
    written.inspect_err(|_| {
        // What went wrong is told already; that this fails too adds nothing.
        let _ = fs::remove_file(&unfinished);
    })
}

/// Writes a file to a temporary one beside it, then renames.
pub(crate) fn write(path: &Path, bytes: &[u8]) -> Result<(), SceneError> {
    let io = |error: &std::io::Error| SceneError::io(path, "be written", error);
    let folder = path.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let mut file = tempfile::NamedTempFile::new_in(folder).map_err(|error| io(&error))?;
    file.write_all(bytes).map_err(|error| io(&error))?;
    make_readable(&file).map_err(|error| io(&error))?;
    file.persist(path).map_err(|error| io(&error.error))?;
    Ok(())
}

/// Temporary files are their maker's alone; results should be as readable as any other file.
#[cfg(unix)]
fn make_readable(file: &tempfile::NamedTempFile) -> std::io::Result<()> {
    use std::os::unix::fs::PermissionsExt;
    file.as_file().set_permissions(fs::Permissions::from_mode(0o644))
}

#[cfg(not(unix))]
fn make_readable(_: &tempfile::NamedTempFile) -> std::io::Result<()> {
    Ok(())
}
