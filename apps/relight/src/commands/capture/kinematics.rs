//! `relight capture kinematics`: where an arm's flange is, and which joints bring it there.

use std::ffi::OsString;

use clap::ValueEnum;
use relight_capture::kinematics::{ArmModel, EC66, Joints, UR5E};
use relight_scene::Pose;
use serde::Serialize;

use crate::console::{print_json, print_line};

/// The options that take a list of numbers.
const LISTS: [&str; 2] = ["--joints", "--pose"];

/// Where an arm's flange is for given joints, or all joints that bring it to a pose.
///
/// The pose is the bare flange's (tool0) in the robot's base frame, as the vendor's controller tells it: a 4x4 matrix row by
/// row, metres. Joints are the controller's, radians.
#[derive(clap::Args)]
#[command(
    after_help = "Examples:\n  relight capture kinematics ur5e --joints 0,-1.57,1.57,-1.57,-1.57,0 --json\n  \
                  relight capture kinematics ec66 --pose 1 0 0 0.4  0 -1 0 0.1  0 0 -1 0.3  0 0 0 1\n\n\
                  Writes {\"pose\":[16 numbers]} or {\"solutions\":[[6 numbers],…]}. Solutions are those within the \
                  joints' ranges, each angle in -pi..pi; at most eight, none if the pose is out of reach (standard \
                  error then says why). Where fourth and sixth axis are in line, the sixth joint is free; the \
                  solutions with it at 0 are given."
)]
pub struct Args {
    /// Which arm.
    arm: Arm,
    /// Joint angles, radians, base first.
    #[arg(long, value_name = "Q1,…,Q6", value_parser = parse_joints, allow_hyphen_values = true)]
    #[arg(required_unless_present = "pose", conflicts_with = "pose")]
    joints: Option<Joints>,
    /// The flange's pose, 16 numbers row by row, parted by commas or spaces.
    #[arg(long, value_name = "16 NUMBERS", value_parser = parse_pose, allow_hyphen_values = true)]
    pose: Option<Pose>,
    /// One JSON object on standard output.
    #[arg(long)]
    json: bool,
}

#[derive(Clone, Copy, ValueEnum)]
enum Arm {
    Ur5e,
    Ec66,
}

impl Arm {
    fn model(self) -> &'static ArmModel {
        match self {
            Self::Ur5e => &UR5E,
            Self::Ec66 => &EC66,
        }
    }
}

#[derive(Serialize)]
struct FlangePose {
    pose: Vec<f64>,
}

#[derive(Serialize)]
struct Solutions {
    solutions: Vec<Joints>,
}

pub fn run(args: &Args) -> anyhow::Result<()> {
    let model = args.arm.model();
    if let Some(joints) = &args.joints {
        forward(model, joints, args.json)?;
    }
    if let Some(pose) = &args.pose {
        inverse(model, pose, args.json)?;
    }
    Ok(())
}

fn forward(model: &ArmModel, joints: &Joints, json: bool) -> anyhow::Result<()> {
    if let Err(fault) = model.limits.check(joints) {
        tracing::warn!("the {} cannot stand so: {fault}", model.name);
    }
    let [x, y, z] = model.forward(joints).0;
    let rows = [x, y, z, [0.0, 0.0, 0.0, 1.0]];
    if json {
        return print_json(&FlangePose { pose: rows.concat() });
    }
    rows.iter().try_for_each(|row| print_line(&columns(row)))
}

fn inverse(model: &ArmModel, pose: &Pose, json: bool) -> anyhow::Result<()> {
    let solutions = model.inverse_within_limits(pose, &[0.0; 6]).unwrap_or_else(|reason| {
        tracing::warn!("the {} cannot reach the pose: {reason}", model.name);
        Vec::new()
    });
    if json {
        return print_json(&Solutions { solutions });
    }
    solutions.iter().try_for_each(|joints| print_line(&columns(joints)))
}

fn columns(numbers: &[f64]) -> String {
    numbers.iter().map(|number| format!("{number:12.6}")).collect()
}

fn parse_joints(text: &str) -> Result<Joints, String> {
    numbers(text)
}

fn parse_pose(text: &str) -> Result<Pose, String> {
    Pose::from_matrix(&numbers(text)?).map_err(|fault| {
        format!(
            "{fault}; the pose is the flange's in the base's frame, a rigid 4x4 matrix row by row, in metres"
        )
    })
}

/// Exactly so many finite numbers, parted by commas or spaces.
fn numbers<const COUNT: usize>(text: &str) -> Result<[f64; COUNT], String> {
    let number = |word: &str| match word.parse::<f64>() {
        Ok(value) if value.is_finite() => Ok(value),
        Ok(_) => Err(format!("{word} is not a finite number")),
        Err(_) => Err(format!("{word:?} is not a number")),
    };
    let all: Vec<f64> = words(text).map(number).collect::<Result<_, _>>()?;
    all.try_into().map_err(|all: Vec<f64>| format!("{} numbers where {COUNT} are needed", all.len()))
}

fn words(text: &str) -> impl Iterator<Item = &str> {
    text.split([',', ' ', '\n', '\t']).filter(|word| !word.is_empty())
}

/// Joins the numbers after `--pose` or `--joints` into one argument.
///
/// Numbers may be parted by spaces, many are negative, and some look like `-1e-17`: left alone, clap takes those for options,
/// or, told not to, takes options for numbers.
pub fn join_numbers(arguments: impl IntoIterator<Item = OsString>) -> Vec<OsString> {
    let mut joined: Vec<OsString> = Vec::new();
    let mut list: Option<String> = None;
    for argument in arguments {
        match (&mut list, argument.to_str()) {
            (Some(list), Some(text)) if words(text).all(|word| word.parse::<f64>().is_ok()) => {
                list.push(if list.contains('=') { ',' } else { '=' });
                list.push_str(text);
            }
            (_, text) => {
                joined.extend(list.take().map(OsString::from));
                let starts = |name: &&str| text.is_some_and(|text| text.split('=').next() == Some(name));
                match text.filter(|_| LISTS.iter().any(starts)) {
                    Some(text) => list = Some(text.to_owned()),
                    None => joined.push(argument),
                }
            }
        }
    }
    joined.extend(list.map(OsString::from));
    joined
}

#[cfg(test)]
mod tests {
    use super::*;

    fn joined(line: &str) -> Vec<String> {
        let words = line.split_whitespace().map(OsString::from);
        join_numbers(words).into_iter().map(|word| word.into_string().unwrap()).collect()
    }

    #[test]
    fn numbers_of_a_list_become_one_argument() {
        assert_eq!(
            joined("k ur5e --pose -1 0 -1e-17 .5 --json -v"),
            ["k", "ur5e", "--pose=-1,0,-1e-17,.5", "--json", "-v"]
        );
        assert_eq!(joined("k --joints -1,2,-3 --json"), ["k", "--joints=-1,2,-3", "--json"]);
        assert_eq!(joined("k --joints=-1,2, 3 -v"), ["k", "--joints=-1,2,,3", "-v"]);
        assert_eq!(joined("k --pose --joints 1"), ["k", "--pose", "--joints=1"]);
        assert_eq!(joined("train -1 scene --steps 7"), ["train", "-1", "scene", "--steps", "7"]);
    }

    #[test]
    fn lists_of_the_wrong_length_or_of_no_numbers_are_refused() {
        assert_eq!(numbers::<3>("-1, 2e-3,3"), Ok([-1.0, 2e-3, 3.0]));
        assert_eq!(numbers::<3>("1,2").unwrap_err(), "2 numbers where 3 are needed");
        assert!(numbers::<3>("1,2,x").unwrap_err().contains("\"x\""));
        assert!(numbers::<3>("1,2,inf").unwrap_err().contains("finite"));
        assert!(
            parse_pose("2 0 0 0 0 2 0 0 0 0 2 0 0 0 0 1")
                .unwrap_err()
                .starts_with("the rotation part is scaled by 2")
        );
    }
}
