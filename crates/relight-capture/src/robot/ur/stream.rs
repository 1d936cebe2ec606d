//! The states that a controller streams by RTDE.

use super::super::arm::{ArmState, ArmStatus};
use super::super::error::ArmError;
use super::super::feed::Feed;
use super::super::link::{Link, TimeLimits};
use super::rtde::{self, Reader, kind};

/// States per second: an answer to a stop within a cycle or two is fast enough for a capture.
const FREQUENCY: f64 = 125.0;
/// What we ask for, and the types that we must be promised.
const NAMES: &str = "timestamp,actual_q,robot_mode,safety_mode,runtime_state";
const TYPES: &str = "DOUBLE,VECTOR6D,INT32,INT32,UINT32";
/// Other frames (text messages) that may come before an answer.
const CHATTER: usize = 100;

/// Negotiates the protocol and the outputs, and starts the stream.
pub(super) fn open(address: &str, limits: TimeLimits) -> Result<Feed, ArmError> {
    let mut link = Link::connect(address, "real-time data exchange (RTDE)", &limits)?;
    let refused = |request: &str, answer: String| ArmError::Refused {
        address: address.to_owned(),
        request: request.to_owned(),
        answer,
    };
    if ask(&mut link, kind::VERSION, &2u16.to_be_bytes(), limits)? != [1] {
        return Err(refused("RTDE version 2", "update the controller".to_owned()));
    }
    let answer = ask(&mut link, kind::OUTPUTS, &outputs(), limits)?;
    let Some((&recipe, types)) = answer.split_first() else {
        return Err(link.fault("an empty answer to a request for outputs".to_owned()));
    };
    if types != TYPES.as_bytes() {
        let types: String = String::from_utf8_lossy(types).chars().take(80).collect();
        return Err(refused(
            &format!("outputs {NAMES}"),
            format!("{types:?} instead of {TYPES}; update the controller"),
        ));
    }
    if ask(&mut link, kind::START, &[], limits)? != [1] {
        return Err(refused("to start the stream", "another client may hold it".to_owned()));
    }
    Feed::start(link, move |link| {
        loop {
            let frame = link.take("state", limits.silence, rtde::frame_length)?;
            if let Some((kind::DATA, payload)) = rtde::parts(&frame) {
                return state(recipe, payload)
                    .ok_or_else(|| link.fault("a data frame that is not the one asked for".to_owned()));
            }
        }
    })
}

/// The payload that asks for our outputs.
fn outputs() -> Vec<u8> {
    [&FREQUENCY.to_be_bytes(), NAMES.as_bytes()].concat()
}

/// Sends a frame and waits for the answer, a frame of the same kind.
fn ask(link: &mut Link, kind: u8, payload: &[u8], limits: TimeLimits) -> Result<Vec<u8>, ArmError> {
    let frame = rtde::frame(kind, payload).ok_or_else(|| link.fault("a request too long".to_owned()))?;
    link.send(&frame)?;
    for _ in 0..CHATTER {
        let frame = link.take("answer", limits.reply, rtde::frame_length)?;
        if let Some((answered, payload)) = rtde::parts(&frame)
            && answered == kind
        {
            return Ok(payload.to_vec());
        }
    }
    Err(link.fault(format!("{CHATTER} frames, none of them the answer")))
}

/// The state in a data frame's payload.
fn state(recipe: u8, payload: &[u8]) -> Option<ArmState> {
    let mut reader = Reader(payload);
    if reader.u8()? != recipe {
        return None;
    }
    let timestamp = reader.f64()?;
    let joints = reader.vector6()?;
    let (robot_mode, safety_mode, runtime_state) = (reader.i32()?, reader.i32()?, reader.u32()?);
    let is_finite = timestamp.is_finite() && joints.iter().all(|q| q.is_finite());
    (is_finite && reader.0.is_empty())
        .then(|| ArmState { joints, status: status(robot_mode, safety_mode, runtime_state) })
}

/// Names as in UR's guide. Safety comes first: an arm in emergency stop has no running mode either.
fn status(robot_mode: i32, safety_mode: i32, runtime_state: u32) -> ArmStatus {
    match safety_mode {
        // Normal and reduced.
        1 | 2 => {}
        3 => return ArmStatus::ProtectiveStop,
        4 => return ArmStatus::Fault("in recovery mode; move it back inside its limits on the pendant"),
        5 => return ArmStatus::Fault("in safeguard stop; close the guard and reset"),
        6 | 7 => return ArmStatus::EmergencyStop,
        8 => return ArmStatus::Fault("a safety limit is violated; restart safety on the pendant"),
        9 => return ArmStatus::Fault("a fault of the safety system; restart safety on the pendant"),
        _ => return ArmStatus::Fault("the safety system is not in order; see the pendant"),
    }
    match robot_mode {
        7 => {}
        3 => return ArmStatus::Fault("powered off; power on and release the brakes"),
        5 => return ArmStatus::Fault("its brakes are on; release them"),
        6 => return ArmStatus::Fault("in free drive; let go of it"),
        _ => return ArmStatus::Fault("not in running mode; power on and release the brakes"),
    }
    match runtime_state {
        // Stopped; every other one but paused is on the way to or from playing.
        1 => ArmStatus::Idle,
        4 => ArmStatus::Paused,
        _ => ArmStatus::Running,
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::super::super::golden;
    use super::*;

    #[test]
    fn requests_are_those_of_urs_own_client() {
        let golden = golden::ur_requests();
        assert_eq!(rtde::frame(kind::VERSION, &2u16.to_be_bytes()).unwrap(), golden["V"]);
        assert_eq!(rtde::frame(kind::OUTPUTS, &outputs()).unwrap(), golden["O"]);
        assert_eq!(rtde::frame(kind::START, &[]).unwrap(), golden["S"]);
    }

    #[test]
    fn a_state_is_read_as_urs_own_client_packs_it() {
        let frame = golden::ur_state();
        assert_eq!(rtde::frame_length(&frame), Ok(Some(frame.len())));
        let (kind, payload) = rtde::parts(&frame).unwrap();
        assert_eq!(kind, kind::DATA);
        let expected = ArmState { joints: golden::joints(), status: ArmStatus::Running };
        assert_eq!(state(1, payload), Some(expected));
        // Another recipe, a byte too few or too many.
        assert_eq!(state(2, payload), None);
        assert_eq!(state(1, &payload[..payload.len() - 1]), None);
        assert_eq!(state(1, &[payload, &[0]].concat()), None);
    }

    #[test]
    fn safety_comes_before_modes() {
        assert_eq!(status(7, 1, 1), ArmStatus::Idle);
        assert_eq!(status(7, 2, 2), ArmStatus::Running);
        assert_eq!(status(7, 1, 4), ArmStatus::Paused);
        assert_eq!(status(7, 3, 2), ArmStatus::ProtectiveStop);
        assert_eq!(status(3, 7, 1), ArmStatus::EmergencyStop);
        assert_eq!(status(3, 6, 1), ArmStatus::EmergencyStop);
        for (robot, safety) in [(3, 1), (5, 1), (0, 1), (7, 9), (7, 5), (7, 0), (7, 99)] {
            assert!(matches!(status(robot, safety, 1), ArmStatus::Fault(_)), "{robot} {safety}");
        }
    }

    proptest! {
        #[test]
        fn no_bytes_make_it_panic(bytes in prop::collection::vec(any::<u8>(), 0..120), recipe: u8) {
            state(recipe, &bytes);
            if let Ok(Some(length)) = rtde::frame_length(&bytes) {
                prop_assert!((3..=usize::from(u16::MAX)).contains(&length));
            }
            rtde::parts(&bytes);
        }
    }
}
