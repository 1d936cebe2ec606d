//! The calibration's file.

use std::io::Write;
use std::path::{Path, PathBuf};

use relight_scene::{Intrinsics, Pose, PoseFault, read_text, write_whole};
use serde::{Deserialize, Serialize};

use super::board::Board;
use super::lens::LENS;
use super::light::LightRegistration;
use super::result::{Calibration, LeftOut, LensPhotograph, Waypoint};

/// The file's format and version.
pub const FORMAT: &str = "relight-calibration-2";
/// Longest file, bytes.
const LONGEST: u64 = 1 << 26;

/// Why a calibration could not be stored or read.
#[derive(Debug, thiserror::Error)]
pub enum StoreError {
    /// The file could not be read.
    #[error(transparent)]
    Read(#[from] relight_scene::SceneError),
    /// The file could not be written.
    #[error("{}: cannot be written: {error}", .path.display())]
    Write {
        /// The file.
        path: PathBuf,
        /// What the system says.
        error: std::io::Error,
    },
    /// The file is no JSON of a calibration.
    #[error("{}: no calibration: {error}; calibrate anew", .path.display())]
    Malformed {
        /// The file.
        path: PathBuf,
        /// Where it goes wrong.
        error: serde_json::Error,
    },
    /// The file is of another version.
    #[error("{}: the format is {found:?}, but this program knows {FORMAT:?} only; calibrate anew, or take the program that wrote it", .path.display())]
    Version {
        /// The file.
        path: PathBuf,
        /// What the file says it is.
        found: String,
    },
    /// A matrix of the file is no pose.
    #[error("{}: {what}: {fault}; calibrate anew", .path.display())]
    Pose {
        /// The file.
        path: PathBuf,
        /// Whose pose.
        what: String,
        /// What is wrong with it.
        fault: PoseFault,
    },
    /// A number of the lens cannot be.
    #[error("{}: the lens cannot be: {intrinsics:?}; calibrate anew", .path.display())]
    Lens {
        /// The file.
        path: PathBuf,
        /// The lens.
        intrinsics: Intrinsics,
    },
}

/// Only the format, so that another version is named before anything else is found missing.
#[derive(Deserialize)]
struct Head {
    format: String,
}

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct File {
    format: String,
    made: u64,
    board: Board,
    board_to_world: [f64; 16],
    lens: StoredLens,
    lens_shift: Option<f64>,
    lens_photographs: Vec<LensPhotograph>,
    rms_pixels: f64,
    waypoints: Vec<StoredWaypoint>,
    left_out: Vec<LeftOut>,
    light: Option<StoredLight>,
}

/// A lens, as files have it.
#[derive(PartialEq, Serialize, Deserialize)]
pub(crate) struct StoredIntrinsics {
    width: u32,
    height: u32,
    fx: f64,
    fy: f64,
    cx: f64,
    cy: f64,
    distortion: [f64; LENS - 4],
}

impl From<&Intrinsics> for StoredIntrinsics {
    fn from(intrinsics: &Intrinsics) -> Self {
        let Intrinsics { width, height, fx, fy, cx, cy, ref distortion } = *intrinsics;
        let coefficient = |i: usize| distortion.get(i).copied().unwrap_or(0.0);
        Self { width, height, fx, fy, cx, cy, distortion: std::array::from_fn(coefficient) }
    }
}

impl From<StoredIntrinsics> for Intrinsics {
    fn from(stored: StoredIntrinsics) -> Self {
        let StoredIntrinsics { width, height, fx, fy, cx, cy, distortion } = stored;
        Self { width, height, fx, fy, cx, cy, distortion: distortion.to_vec() }
    }
}

/// [`StoredIntrinsics`] and how well they are known. Flattened, it could not refuse unknown fields.
#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct StoredLens {
    width: u32,
    height: u32,
    fx: f64,
    fy: f64,
    cx: f64,
    cy: f64,
    distortion: [f64; LENS - 4],
    errors: [f64; LENS],
    information: [[f64; LENS]; LENS],
    corner_variance: f64,
}

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct StoredWaypoint {
    label: usize,
    camera_to_world: [f64; 16],
    corners: usize,
    rms_pixels: f64,
    worst_pixels: f64,
    rms_metres: f64,
    position_error: f64,
    rotation_error: f64,
    is_bad: bool,
}

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct StoredLight {
    base_to_world: [f64; 16],
    is_rotation_measured: bool,
    residuals: Vec<f64>,
    rms: f64,
}

/// Writes a calibration, whole or not at all; `made` is when it was made, in seconds since 1970.
///
/// # Errors
/// If the file cannot be written.
pub fn store(calibration: &Calibration, made: u64, path: &Path) -> Result<(), StoreError> {
    let waypoint = |w: &Waypoint| StoredWaypoint {
        label: w.label,
        camera_to_world: w.pose.to_matrix(),
        corners: w.corners,
        rms_pixels: w.rms_pixels,
        worst_pixels: w.worst_pixels,
        rms_metres: w.rms_metres,
        position_error: w.position_error,
        rotation_error: w.rotation_error,
        is_bad: w.is_bad,
    };
    let light = |l: &LightRegistration| StoredLight {
        base_to_world: l.base_to_world.to_matrix(),
        is_rotation_measured: l.is_rotation_measured,
        residuals: l.residuals.clone(),
        rms: l.rms,
    };
    let StoredIntrinsics { width, height, fx, fy, cx, cy, distortion } =
        StoredIntrinsics::from(&calibration.intrinsics);
    let file = File {
        format: FORMAT.to_owned(),
        made,
        board: calibration.board,
        board_to_world: calibration.board_to_world.to_matrix(),
        lens: StoredLens {
            width,
            height,
            fx,
            fy,
            cx,
            cy,
            distortion,
            errors: calibration.intrinsics_errors,
            information: calibration.lens_information,
            corner_variance: calibration.corner_variance,
        },
        lens_shift: calibration.lens_shift,
        lens_photographs: calibration.lens_photographs.clone(),
        rms_pixels: calibration.rms_pixels,
        waypoints: calibration.waypoints.iter().map(waypoint).collect(),
        left_out: calibration.left_out.clone(),
        light: calibration.light.as_ref().map(light),
    };
    let written = write_whole(path, |out| {
        serde_json::to_writer_pretty(&mut *out, &file)?;
        out.write_all(b"\n")
    });
    written.map_err(|error| StoreError::Write { path: path.to_owned(), error })
}

/// Reads a calibration, and when it was made, in seconds since 1970.
///
/// # Errors
/// If the file cannot be read, is of another version, or holds what cannot be.
pub fn load(path: &Path) -> Result<(Calibration, u64), StoreError> {
    let text = read_text(path, LONGEST)?;
    let malformed = |error| StoreError::Malformed { path: path.to_owned(), error };
    let Head { format } = serde_json::from_str(&text).map_err(malformed)?;
    if format != FORMAT {
        return Err(StoreError::Version { path: path.to_owned(), found: format });
    }
    let file: File = serde_json::from_str(&text).map_err(malformed)?;
    let pose = |what: &dyn Fn() -> String, numbers: &[f64; 16]| {
        Pose::from_matrix(numbers).map_err(|fault| StoreError::Pose {
            path: path.to_owned(),
            what: what(),
            fault,
        })
    };
    let StoredLens { width, height, fx, fy, cx, cy, distortion, errors, information, corner_variance } =
        file.lens;
    let intrinsics = StoredIntrinsics { width, height, fx, fy, cx, cy, distortion };
    let intrinsics = Intrinsics::from(intrinsics);
    if intrinsics.width == 0 || intrinsics.height == 0 || intrinsics.fx <= 0.0 || intrinsics.fy <= 0.0 {
        return Err(StoreError::Lens { path: path.to_owned(), intrinsics });
    }
    let waypoint = |w: &StoredWaypoint| {
        Ok(Waypoint {
            label: w.label,
            pose: pose(&|| format!("waypoint {}", w.label), &w.camera_to_world)?,
            corners: w.corners,
            rms_pixels: w.rms_pixels,
            worst_pixels: w.worst_pixels,
            rms_metres: w.rms_metres,
            position_error: w.position_error,
            rotation_error: w.rotation_error,
            is_bad: w.is_bad,
        })
    };
    let light = |l: StoredLight| -> Result<LightRegistration, StoreError> {
        Ok(LightRegistration {
            base_to_world: pose(&|| "base_to_world of the light's arm".to_owned(), &l.base_to_world)?,
            is_rotation_measured: l.is_rotation_measured,
            residuals: l.residuals,
            rms: l.rms,
        })
    };
    let calibration = Calibration {
        board: file.board,
        board_to_world: pose(&|| "board_to_world".to_owned(), &file.board_to_world)?,
        intrinsics,
        intrinsics_errors: errors,
        lens_information: information,
        corner_variance,
        lens_shift: file.lens_shift,
        lens_photographs: file.lens_photographs,
        rms_pixels: file.rms_pixels,
        waypoints: file.waypoints.iter().map(waypoint).collect::<Result<_, StoreError>>()?,
        left_out: file.left_out,
        light: file.light.map(light).transpose()?,
    };
    Ok((calibration, file.made))
}
