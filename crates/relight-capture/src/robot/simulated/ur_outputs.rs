//! The variables that a simulated UR controller streams and takes (UR, "Real-Time Data Exchange (RTDE) Guide").

use super::super::ur::rtde::Value;
use super::arm::{Health, Snapshot};
use super::model::rotation_vector;

/// Registers of each kind.
const INTEGERS: u32 = 48;
const BITS: std::ops::Range<u32> = 64..128;

/// The value of an output, `None` where there is none of that name.
pub(super) fn output(name: &str, arm: &Snapshot) -> Option<Value> {
    let pose = || rotation_vector(&arm.model.flange(&arm.joints));
    Some(match name {
        "timestamp" => Value::Double(arm.time),
        "target_q" | "actual_q" => Value::Vector6(arm.joints),
        "target_qd" | "actual_qd" => Value::Vector6(arm.speeds),
        "actual_TCP_pose" | "target_TCP_pose" => Value::Vector6(pose()),
        "actual_TCP_speed" | "target_TCP_speed" => Value::Vector6(flange_speed(arm)),
        "robot_mode" => Value::Int(7),
        "safety_mode" | "safety_status" => Value::Int(match arm.health {
            Health::Well => 1,
            Health::ProtectiveStop => 3,
            Health::EmergencyStop => 7,
            Health::Error => 9,
        }),
        "runtime_state" => Value::Uint(match (arm.is_running, arm.is_paused) {
            (true, _) => 2,
            (_, true) => 4,
            _ => 1,
        }),
        // Power is on; a program runs.
        "robot_status_bits" => Value::Uint(1 | u32::from(arm.is_running) << 1),
        "safety_status_bits" => Value::Uint(match arm.health {
            Health::Well => 1,
            Health::ProtectiveStop => 1 << 2 | 1 << 10,
            Health::EmergencyStop => 1 << 6 | 1 << 7 | 1 << 10,
            Health::Error => 1 << 9 | 1 << 10,
        }),
        "speed_scaling" | "target_speed_fraction" => Value::Double(1.0),
        "actual_main_voltage" | "actual_robot_voltage" => Value::Double(48.0),
        "actual_joint_voltage" => Value::Vector6([48.0; 6]),
        "joint_temperatures" => Value::Vector6([30.0; 6]),
        // 253: running.
        "joint_mode" => Value::Int6([253; 6]),
        _ => return at_rest(name).or_else(|| register(name, "output")),
    })
}

/// Variables that stay as they are in an arm that nothing is attached to.
fn at_rest(name: &str) -> Option<Value> {
    Some(match name {
        "target_qdd"
        | "target_current"
        | "target_moment"
        | "actual_current"
        | "actual_current_as_torque"
        | "actual_moment"
        | "joint_control_output"
        | "actual_TCP_force"
        | "ft_raw_wrench"
        | "payload_inertia" => Value::Vector6([0.0; 6]),
        "actual_tool_accelerometer" | "elbow_position" | "elbow_velocity" | "payload_cog" => {
            Value::Vector3([0.0; 3])
        }
        "actual_execution_time"
        | "actual_momentum"
        | "actual_robot_current"
        | "tcp_force_scalar"
        | "payload"
        | "io_current"
        | "standard_analog_input0"
        | "standard_analog_input1"
        | "standard_analog_output0"
        | "standard_analog_output1"
        | "tool_analog_input0"
        | "tool_analog_input1"
        | "tool_output_current"
        | "tool_temperature"
        | "joint_position_deviation_ratio"
        | "collision_detection_ratio" => Value::Double(0.0),
        "actual_digital_input_bits" | "actual_digital_output_bits" => Value::Long(0),
        "analog_io_types" | "tool_mode" | "tool_analog_input_types" | "script_control_line" => Value::Uint(0),
        "tool_output_voltage" | "time_scale_source" => Value::Int(0),
        "tool_output_mode" | "tool_digital_output0_mode" | "tool_digital_output1_mode" => Value::Byte(0),
        _ => return None,
    })
}

/// General purpose registers, all zero.
fn register(name: &str, side: &str) -> Option<Value> {
    let rest = name.strip_prefix(side)?.strip_prefix('_')?;
    let numbered = |prefix: &str| rest.strip_prefix(prefix).and_then(|n| n.parse::<u32>().ok());
    if matches!(rest, "bit_registers0_to_31" | "bit_registers32_to_63") {
        return Some(Value::Uint(0));
    }
    if let Some(n) = numbered("int_register_") {
        return (n < INTEGERS).then_some(Value::Int(0));
    }
    if let Some(n) = numbered("double_register_") {
        return (n < INTEGERS).then_some(Value::Double(0.0));
    }
    numbered("bit_register_").filter(|n| BITS.contains(n)).map(|_| Value::Bool(false))
}

/// The type of an input.
pub(super) fn input_type(name: &str) -> Option<&'static str> {
    Some(match name {
        "speed_slider_mask" => "UINT32",
        "speed_slider_fraction" | "standard_analog_output_0" | "standard_analog_output_1" => "DOUBLE",
        "standard_digital_output_mask"
        | "standard_digital_output"
        | "configurable_digital_output_mask"
        | "configurable_digital_output"
        | "tool_digital_output_mask"
        | "tool_digital_output"
        | "standard_analog_output_mask"
        | "standard_analog_output_type" => "UINT8",
        "external_force_torque" => "VECTOR6D",
        _ => return register(name, "input").map(|value| value.type_name()),
    })
}

/// Velocity (m/s) and angular velocity (rad/s) of the flange, by a difference.
fn flange_speed(arm: &Snapshot) -> [f64; 6] {
    const STEP: f64 = 1e-6;
    let later = std::array::from_fn(|i| arm.joints[i] + STEP * arm.speeds[i]);
    let (a, b) = (arm.model.flange(&arm.joints).0, arm.model.flange(&later).0);
    let rate = |i: usize, j: usize| (b[i][j] - a[i][j]) / STEP;
    // Half the sum of r x dr over the axes r.
    let angular = |i: usize| {
        let (k, l) = ((i + 1) % 3, (i + 2) % 3);
        0.5 * (0..3).map(|j| a[k][j] * rate(l, j) - a[l][j] * rate(k, j)).sum::<f64>()
    };
    [rate(0, 3), rate(1, 3), rate(2, 3), angular(0), angular(1), angular(2)]
}
