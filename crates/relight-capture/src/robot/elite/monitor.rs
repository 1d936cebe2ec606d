//! The binary monitor of Elite's EC controllers, port 8056 (Elite, "SDK-Socket Script Manual", version 3).
//!
//! One packet every 8 ms: its length (u32, itself included), then fields without padding, big-endian. New firmware appends
//! fields, so only the fields up to the robot's mode are asked for. Angles are in degrees, lengths in millimetres.

use super::super::arm::{ArmState, ArmStatus};
use super::super::ur::rtde::Reader;

/// Where the fields that we read begin, bytes.
const JOINTS: usize = 13;
const STATE: usize = 237;
const MODE: usize = 281;
/// The shortest packet with all of them, and a length that no firmware reaches.
const SHORTEST: usize = MODE + 4;
const LONGEST: usize = 1 << 14;

/// The length of the packet at the start of `bytes`, `None` if too few are there.
pub(super) fn packet_length(bytes: &[u8]) -> Result<Option<usize>, String> {
    let Some(length) = Reader(bytes).u32() else { return Ok(None) };
    let length = length as usize;
    if (SHORTEST..=LONGEST).contains(&length) {
        return Ok(Some(length));
    }
    Err(format!("a packet of {length} bytes; a monitor's has {SHORTEST} to {LONGEST}"))
}

/// The state in a packet, `None` where it is no state.
pub(in super::super) fn state(packet: &[u8]) -> Option<ArmState> {
    let joints = Reader(packet.get(JOINTS..)?).vector6()?.map(f64::to_radians);
    if !joints.iter().all(|q| q.is_finite()) {
        return None;
    }
    let mut reader = Reader(packet.get(STATE..)?);
    let (state, servo) = (reader.i32()?, reader.i32()?);
    let mode = Reader(packet.get(MODE..)?).i32()?;
    let status = match state {
        2 => ArmStatus::EmergencyStop,
        4 => ArmStatus::Fault("an alarm is raised; read it on the pendant and clear it"),
        5 => ArmStatus::ProtectiveStop,
        0 | 1 | 3 if mode != 2 => ArmStatus::NotInRemote,
        0 if servo == 0 => ArmStatus::Fault("its servos are off; switch them on at the pendant"),
        0 => ArmStatus::Idle,
        1 => ArmStatus::Paused,
        3 => ArmStatus::Running,
        _ => return None,
    };
    Some(ArmState { joints, status })
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::super::super::arm::largest_difference;
    use super::super::super::golden;
    use super::*;

    #[test]
    fn a_packet_is_read_as_elirobots_unpacks_it() {
        let packet = golden::elite_packet();
        assert_eq!(packet_length(&packet), Ok(Some(packet.len())));
        let read = state(&packet).unwrap();
        assert!(largest_difference(&read.joints, &golden::joints()).1 < 1e-12);
        assert_eq!(read.status, ArmStatus::Running);
    }

    #[test]
    fn states_mean_what_elite_says() {
        let with = |robot_state: i32, servo: i32, mode: i32| {
            let mut packet = golden::elite_packet();
            packet[STATE..STATE + 4].copy_from_slice(&robot_state.to_be_bytes());
            packet[STATE + 4..STATE + 8].copy_from_slice(&servo.to_be_bytes());
            packet[MODE..MODE + 4].copy_from_slice(&mode.to_be_bytes());
            state(&packet).map(|state| state.status)
        };
        assert_eq!(with(0, 1, 2), Some(ArmStatus::Idle));
        assert_eq!(with(1, 1, 2), Some(ArmStatus::Paused));
        assert_eq!(with(2, 0, 0), Some(ArmStatus::EmergencyStop));
        assert_eq!(with(3, 1, 2), Some(ArmStatus::Running));
        assert!(matches!(with(4, 1, 2), Some(ArmStatus::Fault(_))));
        assert_eq!(with(5, 1, 2), Some(ArmStatus::ProtectiveStop));
        assert_eq!(with(3, 1, 0), Some(ArmStatus::NotInRemote));
        assert!(matches!(with(0, 0, 2), Some(ArmStatus::Fault(_))));
        assert_eq!(with(6, 1, 2), None);
    }

    proptest! {
        #[test]
        fn no_bytes_make_it_panic(bytes in prop::collection::vec(any::<u8>(), 0..400)) {
            state(&bytes);
            if let Ok(Some(length)) = packet_length(&bytes) {
                prop_assert!((SHORTEST..=LONGEST).contains(&length));
            }
        }
    }
}
