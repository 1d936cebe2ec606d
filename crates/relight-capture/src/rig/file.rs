//! The rig file: what a person writes down about a rig, in TOML, to plan and to shoot.

use std::path::{Path, PathBuf};
use std::time::Duration;

use relight_scene::{Intrinsics, read_text};
use serde::Deserialize;

use super::arms_rig::Pace;
use super::error::SetupError;
use super::suggestion::with_suggestion;
use crate::calibration::BoardSettings;
use crate::camera::{Development, GigeSettings};
use crate::kinematics::ArmsSettings;
use crate::robot::JointSpeed;
use crate::session::Care;
use crate::trajectory::{ArmSettings, ObjectBox, PlanSettings};

/// A rig file's longest length, bytes.
const LONGEST: u64 = 1 << 20;
/// Most that a person waits for arms to settle, or for a photograph, seconds.
const LONGEST_WAIT: f64 = 3600.0;

/// A rig as a person writes it down. All tables may be left out: planning needs none, shooting most.
#[derive(Clone, Debug, Default, PartialEq, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct RigFile {
    /// The box that holds the object.
    pub object: Option<ObjectBox>,
    /// The camera's dome.
    pub camera: Option<ArmSettings>,
    /// The light's dome.
    pub light: Option<ArmSettings>,
    /// Where the arms stand.
    pub arms: Option<ArmsSettings>,
    /// Where their controllers listen; simulated ones are started if a virtual camera is asked for and none are named.
    pub controllers: Option<Controllers>,
    /// How arms move.
    pub motion: MotionSettings,
    /// What takes the photographs.
    pub photographs: Option<Photographs>,
    /// The lens, roughly, for captures without a calibration.
    pub lens: Option<RoughLens>,
    /// How raw photographs are developed.
    pub development: Developing,
    /// What is done around each photograph.
    pub session: Care,
    /// The board that calibrates the rig.
    pub board: Option<BoardSettings>,
}

/// Where the controllers of both arms listen, each HOST or HOST:PORT.
#[derive(Clone, Debug, PartialEq, Eq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Controllers {
    /// That of the arm with the camera.
    pub camera: String,
    /// That of the arm with the light.
    pub light: String,
}

/// How arms move, as a person writes it.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields, default, rename_all = "kebab-case")]
pub struct MotionSettings {
    /// Speed of the joint that goes farthest, a second.
    pub speed_degrees: f64,
    /// Its acceleration, a second squared.
    pub acceleration_degrees: f64,
    /// How long to wait after the arms came to rest.
    pub settle_seconds: f64,
}

impl Default for MotionSettings {
    fn default() -> Self {
        let JointSpeed { speed, acceleration } = JointSpeed::USUAL;
        Self {
            speed_degrees: speed.to_degrees(),
            acceleration_degrees: acceleration.to_degrees(),
            settle_seconds: 0.3,
        }
    }
}

/// What takes the photographs.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields, tag = "from", rename_all = "kebab-case", rename_all_fields = "kebab-case")]
pub enum Photographs {
    /// Any camera whose own program saves to a folder.
    Folder {
        /// The folder; relative to the rig file's.
        folder: PathBuf,
        /// The program that shoots, and its arguments; none if somebody presses the button.
        #[serde(default)]
        command: Vec<String>,
        /// How long to wait for a photograph.
        #[serde(default = "patience")]
        patience_seconds: f64,
        /// Width and height, pixels.
        size: [u32; 2],
    },
    /// A camera that speaks GigE Vision; the program has to be built with the feature `gige`.
    Gige(GigeSettings),
    /// The path tracer, from where the arms stand.
    Virtual {
        /// Whether it gives raw frames, with what dark and flat frames take away, and no developed ones.
        #[serde(default)]
        raw: bool,
    },
}

impl Photographs {
    /// Width and height of a real camera's photographs, pixels; virtual ones are of any size.
    pub fn size(&self) -> Option<[u32; 2]> {
        match self {
            Photographs::Folder { size, .. } => Some(*size),
            Photographs::Gige(settings) => Some(settings.size),
            Photographs::Virtual { .. } => None,
        }
    }
}

fn patience() -> f64 {
    30.0
}

/// A lens by what its maker says, without distortion.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields, rename_all = "kebab-case")]
pub struct RoughLens {
    /// Focal length along rows and columns, pixels.
    pub focal_pixels: [f64; 2],
    /// Principal point, pixels; the middle if not given.
    pub centre_pixels: Option<[f64; 2]>,
}

/// How raw photographs are developed.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields, default, rename_all = "kebab-case")]
pub struct Developing {
    /// Gains of red, green and blue.
    pub white_balance: [f32; 3],
    /// What the sensor reports without light, 0 to 255.
    pub black_level: f32,
}

impl Default for Developing {
    fn default() -> Self {
        let Development { white_balance, black_level } = Development::default();
        Self { white_balance, black_level }
    }
}

impl RigFile {
    /// Reads a rig file and checks its numbers; those of domes and arms are checked when they are planned.
    ///
    /// # Errors
    /// If the file cannot be read, has a key that is none, or a number that cannot be.
    pub fn read(path: &Path) -> Result<RigFile, SetupError> {
        let text = read_text(path, LONGEST)?;
        let wrong = |problem: String| SetupError::File { path: path.to_owned(), problem };
        let mut file: RigFile =
            toml::from_str(&text).map_err(|error| wrong(with_suggestion(&error.to_string())))?;
        file.check().map_err(wrong)?;
        if let Some(Photographs::Folder { folder, .. }) = &mut file.photographs
            && let Some(beside) = path.parent()
        {
            *folder = beside.join(folder.as_path());
        }
        Ok(file)
    }

    fn check(&self) -> Result<(), String> {
        let MotionSettings { speed_degrees, acceleration_degrees, settle_seconds } = self.motion;
        let most = JointSpeed::FASTEST;
        for (key, value, most) in [
            ("speed-degrees", speed_degrees, most.speed.to_degrees()),
            ("acceleration-degrees", acceleration_degrees, most.acceleration.to_degrees()),
        ] {
            if !(value > 0.0 && value <= most) {
                return Err(format!("[motion] {key} {value}: it must be above 0 and at most {most:.1}"));
            }
        }
        let wait = |key: &str, seconds: f64| {
            if (0.0..=LONGEST_WAIT).contains(&seconds) {
                return Ok(());
            }
            Err(format!("{key} {seconds}: it must be from 0 to {LONGEST_WAIT}"))
        };
        wait("[motion] settle-seconds", settle_seconds)?;
        if let Some(Photographs::Folder { patience_seconds, .. }) = &self.photographs {
            wait("[photographs] patience-seconds", *patience_seconds)?;
        }
        if let Some(size) = self.photographs.as_ref().and_then(Photographs::size)
            && (size.contains(&0) || size.iter().any(|side| *side > 1 << 15))
        {
            return Err(format!("[photographs] size {size:?}: give width and height in pixels"));
        }
        if (self.session.dark_frames > 0 || self.session.flat_frames > 0)
            && let Some(Photographs::Folder { .. } | Photographs::Virtual { raw: false }) = self.photographs
        {
            return Err("[session] dark-frames and flat-frames correct raw frames, and this camera develops its own: leave \
                        them out (a virtual camera gives raw frames with raw = true in [photographs])"
                .to_owned());
        }
        if let Some(RoughLens { focal_pixels, centre_pixels }) = &self.lens
            && !(focal_pixels.iter().all(|f| f.is_finite() && *f > 0.0)
                && centre_pixels.is_none_or(|c| c.iter().all(|c| c.is_finite())))
        {
            return Err("[lens] focal-pixels must be positive, and all its numbers finite".to_owned());
        }
        if let Some(Err(error)) = self.board.as_ref().map(BoardSettings::board) {
            return Err(format!("[board] {error}"));
        }
        let Developing { white_balance, black_level } = self.development;
        if !white_balance.iter().all(|gain| gain.is_finite() && *gain > 0.0) {
            return Err("[development] white-balance: give three positive gains".to_owned());
        }
        if !(0.0..255.0).contains(&black_level) {
            return Err(format!("[development] black-level {black_level}: it must be from 0 to below 255"));
        }
        Ok(())
    }

    /// Where waypoints stand; the paper's where the file does not say.
    pub fn plan_settings(&self) -> PlanSettings {
        let paper = PlanSettings::default();
        PlanSettings {
            object: self.object.unwrap_or(paper.object),
            camera: self.camera.unwrap_or(paper.camera),
            light: self.light.unwrap_or(paper.light),
        }
    }

    /// How arms move.
    pub fn pace(&self) -> Pace {
        let MotionSettings { speed_degrees, acceleration_degrees, settle_seconds } = self.motion;
        let speed = speed_degrees.to_radians().min(JointSpeed::FASTEST.speed);
        let acceleration = acceleration_degrees.to_radians().min(JointSpeed::FASTEST.acceleration);
        let settle = Duration::try_from_secs_f64(settle_seconds).unwrap_or_default();
        Pace { speed: JointSpeed { speed, acceleration }, settle }
    }

    /// How raw photographs are developed.
    pub fn development(&self) -> Development {
        let Developing { white_balance, black_level } = self.development;
        Development { white_balance, black_level }
    }
}

impl RoughLens {
    /// The lens before a sensor of a size.
    pub fn intrinsics(&self, [width, height]: [u32; 2]) -> Intrinsics {
        let [fx, fy] = self.focal_pixels;
        let middle = [width, height].map(|side| (f64::from(side) - 1.0) / 2.0);
        let [cx, cy] = self.centre_pixels.unwrap_or(middle);
        Intrinsics { width, height, fx, fy, cx, cy, distortion: Vec::new() }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(text: &str) -> Result<RigFile, String> {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("rig.toml");
        std::fs::write(&path, text).unwrap();
        RigFile::read(&path).map_err(|error| error.to_string())
    }

    #[test]
    fn an_empty_file_is_the_papers_rig() {
        let file = read("").unwrap();
        assert_eq!(file.plan_settings(), PlanSettings::default());
        let JointSpeed { speed, acceleration } = file.pace().speed;
        assert!((speed - JointSpeed::USUAL.speed).abs() < 1e-12);
        assert!((acceleration - JointSpeed::USUAL.acceleration).abs() < 1e-12);
        assert_eq!(file.development(), Development::default());
    }

    #[test]
    fn keys_that_are_none_are_refused_and_the_likely_one_is_told() {
        for (text, says) in [
            ("[motion]\nspeed-degree = 3", "did you mean `speed-degrees`?"),
            ("[session]\nsettle-trys = 3", "did you mean `settle-tries`?"),
            ("[controler]\n", "did you mean `controllers`?"),
            ("[photographs]\nfrom = \"foldr\"", "did you mean `folder`?"),
            (
                "[photographs]\nfrom = \"folder\"\nfolder = \"x\"\nsize = [4, 3]\npatience = 3",
                "did you mean `patience-seconds`?",
            ),
            (
                "[photographs]\nfrom = \"gige\"\nserial = \"21\"\nsize = [4, 3]\nexposure-microsecond = 9",
                "did you mean `exposure-microseconds`?",
            ),
            ("[arms.camera]\nmodel = \"ur5\"\nbase-metres = [0, 0, 0]", "did you mean `ur5e`?"),
        ] {
            let error = read(text).unwrap_err();
            assert!(error.contains(says) && error.contains("rig.toml"), "{error}");
        }
        assert!(!read("[motion]\nzzz = 3").unwrap_err().contains("did you mean"));
    }

    #[test]
    fn numbers_that_cannot_be_are_refused_by_name() {
        for (text, says) in [
            ("[motion]\nspeed-degrees = 61", "at most 60.2"),
            ("[motion]\nspeed-degrees = 0", "speed-degrees 0"),
            ("[motion]\nacceleration-degrees = nan", "acceleration-degrees"),
            ("[motion]\nsettle-seconds = -1", "settle-seconds -1"),
            ("[photographs]\nfrom = \"folder\"\nfolder = \"x\"\nsize = [0, 3]", "size [0, 3]"),
            ("[lens]\nfocal-pixels = [1, 0]", "focal-pixels"),
            (
                "[photographs]\nfrom = \"gige\"\nserial = \"21\"\nsize = [0, 3]\nexposure-microseconds = 9",
                "size [0, 3]",
            ),
            ("[session]\ndark-frames = 2\n[photographs]\nfrom = \"virtual\"", "raw = true"),
            ("[development]\nwhite-balance = [1, 0, 1]", "white-balance"),
            ("[development]\nblack-level = 255", "black-level"),
            (
                "[board]\ncolumns = 2\nrows = 9\nsquare-metres = 0.03\nmarker-metres = 0.02\ndictionary = \"4X4_50\"",
                "[board] a board of 2x9 squares",
            ),
        ] {
            let error = read(text).unwrap_err();
            assert!(error.contains(says), "{error}");
        }
    }

    #[test]
    fn folders_are_beside_the_file() {
        let text = "[photographs]\nfrom = \"folder\"\nfolder = \"shots\"\nsize = [4, 3]";
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("rig.toml");
        std::fs::write(&path, text).unwrap();
        let Some(Photographs::Folder { folder: shots, .. }) = RigFile::read(&path).unwrap().photographs
        else {
            panic!("a folder was asked for");
        };
        assert_eq!(shots, folder.path().join("shots"));
    }
}
