//! The journal of a session: one line for each frame that is safely on disk.

use std::collections::BTreeMap;
use std::fs::{File, OpenOptions};
use std::io::{ErrorKind, Write};
use std::path::{Path, PathBuf};

use relight_scene::read_text;
use serde::{Deserialize, Serialize};

use super::error::SessionError;

/// The first line.
const HEADER: &str = r#"{"format":"relight-journal","version":1}"#;
/// The longest journal, bytes.
const LONGEST: u64 = 1 << 28;

/// A frame that is on disk.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Entry {
    /// The view's label.
    pub view: usize,
    /// The light's label.
    pub light: usize,
    /// CRC-32 of the image file.
    pub crc32: u32,
    /// Mean of all bytes of the image, 0 to 255.
    pub brightness: f64,
    /// How much detail there is, see [`sharpness`](super::quality::sharpness).
    pub sharpness: f64,
}

/// Lines are only ever added, and each is on disk before the next frame is shot. A kill may leave half of the last
/// line, which the next start cuts off.
pub struct Journal {
    path: PathBuf,
    file: File,
    entries: BTreeMap<(usize, usize), Entry>,
}

impl Journal {
    /// Opens a journal, or begins one.
    ///
    /// # Errors
    /// If the file is of another format or version, or a line other than a torn last one is damaged or stands twice.
    pub fn open(path: &Path) -> Result<Journal, SessionError> {
        let is_there = path.try_exists().map_err(SessionError::io(path))?;
        let text = if is_there { read_text(path, LONGEST)? } else { String::new() };
        // What does not end with a line break was being written when the session was killed.
        let whole = text.rfind('\n').map_or("", |end| &text[..=end]);
        let entries = parse(path, whole)?;
        let file = OpenOptions::new().create(true).append(true).open(path).map_err(SessionError::io(path))?;
        file.set_len(whole.len() as u64).map_err(SessionError::io(path))?;
        let mut journal = Journal { path: path.to_owned(), file, entries };
        if whole.is_empty() {
            journal.line(HEADER)?;
        }
        Ok(journal)
    }

    /// The frame of a view under a light, if it is on disk.
    pub fn get(&self, view: usize, light: usize) -> Option<&Entry> {
        self.entries.get(&(view, light))
    }

    /// All frames that are on disk, by view and light.
    pub fn entries(&self) -> impl Iterator<Item = &Entry> {
        self.entries.values()
    }

    /// Adds a frame that is on disk.
    ///
    /// # Errors
    /// If the line cannot be written.
    pub fn add(&mut self, entry: Entry) -> Result<(), SessionError> {
        let line = serde_json::to_string(&entry).map_err(|error| {
            SessionError::io(&self.path)(std::io::Error::new(ErrorKind::InvalidData, error))
        })?;
        self.line(&line)?;
        self.entries.insert((entry.view, entry.light), entry);
        Ok(())
    }

    fn line(&mut self, line: &str) -> Result<(), SessionError> {
        let written =
            self.file.write_all(format!("{line}\n").as_bytes()).and_then(|()| self.file.sync_data());
        written.map_err(SessionError::io(&self.path))
    }
}

/// The entries of whole lines.
fn parse(path: &Path, text: &str) -> Result<BTreeMap<(usize, usize), Entry>, SessionError> {
    let mut entries = BTreeMap::new();
    for (i, line) in text.lines().enumerate() {
        let wrong = |problem: String| SessionError::Journal { path: path.to_owned(), line: i + 1, problem };
        if i == 0 {
            if line != HEADER {
                return Err(wrong(format!("is not {HEADER}, the only format and version that is known")));
            }
            continue;
        }
        let entry: Entry =
            serde_json::from_str(line).map_err(|error| wrong(format!("is damaged: {error}")))?;
        if entries.insert((entry.view, entry.light), entry).is_some() {
            return Err(wrong(format!("tells of view {} under light {} again", entry.view, entry.light)));
        }
    }
    Ok(entries)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn entry(view: usize, light: usize) -> Entry {
        Entry { view, light, crc32: 77 + view as u32, brightness: 101.125, sharpness: 0.1 + 0.2 }
    }

    fn three(path: &Path) -> Journal {
        let mut journal = Journal::open(path).unwrap();
        (0..3).for_each(|light| journal.add(entry(4, light)).unwrap());
        journal
    }

    #[test]
    fn a_torn_line_is_cut_off_wherever_it_is_torn_and_what_follows_is_the_same() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("journal");
        drop(three(&path));
        let whole = std::fs::read(&path).unwrap();
        for length in 0..whole.len() {
            std::fs::write(&path, &whole[..length]).unwrap();
            let mut journal = Journal::open(&path).unwrap();
            for light in journal.entries().count()..3 {
                assert!(journal.get(4, light).is_none());
                journal.add(entry(4, light)).unwrap();
            }
            assert_eq!(std::fs::read(&path).unwrap(), whole, "torn at {length}");
            assert_eq!(Journal::open(&path).unwrap().get(4, 2), Some(&entry(4, 2)));
        }
    }

    #[test]
    fn damage_is_told_by_line() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("journal");
        drop(three(&path));
        let text = std::fs::read_to_string(&path).unwrap();
        let damaged = [
            (text.replacen("\"version\":1", "\"version\":2", 1), "line 1 is not"),
            (text.replacen("\"light\":1", "\"light\":x", 1), "line 3 is damaged"),
            (text.replacen("\"light\":1", "\"light\":0", 1), "line 3 tells of view 4 under light 0 again"),
        ];
        for (text, problem) in damaged {
            std::fs::write(&path, text).unwrap();
            let error = Journal::open(&path).map(|_| ()).unwrap_err().to_string();
            assert!(error.contains(problem), "{error}");
        }
    }

    proptest! {
        #[test]
        fn any_text_is_read_or_refused(text in "(\\{\"view\":[0-9]{1,30}[^\\n]{0,20}\\n|[^\\n]{0,30}\\n?){0,5}") {
            let _ = parse(Path::new("journal"), &format!("{HEADER}\n{text}"));
            let _ = parse(Path::new("journal"), &text);
        }
    }
}
