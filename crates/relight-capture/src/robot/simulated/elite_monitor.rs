//! The monitor of a simulated Elite EC controller: a packet of 1024 bytes every 8 ms, big-endian without padding.

use std::io;
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};

use super::arm::{Health, Snapshot};
use super::elite::{eight_degrees, robot_mode, robot_state};
use super::model::roll_pitch_yaw;
use super::server::Wire;

const PERIOD: Duration = Duration::from_millis(8);
/// Bytes of a packet of firmware 3: the fields that we fill, then others and a reserve.
const LENGTH: usize = 1024;

pub(super) fn serve(wire: &mut Wire) -> io::Result<()> {
    let mut due = Instant::now();
    loop {
        // Nothing is expected, but a closed connection must be noticed.
        wire.receive(due.saturating_duration_since(Instant::now()))?;
        wire.take(|bytes| Ok(Some(bytes.len())))?;
        let now = Instant::now();
        if now < due {
            continue;
        }
        due = if due + Duration::from_millis(200) < now { now } else { due + PERIOD };
        let snapshot = wire.arm().snapshot();
        let time = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default();
        wire.send(&packet(&snapshot, time.as_millis() as u64))?;
    }
}

/// The packet of one moment, `time` in ms since 1970.
pub(super) fn packet(now: &Snapshot, time: u64) -> Vec<u8> {
    let mut packet = Vec::with_capacity(LENGTH);
    let pose = roll_pitch_yaw(&now.model.flange(&now.joints));
    let mut put = |bytes: &[u8]| packet.extend_from_slice(bytes);
    let doubles = |values: &[f64]| values.iter().flat_map(|v| v.to_be_bytes()).collect::<Vec<_>>();
    put(&(LENGTH as u32).to_be_bytes());
    put(&time.to_be_bytes());
    // Cycle mode: single step.
    put(&[0]);
    put(&doubles(&eight_degrees(&now.joints)));
    // Pose of the tool in the base's frame and in the user's, which are the same.
    put(&doubles(&pose));
    put(&doubles(&pose));
    // Torques.
    put(&doubles(&[0.0; 8]));
    put(&robot_state(now).to_be_bytes());
    // Servos ready, motors in step, speeds of the motors.
    put(&1i32.to_be_bytes());
    put(&1i32.to_be_bytes());
    put(&[0; 32]);
    put(&robot_mode(now).to_be_bytes());
    // Analog inputs and outputs, digital inputs and outputs.
    put(&doubles(&[0.0; 8]));
    put(&[0; 16]);
    put(&[u8::from(now.health == Health::ProtectiveStop)]);
    // Pose of the flange in both frames.
    put(&doubles(&pose));
    put(&doubles(&pose));
    put(&[u8::from(now.health == Health::EmergencyStop)]);
    // Speed of the tool, of the joints.
    put(&doubles(&[0.0]));
    put(&doubles(&eight_degrees(&now.speeds)));
    packet.resize(LENGTH, 0);
    packet
}
