//! Why a rig cannot be set up, or its arms did not go where they were to.

use std::path::PathBuf;

use relight_scene::SceneError;

use crate::kinematics::{CellError, Joints, RouteError};
use crate::robot::{AddressFault, ArmError, PlanFault, simulated::ListenFault};
use crate::trajectory::PlanError;

/// Why arms did not go where they were to. Both were told to stop.
#[derive(Debug, thiserror::Error)]
pub enum ArmsFault {
    /// An arm cannot be asked, is not ready, or did not arrive.
    #[error("the {arm}: {fault}")]
    Arm {
        /// Its name.
        arm: String,
        /// What happened.
        #[source]
        fault: ArmError,
    },
    /// After a fault, an arm could not be told to stop.
    #[error("{fault}. Nor could the {arm} be told to stop ({stop}): press the emergency stop")]
    NotStopped {
        /// What happened first.
        fault: Box<ArmsFault>,
        /// The arm that may still move.
        arm: String,
        /// Why it could not be told.
        stop: ArmError,
    },
    /// An arm stands where no motion of the plan leads.
    #[error(
        "the {arm} stands at joints {} degrees, which no planned motion passes while the other arm stands as it does. Bring both arms \
         home by hand, then go on: the {arm} to {} degrees",
        degrees(joints),
        degrees(home)
    )]
    Astray {
        /// Its name.
        arm: String,
        /// Where it stands, radians.
        joints: Joints,
        /// Where it would be at home, radians.
        home: Joints,
    },
    /// An arm that had arrived is no longer where it was.
    #[error(
        "the {arm} has moved since it arrived: joint {} is {off:.4} rad away. Find what moved it, then go on (--resume)",
        joint + 1
    )]
    Moved {
        /// Its name.
        arm: String,
        /// The joint that is farthest off, from 0.
        joint: usize,
        /// By how much, radians.
        off: f64,
    },
    /// Whoever runs the session wants the arms to stop.
    #[error("the arms were told to stop; look that nothing is in their way, then go on (--resume)")]
    Interrupted,
    /// The plan has no motions there.
    #[error("no planned motion leads the {arm} to its waypoint {label}: it is none that the plan visits")]
    NoWay {
        /// Its name.
        arm: String,
        /// The waypoint.
        label: usize,
    },
    /// A motion was refused when it was looked at once more.
    #[error("the {arm}: {fault}")]
    Refused {
        /// Its name.
        arm: String,
        /// Why.
        #[source]
        fault: PlanFault,
    },
}

/// Why a rig cannot be set up.
#[derive(Debug, thiserror::Error)]
pub enum SetupError {
    /// The rig file cannot be read.
    #[error(transparent)]
    Read(#[from] SceneError),
    /// The rig file is none.
    #[error("{}: {problem}", path.display())]
    File {
        /// The file.
        path: PathBuf,
        /// What is wrong and how to mend it.
        problem: String,
    },
    /// The waypoints cannot be.
    #[error(transparent)]
    Plan(#[from] PlanError),
    /// The arms' cell cannot be.
    #[error("[arms] {0}")]
    Cell(#[from] CellError),
    /// The arms cannot stand at home.
    #[error("[arms] {0}; name another place to wait at (home-degrees)")]
    Home(#[from] RouteError),
    /// Nothing is left to shoot.
    #[error("no {0} is reached by the arms; `relight capture plan` says why, waypoint by waypoint")]
    Nothing(&'static str),
    /// The stored calibration is of something else.
    #[error(
        "the calibration is not of this plan: {0}. Calibrate this rig, or name the calibration that belongs to it"
    )]
    Calibration(String),
    /// An address is none.
    #[error("[controllers] {0}")]
    Address(#[from] AddressFault),
    /// A controller does not answer, or not as it should.
    #[error("the {arm}: {fault}")]
    Connect {
        /// The arm's name.
        arm: String,
        /// What happened.
        #[source]
        fault: ArmError,
    },
    /// A simulated controller cannot listen.
    #[error(transparent)]
    Listen(#[from] ListenFault),
    /// The arms cannot begin.
    #[error(transparent)]
    Arms(#[from] ArmsFault),
}

fn degrees(joints: &Joints) -> String {
    format!("[{}]", joints.map(|q| format!("{:.2}", q.to_degrees())).join(", "))
}
