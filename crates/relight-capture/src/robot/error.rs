//! Why an arm did not do what it was asked.

use super::arm::ArmStatus;

/// Why an arm did not do what it was asked. Each message begins with the address of the controller.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum ArmError {
    /// Nobody answers there.
    #[error(
        "{address}: cannot connect ({reason}); check that the controller is on and in the same network, and that this \
         port is open in its settings"
    )]
    Unreachable {
        /// Host and port.
        address: String,
        /// The system's word for it.
        reason: String,
    },
    /// The connection broke, or fell silent.
    #[error("{address}: the link is lost ({reason}); check cable and controller, then connect anew")]
    LinkLost {
        /// Host and port.
        address: String,
        /// What happened.
        reason: String,
    },
    /// Something did not come in time.
    #[error(
        "{address}: no {awaited} within {seconds:.1} s; look at the controller's screen for what it waits for"
    )]
    TimedOut {
        /// Host and port.
        address: String,
        /// What was waited for.
        awaited: &'static str,
        /// How long, seconds.
        seconds: f64,
    },
    /// The peer sent something that the protocol does not have.
    #[error("{address}: {fault}; check that this is the port of the controller's {protocol}")]
    Protocol {
        /// Host and port.
        address: String,
        /// The protocol that was spoken.
        protocol: &'static str,
        /// What was wrong with it.
        fault: String,
    },
    /// The controller understood and said no.
    #[error("{address}: refused {request}: {answer}")]
    Refused {
        /// Host and port.
        address: String,
        /// What was asked.
        request: String,
        /// What it said, and how to mend it where we know.
        answer: String,
    },
    /// The arm is not ready to move, or was stopped on the way.
    #[error("{address}: the arm is {status}")]
    Stopped {
        /// Host and port.
        address: String,
        /// What keeps it.
        status: ArmStatus,
    },
    /// The arm is not where the motion begins, so its path would not be the one that was checked.
    #[error(
        "{address}: joint {} is {difference:.4} rad from where the motion begins; plan a motion from where the arm is",
        joint + 1
    )]
    NotAtStart {
        /// Host and port.
        address: String,
        /// The joint that differs most, from 0.
        joint: usize,
        /// By how much, radians.
        difference: f64,
    },
    /// The arm came to rest short of the motion's end.
    #[error(
        "{address}: the arm rests with joint {} {difference:.4} rad from the motion's end; somebody stopped it, or a \
         limit of the controller's did",
        joint + 1
    )]
    NotAtEnd {
        /// Host and port.
        address: String,
        /// The joint that differs most, from 0.
        joint: usize,
        /// By how much, radians.
        difference: f64,
    },
    /// A motion failed, and stopping the arm failed or could not be seen.
    #[error("{cause}. It is not known whether the arm stands ({stop}): press the emergency stop")]
    NotStopped {
        /// Why the motion failed.
        cause: Box<ArmError>,
        /// Why the stop is not certain.
        stop: Box<ArmError>,
    },
}

impl ArmError {
    /// What went wrong first, whether or not stopping went wrong too.
    pub fn cause(&self) -> &ArmError {
        match self {
            Self::NotStopped { cause, .. } => cause.cause(),
            other => other,
        }
    }
}
