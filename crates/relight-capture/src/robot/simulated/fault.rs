//! What goes wrong on demand.

use std::fmt;
use std::str::FromStr;

/// A kind of fault of a simulated controller.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FaultKind {
    /// Half-way through a motion the arm goes into protective stop (UR) or reports a collision (EC).
    ProtectiveStop,
    /// Half-way through a motion the emergency stop is pressed, and stays so.
    EmergencyStop,
    /// Half-way through a motion the controller fails: a fault of the safety system (UR), an alarm (EC).
    Error,
    /// Half-way through a motion somebody takes the arm out of remote control, which stops it.
    LeaveRemote,
    /// After so many messages every connection is cut, and no new one accepted for long.
    LinkLoss,
    /// After so many messages each one comes seconds late.
    SlowReplies,
    /// After so many messages one is replaced by bytes without sense.
    Garbage,
}

impl FaultKind {
    const NAMES: [(FaultKind, &'static str); 7] = [
        (Self::ProtectiveStop, "protective-stop"),
        (Self::EmergencyStop, "emergency-stop"),
        (Self::Error, "error"),
        (Self::LeaveRemote, "leave-remote"),
        (Self::LinkLoss, "link-loss"),
        (Self::SlowReplies, "slow-replies"),
        (Self::Garbage, "garbage"),
    ];

    /// Whether its count is one of messages, and not of motions.
    pub(super) fn counts_messages(self) -> bool {
        matches!(self, Self::LinkLoss | Self::SlowReplies | Self::Garbage)
    }
}

/// A fault and when it comes: half-way through the motion numbered `at` (from 1), or after `at` messages that the
/// controller sent on all its connections.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Fault {
    /// What goes wrong.
    pub kind: FaultKind,
    /// When.
    pub at: u64,
}

/// Why words name no fault.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{0:?} is no fault; write KIND or KIND@N, with one of the kinds {names} and N from 1", names = names())]
pub struct FaultFault(String);

fn names() -> String {
    FaultKind::NAMES.map(|(_, name)| name).join(", ")
}

impl FromStr for Fault {
    type Err = FaultFault;

    /// `KIND` or `KIND@N`; without N, the first motion or 200 messages.
    fn from_str(words: &str) -> Result<Fault, FaultFault> {
        let fault = || FaultFault(words.to_owned());
        let (name, at) = match words.split_once('@') {
            Some((name, at)) => (name, Some(at.parse().ok().filter(|at| *at > 0).ok_or_else(fault)?)),
            None => (words, None),
        };
        let (kind, _) = FaultKind::NAMES.into_iter().find(|(_, known)| *known == name).ok_or_else(fault)?;
        Ok(Fault { kind, at: at.unwrap_or(if kind.counts_messages() { 200 } else { 1 }) })
    }
}

impl fmt::Display for Fault {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let name =
            FaultKind::NAMES.into_iter().find(|(kind, _)| *kind == self.kind).map_or("", |(_, name)| name);
        write!(f, "{name}@{}", self.at)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn faults_are_written_as_they_are_read() {
        for (kind, name) in FaultKind::NAMES {
            let fault: Fault = format!("{name}@7").parse().unwrap();
            assert_eq!(fault, Fault { kind, at: 7 });
            assert_eq!(fault.to_string().parse(), Ok(fault));
        }
        assert_eq!("protective-stop".parse(), Ok(Fault { kind: FaultKind::ProtectiveStop, at: 1 }));
        for bad in ["", "fire", "error@", "error@0", "error@-1", "error@1@2", "@3"] {
            let fault = bad.parse::<Fault>().unwrap_err();
            assert!(fault.to_string().contains("link-loss"), "{fault}");
        }
    }
}
