//! The arms that are simulated.

use std::f64::consts::{FRAC_PI_2, PI, TAU};

use relight_scene::Pose;

use super::super::arm::Joints;
use crate::kinematics::{ArmModel, EC66, UR5E};

/// What a simulation needs to know of an arm.
#[derive(Debug)]
pub struct SimulatedModel {
    /// Where it stands when switched on, rad.
    pub home: Joints,
    /// The controller refuses targets beyond, rad, either way.
    pub reach: Joints,
    /// Full speed of a joint, rad/s.
    pub full_speed: f64,
    /// Acceleration where a client asks for none, rad/s^2.
    pub acceleration: f64,
    /// Its kinematics.
    pub arm: ArmModel,
}

impl SimulatedModel {
    /// Flange-to-base for joint angles in rad, metres.
    pub fn flange(&self, joints: &Joints) -> Pose {
        self.arm.forward(joints)
    }

    /// Universal Robots' UR5e.
    pub const UR5E: SimulatedModel = SimulatedModel {
        home: [0.0, -FRAC_PI_2, FRAC_PI_2, -FRAC_PI_2, -FRAC_PI_2, 0.0],
        reach: [TAU; 6],
        full_speed: PI,
        acceleration: 1.4,
        arm: UR5E,
    };

    /// Elite's EC66.
    pub const EC66: SimulatedModel = SimulatedModel {
        home: [0.0, -FRAC_PI_2, FRAC_PI_2, -FRAC_PI_2, FRAC_PI_2, 0.0],
        reach: [TAU, TAU, 160.0 * PI / 180.0, TAU, TAU, TAU],
        full_speed: PI,
        acceleration: 1.4,
        arm: EC66,
    };
}

/// A pose as position (m) and rotation vector (rad), as UR's controllers write it.
pub(super) fn rotation_vector(Pose(m): &Pose) -> [f64; 6] {
    let trace = m[0][0] + m[1][1] + m[2][2];
    let axis = [m[2][1] - m[1][2], m[0][2] - m[2][0], m[1][0] - m[0][1]];
    let twice_sine = axis.iter().map(|v| v * v).sum::<f64>().sqrt();
    let angle = twice_sine.atan2(trace - 1.0);
    let vector = if twice_sine > 1e-9 {
        axis.map(|v| v * angle / twice_sine)
    } else if trace > 1.0 {
        [0.0; 3]
    } else {
        // Half a turn: the axis is the longest column of (R + I) / 2, normalised.
        let column = |j: usize| {
            [m[0][j], m[1][j], m[2][j]]
                .iter()
                .enumerate()
                .map(|(i, v)| v + f64::from(i == j))
                .collect::<Vec<_>>()
        };
        let longest = (0..3).max_by(|a, b| m[*a][*a].total_cmp(&m[*b][*b])).unwrap_or(0);
        let column = column(longest);
        let norm = column.iter().map(|v| v * v).sum::<f64>().sqrt();
        [column[0], column[1], column[2]].map(|v| v * PI / norm)
    };
    [m[0][3], m[1][3], m[2][3], vector[0], vector[1], vector[2]]
}

/// A pose as position (mm) and roll, pitch, yaw (rad; R = Rz(yaw) Ry(pitch) Rx(roll)), as Elite's controllers write it.
pub(super) fn roll_pitch_yaw(Pose(m): &Pose) -> [f64; 6] {
    let roll = m[2][1].atan2(m[2][2]);
    let pitch = (-m[2][0]).atan2(m[2][1].hypot(m[2][2]));
    let yaw = m[1][0].atan2(m[0][0]);
    [1e3 * m[0][3], 1e3 * m[1][3], 1e3 * m[2][3], roll, pitch, yaw]
}

/// The pose of position (mm) and roll, pitch, yaw (rad).
pub(super) fn of_roll_pitch_yaw([x, y, z, roll, pitch, yaw]: [f64; 6]) -> Pose {
    let ((sr, cr), (sp, cp), (sy, cy)) = (roll.sin_cos(), pitch.sin_cos(), yaw.sin_cos());
    Pose([
        [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr, 1e-3 * x],
        [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr, 1e-3 * y],
        [-sp, cp * sr, cp * cr, 1e-3 * z],
    ])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rotation_vectors_turn_back_into_rotations() {
        // Places with small, large and half turns.
        for joints in [
            [0.3, -1.2, 1.4, -1.8, -1.6, 0.2],
            [0.0; 6],
            [2.0, -1.0, 0.5, 2.5, 0.1, -3.0],
            SimulatedModel::UR5E.home,
        ] {
            let pose = SimulatedModel::UR5E.flange(&joints);
            let [_, _, _, x, y, z] = rotation_vector(&pose);
            let angle = (x * x + y * y + z * z).sqrt();
            let (s, c) = angle.sin_cos();
            let [x, y, z] = [x / angle, y / angle, z / angle];
            let axis = [[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]];
            for (i, row) in pose.0.iter().enumerate() {
                for j in 0..3 {
                    let outer = [x, y, z][i] * [x, y, z][j];
                    let rodrigues = if i == j { c } else { 0.0 } + s * axis[i][j] + (1.0 - c) * outer;
                    assert!((row[j] - rodrigues).abs() < 1e-7, "{joints:?}");
                }
            }
        }
    }
}
