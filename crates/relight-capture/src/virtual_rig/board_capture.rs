//! A session of board photographs on the virtual rig, as a real rig would have made it, and the truth behind it.

use std::fs;
use std::io::Write;
use std::ops::ControlFlow;
use std::path::{Path, PathBuf};

use glam::DVec3;
use nalgebra::{Rotation3, Vector3};
use relight_scene::{Camera, Intrinsics, Light, Pose, write_whole};
use serde::Serialize;

use super::random::{hash, normals};
use super::virtual_capture::{AZIMUTH_DEGREES, LENS};
use super::{CaptureRig, Lamp, RigError, Sensor, Settings, Stage, VirtualRig, charuco_board};
use crate::calibration::frames::compose;
use crate::calibration::{
    BOARD, Board, BoardFile, LENS_VIEWS, ShootError, Touch, VIEWS, lens_viewpoints, photograph_name,
    shoot_board,
};
use crate::camera::Development;
use crate::trajectory::{Plan, PlanError, PlanSettings};

/// The file of the truth, which only tests and curious people read.
pub const TRUTH: &str = "truth.json";
const FORMAT: &str = "relight-truth-1";
/// Most touches of the board: its four corners and the middles of its sides.
pub const MOST_TOUCHES: usize = 8;

/// Where an arm truly stands: this far from where it was told to, metres, root mean square of the distance (what makers of
/// both arms declare); and turned by what joints at the reach of the domes turn then, radians.
const REPEATABILITY: f64 = 0.03e-3;
const TURN: f64 = 8e-5;
/// How far the floor lies below the board's face, metres: the board has a thickness.
const THICKNESS: f64 = 0.004;
/// Distance of the photographs for the lens, metres.
const DISTANCE: f64 = 0.6;
/// Where the light's arm truly stands: some millimetres from where [`VirtualCapture::arms`](super::VirtualCapture::arms) has it,
/// and a little askew.
const LIGHT_BASE_TURN: [f64; 3] = [0.004, -0.003, 2.364];
const LIGHT_BASE: [f64; 3] = [-0.338, 0.342, 0.029];

/// What is photographed, and how finely. All numbers together make the session what it is: equal ones, equal bytes.
#[derive(Clone, Debug, PartialEq)]
pub struct BoardCapture {
    /// The board; it lies in the middle of the world.
    pub board: Board,
    /// Camera waypoints.
    pub views: usize,
    /// Photographs for the lens alone, with the camera rolled and the board tilted in all directions.
    pub lens_views: usize,
    /// How often the light's arm touches the board, up to [`MOST_TOUCHES`]; fewer than three with a declared alignment.
    pub touches: usize,
    /// Distortion `k1 k2 p1 p2 k3` of the lens.
    pub distortion: [f64; 5],
    /// Pixels a row.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// Camera rays a pixel.
    pub samples: u32,
    /// Seed of the arms' and the sensor's noise.
    pub seed: u64,
}

/// Why there is no session.
#[derive(Debug, thiserror::Error)]
pub enum BoardCaptureError {
    /// The rig cannot be.
    #[error(transparent)]
    Rig(#[from] RigError),
    /// The waypoints cannot be.
    #[error(transparent)]
    Plan(#[from] PlanError),
    /// A photograph could not be taken.
    #[error(transparent)]
    Shoot(#[from] ShootError),
    /// More touches than the board has points.
    #[error("{0} touches: the virtual arm touches {MOST_TOUCHES} points of the board at most")]
    Touches(usize),
    /// Something is there already.
    #[error("{}: is not empty. Name another folder, or go on with the session (--resume).", .0.display())]
    NotEmpty(PathBuf),
    /// The session that is there is another one.
    #[error("{}: is not what this session writes: it was begun with other settings. Name another folder.", .0.display())]
    Other(PathBuf),
    /// A file cannot be read or written.
    #[error("{}: {error}", .path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// What the system says.
        error: std::io::Error,
    },
}

/// The file of the truth.
#[derive(Serialize)]
struct Truth {
    format: &'static str,
    samples: u32,
    seed: u64,
    lens: TrueLens,
    cameras: Vec<TruePose>,
    lens_cameras: Vec<TruePose>,
    light_base_to_world: [f64; 16],
    lights: Vec<TrueLight>,
}

#[derive(Serialize)]
struct TrueLens {
    width: u32,
    height: u32,
    fx: f64,
    fy: f64,
    cx: f64,
    cy: f64,
    distortion: [f64; 5],
}

#[derive(Serialize)]
struct TruePose {
    label: usize,
    planned: [f64; 16],
    to_world: [f64; 16],
}

/// A light that its arm was told to bring to a pose of its own frame.
#[derive(Serialize)]
struct TrueLight {
    label: usize,
    told_in_base: [f64; 16],
    to_world: [f64; 16],
}

impl BoardCapture {
    /// Photographs the board from all camera waypoints and for the lens, touches it, and writes the session's folder. Whether
    /// all photographs are there at the end is the answer.
    ///
    /// # Errors
    /// [`BoardCaptureError`]; what is shot by then is kept.
    pub fn shoot(
        &self,
        out: &Path,
        resume: bool,
        progress: &mut dyn FnMut(usize, usize) -> ControlFlow<()>,
    ) -> Result<bool, BoardCaptureError> {
        if self.touches > MOST_TOUCHES {
            return Err(BoardCaptureError::Touches(self.touches));
        }
        let plan = self.plan()?;
        let truth = self.truth(&plan);
        let mut rig = self.rig(&truth, &plan)?;
        self.write_files(out, resume, &truth)?;
        let in_folder = |folder: &str, label: usize| out.join(folder).join(photograph_name(label));
        let waypoints = (0..self.views).map(|i| (i, in_folder(VIEWS, i)));
        let lens = (0..self.lens_views).map(|i| (self.views + i, in_folder(LENS_VIEWS, i)));
        let shots: Vec<_> = waypoints.chain(lens).collect();
        let total = shots.len();
        let told = &mut |done| progress(done, total);
        Ok(shoot_board(&mut rig, &shots, &Development::default(), told)?)
    }

    fn intrinsics(&self) -> Intrinsics {
        Intrinsics { distortion: self.distortion.to_vec(), ..LENS.resized(self.width, self.height) }
    }

    /// The domes of [`VirtualCapture`](super::VirtualCapture).
    fn plan(&self) -> Result<Plan, PlanError> {
        let mut settings = PlanSettings::default();
        settings.camera.waypoints = self.views;
        settings.camera.azimuth_degrees = AZIMUTH_DEGREES;
        Plan::new(&settings)
    }

    fn truth(&self, plan: &Plan) -> Truth {
        let missed = |arm: u64, label: usize, planned: &Pose| TruePose {
            label,
            planned: planned.to_matrix(),
            to_world: self.reached(arm, label, planned).to_matrix(),
        };
        let base = moved(Pose::IDENTITY, LIGHT_BASE_TURN, LIGHT_BASE);
        let light = |label: usize, planned: &Pose| TrueLight {
            label,
            told_in_base: compose(&base.inverse(), planned).to_matrix(),
            to_world: self.reached(2, label, planned).to_matrix(),
        };
        let lens_cameras = (0..).zip(lens_viewpoints(self.lens_views, DISTANCE));
        let Intrinsics { width, height, fx, fy, cx, cy, .. } = self.intrinsics();
        Truth {
            format: FORMAT,
            samples: self.samples,
            seed: self.seed,
            lens: TrueLens { width, height, fx, fy, cx, cy, distortion: self.distortion },
            cameras: plan.camera.waypoints.iter().map(|w| missed(0, w.label, &w.pose)).collect(),
            lens_cameras: lens_cameras.map(|(i, pose)| missed(1, i, &pose)).collect(),
            light_base_to_world: base.to_matrix(),
            lights: plan.light.waypoints.iter().map(|w| light(w.label, &w.pose)).collect(),
        }
    }

    /// Where an arm comes to rest that was told to bring its tool to a pose.
    fn reached(&self, arm: u64, label: usize, told: &Pose) -> Pose {
        let [by, turn] = [0, 1].map(|kind| self.noise(&[arm, label as u64, kind]));
        moved(*told, turn.map(|v| v * TURN), by.map(|v| v * REPEATABILITY))
    }

    /// A vector of unit mean square length.
    fn noise(&self, name: &[u64]) -> [f64; 3] {
        let key = hash(&[0x41_52_4D, self.seed, hash(name)]);
        let ([a, b], [c, _]) = (normals(hash(&[key, 0])), normals(hash(&[key, 1])));
        [a, b, c].map(|v| v / 3f64.sqrt())
    }

    fn rig(&self, truth: &Truth, plan: &Plan) -> Result<CaptureRig, RigError> {
        let mut stage = Stage::default().model()?;
        for part in &mut stage.parts {
            part.mesh = std::mem::take(&mut part.mesh).at(DVec3::NEG_Z * THICKNESS);
        }
        let model = charuco_board(&self.board, &self.board.lying_flat())?.with(stage);
        let settings = Settings { samples: self.samples, seed: self.seed, ..Settings::default() };
        let rig = VirtualRig::new(&model, Lamp::default(), Sensor::default(), settings)?;
        let intrinsics = self.intrinsics();
        let cameras = truth.cameras.iter().chain(&truth.lens_cameras).enumerate();
        let cameras = cameras.map(|(label, camera)| Camera {
            label,
            intrinsics: intrinsics.clone(),
            pose: pose_of(&camera.to_world),
        });
        // The highest: least of the board is in glancing light.
        let highest = plan.light.waypoints.iter().max_by(|a, b| {
            let height = |pose: &Pose| pose.position()[2];
            height(&a.pose).total_cmp(&height(&b.pose))
        });
        let lights = highest.map(|waypoint| Light { label: 0, pose: waypoint.pose });
        Ok(CaptureRig::new(rig, cameras.collect(), lights.into_iter().collect()))
    }

    /// The arm's tip on points of the board, as far round as the board goes.
    fn touches(&self, base: &Pose) -> Vec<Touch> {
        let [w, h] = self.board.size();
        let places = [
            [0.0, 0.0],
            [w, h],
            [w, 0.0],
            [0.0, h],
            [w / 2.0, 0.0],
            [w / 2.0, h],
            [0.0, h / 2.0],
            [w, h / 2.0],
        ];
        let touch = |(i, &[x, y]): (usize, &[f64; 2])| {
            let on_board = [x, y, 0.0];
            let noise = self.noise(&[3, i as u64]).map(|v| v * REPEATABILITY);
            let at = self.board.lying_flat().transform(on_board);
            let tip = base.inverse_transform(std::array::from_fn(|k| at[k] + noise[k]));
            Touch { on_board, in_arm: tip }
        };
        places.iter().take(self.touches).enumerate().map(touch).collect()
    }

    /// Writes all but the photographs, or looks whether it is there.
    fn write_files(&self, out: &Path, resume: bool, truth: &Truth) -> Result<(), BoardCaptureError> {
        let io = |path: &Path, error| BoardCaptureError::Io { path: path.to_owned(), error };
        let is_empty = match fs::read_dir(out) {
            Ok(mut entries) => entries.next().is_none(),
            Err(error) if error.kind() == std::io::ErrorKind::NotFound => true,
            Err(error) => return Err(io(out, error)),
        };
        if !is_empty && !resume {
            return Err(BoardCaptureError::NotEmpty(out.to_owned()));
        }
        for folder in [VIEWS, LENS_VIEWS] {
            fs::create_dir_all(out.join(folder)).map_err(|error| io(out, error))?;
        }
        let base = pose_of(&truth.light_base_to_world);
        let file = BoardFile {
            board: self.board,
            board_to_world: None,
            light_base_to_world: (1..3).contains(&self.touches).then_some(base),
            touches: self.touches(&base),
        };
        let [board, true_file] = [BOARD, TRUTH].map(|name| out.join(name));
        let board_text =
            file.to_toml().map_err(|error| io(&board, std::io::Error::other(error.to_string())))?;
        let truth_text = serde_json::to_string_pretty(truth).map_err(|error| io(&true_file, error.into()))?;
        for (path, text) in [(board, board_text), (true_file, truth_text)] {
            match fs::read_to_string(&path) {
                Ok(there) if there == text => {}
                Ok(_) => return Err(BoardCaptureError::Other(path)),
                Err(error) if error.kind() == std::io::ErrorKind::NotFound => {
                    write_whole(&path, |file| file.write_all(text.as_bytes()))
                        .map_err(|error| io(&path, error))?;
                }
                Err(error) => return Err(io(&path, error)),
            }
        }
        Ok(())
    }
}

/// A pose turned by a rotation vector of the world, and moved.
fn moved(pose: Pose, turn: [f64; 3], by: [f64; 3]) -> Pose {
    let rotation = Rotation3::new(Vector3::from(turn));
    let column = |j: usize| rotation * Vector3::from(pose.0.map(|row| row[j]));
    let axes = [column(0), column(1), column(2)];
    Pose(std::array::from_fn(|i| [axes[0][i], axes[1][i], axes[2][i], pose.0[i][3] + by[i]]))
}

/// A pose that was one before.
fn pose_of(m: &[f64; 16]) -> Pose {
    Pose(std::array::from_fn(|i| std::array::from_fn(|j| m[4 * i + j])))
}
