//! What can end a session early.

use std::path::PathBuf;

use relight_scene::SceneError;

use super::reshoot::Reshoot;
use super::stillness::Change;
use crate::camera::CameraError;

/// Why a rig did not do what it was asked.
#[derive(Debug, thiserror::Error)]
pub enum RigFault {
    /// An arm did not arrive.
    #[error("an arm did not get there: {0}")]
    Motion(#[source] Box<dyn std::error::Error + Send + Sync>),
    /// The rig has no target.
    #[error("this rig has nothing dark, nothing even and no grey card to show. Ask for no frames of these.")]
    NoTarget,
    /// Somebody is to do something, and nobody is there.
    #[error(
        "somebody has to {0}, and nobody can be asked: standard input is no terminal. Begin the session in a terminal; such \
         frames come first and are kept, and then it goes on anywhere (--resume)."
    )]
    Nobody(String),
    /// There is no photograph.
    #[error(transparent)]
    Camera(#[from] CameraError),
}

/// Why a session ended early. All that was shot until then is kept, and a resumed session goes on from there.
#[derive(Debug, thiserror::Error)]
pub enum SessionError {
    /// There is a session already.
    #[error("{}: holds a session already. Go on with it (--resume), or name another folder.", .0.display())]
    Begun(PathBuf),
    /// Something else is there.
    #[error("{}: is not empty, and holds no session. Name another folder.", .0.display())]
    NotEmpty(PathBuf),
    /// The session that is there is another one.
    #[error("{}: {problem}", path.display())]
    Other {
        /// The file that says so.
        path: PathBuf,
        /// What differs, and what to do.
        problem: String,
    },
    /// The journal is damaged.
    #[error("{}: line {line} {problem}. Remove the line and all behind it: their frames are then shot again.", path.display())]
    Journal {
        /// The journal.
        path: PathBuf,
        /// The line, from 1.
        line: usize,
        /// What is wrong with it.
        problem: String,
    },
    /// The rig failed.
    #[error("view {view} under light {light}: {fault}")]
    Rig {
        /// The view that was being shot.
        view: usize,
        /// The light that shone.
        light: usize,
        /// What happened.
        #[source]
        fault: RigFault,
    },
    /// A frame stayed incomplete.
    #[error(
        "view {view} under light {light}: {tries} tries, each time {last}. Check cable, bandwidth and packet size of the camera."
    )]
    Tries {
        /// The view.
        view: usize,
        /// The light.
        light: usize,
        /// How often it was tried.
        tries: u32,
        /// What the last try said.
        last: CameraError,
    },
    /// Photographs did not agree with each other.
    #[error(
        "view {view} under light {light}: not at rest after {tries} tries: {change}. Wait longer, look for what shakes or shines \
         (draught, daylight), or allow more tries (settle-tries)."
    )]
    Unsettled {
        /// The view.
        view: usize,
        /// The light.
        light: usize,
        /// How often it was tried.
        tries: u32,
        /// How the last two photographs differ.
        change: Change,
    },
    /// Something moved, and the session is to end then.
    #[error(
        "view {0}: something moved while it was shot. Look after object, camera and tripods, then shoot the view again: --resume \
         --reshoot moved"
    )]
    Moved(usize),
    /// There is no session whose photographs could be taken again.
    #[error("{}: holds no session, so that nothing can be shot again. Name the folder of one, or begin it without --reshoot.", .0.display())]
    NothingToReshoot(PathBuf),
    /// A photograph that was never taken cannot be taken again.
    #[error("{}: {which} was not shot yet, and need not be asked for: --resume alone shoots what is missing.", out.display())]
    NeverShot {
        /// The session's folder.
        out: PathBuf,
        /// What was asked for.
        which: Reshoot,
    },
    /// Dark or flat frames cannot be had or do not fit.
    #[error("{target} frames: {fault}")]
    Reference {
        /// Which.
        target: &'static str,
        /// What happened.
        #[source]
        fault: RigFault,
    },
    /// The grey card tells nothing of the lamp.
    #[error(
        "the grey card under light {light}: {problem}. Lay it where the first view sees it (card-metres), in the scene\'s place and \
         larger than 20 mm, and expose so that it is neither black nor full."
    )]
    Card {
        /// The light.
        light: usize,
        /// What is wrong.
        problem: &'static str,
    },
    /// What is asked for around each photograph cannot be.
    #[error("the session's settings: {0}")]
    Care(String),
    /// A file of the scene cannot be read or written.
    #[error(transparent)]
    Scene(#[from] SceneError),
    /// A file of the session cannot be read or written.
    #[error("{}: {error}", path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// What happened.
        error: std::io::Error,
    },
}

impl SessionError {
    /// An error of reading or writing `path`.
    pub(crate) fn io(path: impl Into<PathBuf>) -> impl FnOnce(std::io::Error) -> SessionError {
        let path = path.into();
        move |error| SessionError::Io { path, error }
    }
}
