//! A session of board photographs on the virtual rig, as a real rig would have made it, and the truth behind it.
//!
//! The simulated arms of a capture go to the waypoints, by the drivers of real ones, and come to rest beside them as real
//! ones do. Photographs for the lens are taken by hand: nobody needs to know from where.

use std::fs;
use std::io::Write;
use std::ops::ControlFlow;
use std::path::{Path, PathBuf};
use std::time::Duration;

use glam::DVec3;
use relight_scene::{Camera, Intrinsics, Light, write_whole};

use super::board_truth::{TRUTH, Truth};
use super::virtual_capture::LENS;
use super::{CaptureRig, Lamp, RigError, Sensor, Settings, Stage, VirtualEye, VirtualRig, charuco_board};
use crate::calibration::{
    BOARD, Board, BoardFile, LENS_VIEWS, ShootError, VIEWS, photograph_name, shoot_board,
};
use crate::camera::Development;
use crate::kinematics::{ArmsSettings, Unreachable};
use crate::rig::{ArmsFault, ArmsRig, CAMERA, LIGHT, Pace, Prepared, SetupError, SimulatedArms};
use crate::robot::JointSpeed;
use crate::trajectory::PlanSettings;

/// Most touches of the board: its four corners and the middles of its sides.
pub const MOST_TOUCHES: usize = 8;

/// How far the floor lies below the board's face, metres: the board has a thickness.
const THICKNESS: f64 = 0.004;
/// Nothing swings on where nothing is.
const PACE: Pace = Pace { speed: JointSpeed::USUAL, settle: Duration::ZERO };

/// What is photographed, and how finely. All numbers together make the session what it is: equal ones, equal bytes.
#[derive(Clone, Debug, PartialEq)]
pub struct BoardCapture {
    /// The board; it lies in the middle of the world.
    pub board: Board,
    /// Where camera and light go.
    pub plan: PlanSettings,
    /// The arms that bring them there.
    pub arms: ArmsSettings,
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
    /// The arms cannot be set up.
    #[error(transparent)]
    Setup(#[from] SetupError),
    /// The arms did not come home.
    #[error(transparent)]
    Arms(#[from] ArmsFault),
    /// A photograph could not be taken.
    #[error(transparent)]
    Shoot(#[from] ShootError),
    /// More touches than the board has points.
    #[error("{0} touches: the virtual arm touches {MOST_TOUCHES} points of the board at most")]
    Touches(usize),
    /// A point of the board is out of the light arm's reach.
    #[error(
        "the light arm does not reach the board at {at:?} m to touch it: {fault}. Take a smaller board, or fewer touches."
    )]
    OutOfReach {
        /// The point, in the board's frame, metres.
        at: [f64; 3],
        /// Why.
        fault: Unreachable,
    },
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
        let prepared = Prepared::new(&self.plan, &self.arms)?;
        prepared.left_out().iter().for_each(|line| tracing::warn!("{line}"));
        let simulated = SimulatedArms::start(&prepared.itinerary, &self.arms, self.seed)?;
        let truth = Truth::new(self, &prepared, &simulated)?;
        let truth_text = truth.to_json(self, &prepared);
        self.write_files(out, resume, &truth, truth_text)?;
        let labels = [prepared.labels[CAMERA].clone(), vec![prepared.labels[LIGHT][truth.lamp]]];
        let total = labels[CAMERA].len() + self.lens_views;
        let in_folder = |folder: &str, label: usize| out.join(folder).join(photograph_name(label));
        let views = labels[CAMERA].iter().enumerate();
        let views: Vec<_> = views.map(|(number, &label)| (number, in_folder(VIEWS, label))).collect();
        let arms = simulated.connect(&prepared.itinerary, &self.arms)?;
        let eye = Box::new(self.eye(&truth)?);
        let mut rig = ArmsRig::new(&prepared.itinerary, labels, arms, eye, PACE)?;
        if !shoot_board(&mut rig, &views, &Development::default(), &mut |done| progress(done, total))? {
            return Ok(false);
        }
        rig.park()?;
        let lens: Vec<_> =
            (0..self.lens_views).map(|i| (i, in_folder(LENS_VIEWS, views.len() + i))).collect();
        let told = &mut |done| progress(views.len() + done, total);
        Ok(shoot_board(&mut self.by_hand(&truth)?, &lens, &Development::default(), told)?)
    }

    pub(super) fn intrinsics(&self) -> Intrinsics {
        Intrinsics { distortion: self.distortion.to_vec(), ..LENS.resized(self.width, self.height) }
    }

    /// The board on the stage.
    fn tracer(&self) -> Result<VirtualRig, RigError> {
        let mut stage = Stage::default().model()?;
        for part in &mut stage.parts {
            part.mesh = std::mem::take(&mut part.mesh).at(DVec3::NEG_Z * THICKNESS);
        }
        let model = charuco_board(&self.board, &self.board.lying_flat())?.with(stage);
        let settings = Settings { samples: self.samples, seed: self.seed, ..Settings::default() };
        VirtualRig::new(&model, Lamp::default(), Sensor::default(), settings)
    }

    /// The camera on its arm.
    fn eye(&self, truth: &Truth) -> Result<VirtualEye, RigError> {
        let foreseen = [truth.rests[CAMERA].clone(), vec![truth.rests[LIGHT][truth.lamp]]];
        Ok(VirtualEye::new(self.tracer()?, self.intrinsics(), truth.arms.clone(), foreseen))
    }

    /// The camera in somebody's hand.
    fn by_hand(&self, truth: &Truth) -> Result<CaptureRig, RigError> {
        let intrinsics = self.intrinsics();
        // Numbers that no waypoint has: their noise is another.
        let cameras = (truth.rests[CAMERA].len()..).zip(&truth.lens_cameras);
        let cameras = cameras.map(|(label, &pose)| Camera { label, intrinsics: intrinsics.clone(), pose });
        let lamp = Light { label: 0, pose: truth.lamp_pose() };
        Ok(CaptureRig::new(self.tracer()?, cameras.collect(), vec![lamp]))
    }

    /// Writes all but the photographs, or looks whether it is there.
    fn write_files(
        &self,
        out: &Path,
        resume: bool,
        truth: &Truth,
        truth_text: serde_json::Result<String>,
    ) -> Result<(), BoardCaptureError> {
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
        let file = BoardFile {
            board: self.board,
            board_to_world: None,
            light_base_to_world: (1..3).contains(&self.touches).then_some(truth.arms[LIGHT].base),
            touches: truth.touches.clone(),
        };
        let [board, true_file] = [BOARD, TRUTH].map(|name| out.join(name));
        let board_text =
            file.to_toml().map_err(|error| io(&board, std::io::Error::other(error.to_string())))?;
        let truth_text = truth_text.map_err(|error| io(&true_file, error.into()))?;
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
