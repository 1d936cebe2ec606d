//! What a session remembers of itself: what is captured, and the journal.

use std::fs;
use std::io::Write;
use std::path::Path;

use relight_scene::{UNFINISHED, read_text, write_whole};
use serde::{Deserialize, Serialize};
use serde_json::{Map, Value};

use super::error::SessionError;
use super::{Care, Journal, Shots};
use crate::calibration::StoredIntrinsics;

/// The folder of a session's own files, inside the scene's.
pub const STATE: &str = ".capture";
/// What is captured.
const SUBJECT: &str = "session.json";
pub(super) const JOURNAL: &str = "journal.jsonl";
const FORMAT: &str = "relight-session";
/// Sessions with nothing around their photographs are of version 1, as they always were; others of version 2.
const VERSIONS: [u64; 2] = [1, 2];
const LONGEST: u64 = 1 << 26;
/// What raw sessions of the virtual rig did not tell at first.
const TOLD_SINCE: [&str; 2] = ["white balance", "black level"];

/// What stands before the camera and how it is shot, in words and numbers of whoever starts the session: all that makes
/// its frames what they are.
pub type Subject = Map<String, Value>;

#[derive(Serialize, Deserialize)]
struct File {
    format: String,
    version: u64,
    subject: Subject,
    /// Poses, row-major `[R | t]`.
    cameras: Vec<[[f64; 4]; 3]>,
    lights: Vec<[[f64; 4]; 3]>,
    /// The lens; sessions of before do not tell it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    lens: Option<StoredIntrinsics>,
    /// What is done around each photograph.
    #[serde(default, skip_serializing_if = "is_none")]
    care: Care,
}

fn is_none(care: &Care) -> bool {
    *care == Care::default()
}

/// Begins a session in `out`, or opens the one that is there.
pub(super) fn open(
    out: &Path,
    subject: &Subject,
    shots: &Shots,
    care: &Care,
    resume: bool,
) -> Result<Journal, SessionError> {
    let state = out.join(STATE);
    let path = state.join(SUBJECT);
    let poses = |poses: &[relight_scene::Pose]| poses.iter().map(|pose| pose.0).collect();
    let file = File {
        format: FORMAT.to_owned(),
        version: VERSIONS[usize::from(!is_none(care))],
        subject: subject.clone(),
        cameras: poses(&shots.cameras),
        lights: poses(&shots.lights),
        lens: Some(StoredIntrinsics::from(&shots.intrinsics)),
        care: care.clone(),
    };
    if path.try_exists().map_err(SessionError::io(&path))? {
        if !resume {
            return Err(SessionError::Begun(out.to_owned()));
        }
        compare(&path, &file)?;
    } else {
        if !is_fresh(out)? {
            return Err(SessionError::NotEmpty(out.to_owned()));
        }
        fs::create_dir_all(&state).map_err(SessionError::io(&state))?;
        let json = serde_json::to_vec_pretty(&file).map_err(|error| SessionError::io(&path)(error.into()))?;
        write_whole(&path, |file| file.write_all(&json)).map_err(SessionError::io(&path))?;
    }
    Journal::open(&state.join(JOURNAL))
}

/// Whether nothing is there but what a session leaves that was killed before it had begun.
fn is_fresh(out: &Path) -> Result<bool, SessionError> {
    let unfinished = format!("{SUBJECT}{UNFINISHED}");
    for (folder, known) in [(out.to_owned(), STATE), (out.join(STATE), unfinished.as_str())] {
        if !folder.try_exists().map_err(SessionError::io(&folder))? {
            continue;
        }
        for entry in fs::read_dir(&folder).map_err(SessionError::io(&folder))? {
            if entry.map_err(SessionError::io(&folder))?.file_name() != known {
                return Ok(false);
            }
        }
    }
    Ok(true)
}

/// Refuses to go on with a session of something else.
fn compare(path: &Path, file: &File) -> Result<(), SessionError> {
    let other = |problem: String| SessionError::Other { path: path.to_owned(), problem };
    let malformed =
        |error: serde_json::Error| other(format!("is damaged: {error}. Start anew in another folder."));
    let text = read_text(path, LONGEST)?;
    let value: Value = serde_json::from_str(&text).map_err(malformed)?;
    if value["format"] != FORMAT || !VERSIONS.iter().any(|&version| value["version"] == version) {
        let (format, version) = (&value["format"], &value["version"]);
        return Err(other(format!(
            "is of format {format} version {version}, and only \"{FORMAT}\" versions 1 and 2 are known. Use the program \
             that began the session."
        )));
    }
    let begun: File = serde_json::from_value(value).map_err(malformed)?;
    let keys = file.subject.keys().chain(begun.subject.keys());
    for key in keys {
        let (now, then) = (file.subject.get(key), begun.subject.get(key));
        let is_unknown = then.is_none() && TOLD_SINCE.contains(&key.as_str());
        if now != then && !is_unknown {
            let tell = |value: Option<&Value>| value.map_or("nothing".to_owned(), Value::to_string);
            return Err(other(format!(
                "the session was begun with {key} {}, not {}. Resume it as it was begun, or start anew in another folder.",
                tell(then),
                tell(now)
            )));
        }
    }
    if begun.care != file.care {
        let tell = |care: &Care| serde_json::to_string(care).unwrap_or_default();
        return Err(other(format!(
            "the session was begun with the settings {}, not {}. Resume it as it was begun, or start anew in another folder.",
            tell(&begun.care),
            tell(&file.care)
        )));
    }
    if (&begun.cameras, &begun.lights) != (&file.cameras, &file.lights) {
        return Err(other(
            "the session was begun with other poses. Resume it with its own plan and calibration, or start anew in \
             another folder."
                .to_owned(),
        ));
    }
    if begun.lens.is_some() && begun.lens != file.lens {
        return Err(other(
            "the session was begun with another lens. Resume it with its own calibration, or the [lens] that its rig file \
             had, or start anew in another folder."
                .to_owned(),
        ));
    }
    Ok(())
}
