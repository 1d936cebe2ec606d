//! Dark and flat frames of a session: shot at its start, kept in its folder.

use std::io::Write;
use std::path::{Path, PathBuf};

use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;
use relight_scene::{read_text, write_whole};
use serde::{Deserialize, Serialize};
use serde_json::Value;

use super::photograph::Photographer;
use super::{Care, Rig, STATE, SessionError, Shots, Subject};
use crate::camera::{Average, BayerPattern, Correction};

const FORMAT: &str = "relight-reference-frame";
const VERSION: u64 = 1;
const LONGEST: u64 = 1 << 30;
/// Steps that a level is kept in.
const STEPS: f32 = 256.0;
/// The key of a session's [`Subject`] under which the camera's settings stand, if they do. Dark and flat frames of other
/// settings are refused.
pub const CAMERA: &str = "camera";

/// What a rig is asked to hold before its camera.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Target {
    /// Nothing that shines: the lamp off and the room dark, or the lens capped.
    Dark,
    /// An evenly lit, matt, white surface, out of focus if it can be.
    Flat,
    /// A matt grey card under the lamp, flat in the place of what is to be captured; its middle is here, world, metres.
    Card([f64; 3]),
    /// What is to be captured, under the lamp.
    Scene,
}

impl Target {
    fn name(self) -> &'static str {
        match self {
            Target::Dark => "dark",
            Target::Flat => "flat",
            Target::Card(_) => "card",
            Target::Scene => "scene",
        }
    }
}

#[derive(Serialize, Deserialize)]
struct File {
    format: String,
    version: u64,
    /// Which of the two it is.
    target: String,
    /// How many frames it is the mean of.
    frames: u32,
    /// How the camera was set, as the session's subject says it.
    camera: Value,
    width: u32,
    height: u32,
    pattern: BayerPattern,
    /// Levels in steps of 1/256, as base64 of 16-bit numbers, low byte first.
    data: String,
}

/// The correction that the session's dark and flat frames make. What is not there is shot, and the rig told to show the scene
/// again.
pub(super) fn correction(
    rig: &mut dyn Rig,
    shots: &Shots,
    care: &Care,
    subject: &Subject,
    out: &Path,
) -> Result<Option<Correction>, SessionError> {
    let mut disturbed = false;
    let photographer = Photographer { shots, care, correction: None, gains: Vec::new() };
    let mut averages = [None, None];
    let wanted = [(Target::Dark, care.dark_frames), (Target::Flat, care.flat_frames)];
    for (average, (target, frames)) in averages.iter_mut().zip(wanted) {
        if frames == 0 {
            continue;
        }
        let path = out.join(STATE).join(format!("{}.json", target.name()));
        if !path.try_exists().map_err(SessionError::io(&path))? {
            rig.show(target).map_err(|fault| SessionError::Reference { target: target.name(), fault })?;
            disturbed = true;
            // No view and no light stands for these frames; errors name the first.
            let frames: Vec<_> =
                (0..frames).map(|_| photographer.whole(rig, 0, 0)).collect::<Result<_, _>>()?;
            let mean = Average::of(&frames)
                .map_err(|error| SessionError::Reference { target: target.name(), fault: error.into() })?;
            write(&path, target, frames.len() as u32, subject, &mean)?;
        }
        // What was just written too: a session resumed later is to see the same numbers.
        *average = Some(read(&path, target, frames, subject)?);
    }
    if disturbed {
        rig.show(Target::Scene).map_err(|fault| SessionError::Reference { target: "scene", fault })?;
    }
    let [dark, flat] = averages;
    let correction = Correction::new(dark.as_ref(), flat.as_ref(), &shots.development)
        .map_err(|error| SessionError::Reference { target: "dark and flat", fault: error.into() })?;
    if let Some(correction) = &correction {
        tracing::info!("{} hot or dead pixels are filled from their neighbours", correction.bad_pixels());
    }
    Ok(correction)
}

fn write(
    path: &Path,
    target: Target,
    frames: u32,
    subject: &Subject,
    mean: &Average,
) -> Result<(), SessionError> {
    let steps = mean.data.iter().map(|level| (level * STEPS).round() as u16);
    let bytes: Vec<u8> = steps.flat_map(u16::to_le_bytes).collect();
    let file = File {
        format: FORMAT.to_owned(),
        version: VERSION,
        target: target.name().to_owned(),
        frames,
        camera: subject.get(CAMERA).cloned().unwrap_or_default(),
        width: mean.width,
        height: mean.height,
        pattern: mean.pattern,
        data: STANDARD.encode(bytes),
    };
    let json = serde_json::to_vec(&file).map_err(|error| SessionError::io(path)(error.into()))?;
    write_whole(path, |file| file.write_all(&json)).map_err(SessionError::io(path))
}

fn read(path: &Path, target: Target, frames: u32, subject: &Subject) -> Result<Average, SessionError> {
    let other = |problem: String| SessionError::Other { path: PathBuf::from(path), problem };
    let anew = "Remove the file, and the frames are shot again";
    let damaged = |what: String| other(format!("is damaged: {what}. {anew}."));
    let value: Value =
        serde_json::from_str(&read_text(path, LONGEST)?).map_err(|error| damaged(error.to_string()))?;
    if value["format"] != FORMAT || value["version"] != VERSION {
        let (format, version) = (&value["format"], &value["version"]);
        return Err(other(format!(
            "is of format {format} version {version}, and only \"{FORMAT}\" version {VERSION} is known. {anew}."
        )));
    }
    let file: File = serde_json::from_value(value).map_err(|error| damaged(error.to_string()))?;
    let camera = subject.get(CAMERA).cloned().unwrap_or_default();
    if (file.target.as_str(), file.frames, &file.camera) != (target.name(), frames, &camera) {
        return Err(other(format!(
            "is the {} frame, mean of {}, of a camera set to {}; the session needs the {} frame, mean of {frames}, of \
             {camera}. {anew}.",
            file.target,
            file.frames,
            file.camera,
            target.name()
        )));
    }
    let bytes = STANDARD.decode(&file.data).map_err(|error| damaged(error.to_string()))?;
    let pixels = u64::from(file.width) * u64::from(file.height);
    if bytes.len() as u64 != 2 * pixels {
        return Err(damaged(format!("{} bytes for {pixels} pixels", bytes.len())));
    }
    let data =
        bytes.as_chunks::<2>().0.iter().map(|&pair| f32::from(u16::from_le_bytes(pair)) / STEPS).collect();
    Ok(Average { width: file.width, height: file.height, pattern: file.pattern, data })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn averages_are_kept_and_those_of_something_else_refused() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("dark.json");
        let data = vec![0.0, 1.5, 20.25, 255.0, 3.0, 4.0];
        let mean = Average { width: 3, height: 2, pattern: BayerPattern::Gbrg, data };
        let set = |exposure: i32| Subject::from_iter([(CAMERA.to_owned(), exposure.into())]);
        write(&path, Target::Dark, 8, &set(500), &mean).unwrap();
        assert_eq!(read(&path, Target::Dark, 8, &set(500)).unwrap(), mean);
        let refusal =
            |target, frames, subject: &Subject| read(&path, target, frames, subject).unwrap_err().to_string();
        for error in [
            refusal(Target::Flat, 8, &set(500)),
            refusal(Target::Dark, 9, &set(500)),
            refusal(Target::Dark, 8, &set(900)),
            refusal(Target::Dark, 8, &Subject::new()),
        ] {
            assert!(
                error.contains("dark.json: is the dark frame, mean of 8, of a camera set to 500"),
                "{error}"
            );
        }
        let text = std::fs::read_to_string(&path).unwrap();
        for (from, to, problem) in [
            ("\"version\":1", "\"version\":2", "version 2, and only"),
            ("\"width\":3", "\"width\":4000000000", "12 bytes for 8000000000 pixels"),
            ("\"data\":\"", "\"data\":\"?", "is damaged"),
            ("gbrg", "xyz", "is damaged"),
        ] {
            std::fs::write(&path, text.replacen(from, to, 1)).unwrap();
            let error = refusal(Target::Dark, 8, &set(500));
            assert!(error.contains(problem), "{error}");
        }
    }
}
