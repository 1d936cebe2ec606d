//! The journal of a session: one line for each frame that is safely on disk, and another for each view that was checked.

use std::collections::BTreeMap;
use std::fs::{File, OpenOptions};
use std::io::{ErrorKind, Write};
use std::path::{Path, PathBuf};

use relight_scene::{read_text, write_whole};
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};

use super::error::SessionError;

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

/// Whether anything moved while a view was shot.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Check {
    /// The view's label.
    pub view: usize,
    /// The light under which it was shot again at its end.
    pub light: usize,
    /// Whether the two photographs differ by more than noise.
    pub moved: bool,
    /// How far the second is shifted to the right and down, pixels.
    pub shift: [f64; 2],
    /// By how much the second is brighter, as a share.
    pub brighter: f64,
}

/// What lines of a file tell of.
pub trait Line: Copy + Serialize + DeserializeOwned {
    /// The first line of such a file: its format and version.
    const HEADER: &str;

    /// View and light; no two lines have the same.
    fn key(&self) -> (usize, usize);
}

impl Line for Entry {
    const HEADER: &str = r#"{"format":"relight-journal","version":1}"#;

    fn key(&self) -> (usize, usize) {
        (self.view, self.light)
    }
}

impl Line for Check {
    const HEADER: &str = r#"{"format":"relight-checks","version":1}"#;

    fn key(&self) -> (usize, usize) {
        (self.view, self.light)
    }
}

/// The frames that are on disk.
pub type Journal = Log<Entry>;

/// A file whose lines are only ever added, each on disk before anything else is done. A kill may leave half of the last line,
/// which the next start cuts off.
pub struct Log<L> {
    path: PathBuf,
    file: File,
    entries: BTreeMap<(usize, usize), L>,
}

impl<L: Line> Log<L> {
    /// Opens a file, or begins one.
    ///
    /// # Errors
    /// If the file is of another format or version, or a line other than a torn last one is damaged or stands twice.
    pub fn open(path: &Path) -> Result<Log<L>, SessionError> {
        let is_there = path.try_exists().map_err(SessionError::io(path))?;
        let text = if is_there { read_text(path, LONGEST)? } else { String::new() };
        // What does not end with a line break was being written when the session was killed.
        let whole = text.rfind('\n').map_or("", |end| &text[..=end]);
        let entries = parse(path, whole)?;
        let file = OpenOptions::new().create(true).append(true).open(path).map_err(SessionError::io(path))?;
        file.set_len(whole.len() as u64).map_err(SessionError::io(path))?;
        let mut journal = Log { path: path.to_owned(), file, entries };
        if whole.is_empty() {
            journal.line(L::HEADER)?;
        }
        Ok(journal)
    }

    /// The line of a view under a light, if there is one.
    pub fn get(&self, view: usize, light: usize) -> Option<&L> {
        self.entries.get(&(view, light))
    }

    /// All lines, by view and light.
    pub fn entries(&self) -> impl Iterator<Item = &L> {
        self.entries.values()
    }

    /// Adds a line.
    ///
    /// # Errors
    /// If it cannot be written.
    pub fn add(&mut self, entry: L) -> Result<(), SessionError> {
        let line = self.json(&entry)?;
        self.line(&line)?;
        self.entries.insert(entry.key(), entry);
        Ok(())
    }

    /// Takes away all lines but those that are to stay, in one step: a kill leaves all or what stays.
    ///
    /// # Errors
    /// If the file cannot be written.
    pub fn retain(&mut self, stays: impl Fn(&L) -> bool) -> Result<(), SessionError> {
        // In the order in which they were written, as far as they stay.
        let text = read_text(&self.path, LONGEST)?;
        let mut kept = String::new();
        for (i, line) in text.lines().enumerate() {
            if i == 0 || serde_json::from_str::<L>(line).is_ok_and(|entry| stays(&entry)) {
                kept.push_str(line);
                kept.push('\n');
            }
        }
        write_whole(&self.path, |file| file.write_all(kept.as_bytes()))
            .map_err(SessionError::io(&self.path))?;
        self.file = OpenOptions::new().append(true).open(&self.path).map_err(SessionError::io(&self.path))?;
        self.entries.retain(|_, entry| stays(entry));
        Ok(())
    }

    fn json(&self, entry: &L) -> Result<String, SessionError> {
        serde_json::to_string(entry)
            .map_err(|error| SessionError::io(&self.path)(std::io::Error::new(ErrorKind::InvalidData, error)))
    }

    fn line(&mut self, line: &str) -> Result<(), SessionError> {
        let written =
            self.file.write_all(format!("{line}\n").as_bytes()).and_then(|()| self.file.sync_data());
        written.map_err(SessionError::io(&self.path))
    }
}

/// The entries of whole lines.
fn parse<L: Line>(path: &Path, text: &str) -> Result<BTreeMap<(usize, usize), L>, SessionError> {
    let mut entries = BTreeMap::new();
    for (i, line) in text.lines().enumerate() {
        let wrong = |problem: String| SessionError::Journal { path: path.to_owned(), line: i + 1, problem };
        if i == 0 {
            if line != L::HEADER {
                return Err(wrong(format!(
                    "is not {}, the only format and version that is known",
                    L::HEADER
                )));
            }
            continue;
        }
        let entry: L = serde_json::from_str(line).map_err(|error| wrong(format!("is damaged: {error}")))?;
        let (view, light) = entry.key();
        if entries.insert((view, light), entry).is_some() {
            return Err(wrong(format!("tells of view {view} under light {light} again")));
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

    #[test]
    fn lines_are_taken_away_and_others_added() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("journal");
        let mut journal = three(&path);
        journal.retain(|entry| entry.light != 1).unwrap();
        assert!(journal.get(4, 1).is_none() && journal.get(4, 2).is_some());
        journal.add(entry(5, 1)).unwrap();
        let again = Journal::open(&path).unwrap();
        assert_eq!(again.entries().map(Line::key).collect::<Vec<_>>(), [(4, 0), (4, 2), (5, 1)]);
    }

    proptest! {
        #[test]
        fn any_text_is_read_or_refused(text in "(\\{\"view\":[0-9]{1,30}[^\\n]{0,20}\\n|[^\\n]{0,30}\\n?){0,5}") {
            let _ = parse::<Entry>(Path::new("journal"), &format!("{}\n{text}", Entry::HEADER));
            let _ = parse::<Entry>(Path::new("journal"), &text);
        }
    }
}
