//! Cameras and lights as people name them.

use std::path::Path;
use std::str::FromStr;

use relight_scene::{Camera, Intrinsics, Light, Pose, read_text};

use crate::error::RenderError;

/// A pose file's longest length, bytes.
const LONGEST_FILE: u64 = 1 << 16;

/// The camera called `name`: the number (label) of one of `cameras`, or a file with the 16 numbers of a 4x4
/// camera-to-world matrix (row-major, metres, OpenCV axes; as ReNe's pose files, or JSON), which gets the lens of the
/// first of them.
///
/// # Errors
/// [`RenderError::Placement`] if there is no such camera, [`RenderError::Scene`] or [`RenderError::File`] if the file
/// holds no pose.
pub fn named_camera(cameras: &[Camera], name: &str) -> Result<(Intrinsics, Pose), RenderError> {
    if let Ok(label) = name.parse::<usize>() {
        let found = cameras.iter().find(|camera| camera.label == label);
        return found
            .map(|camera| (camera.intrinsics.clone(), camera.pose))
            .ok_or_else(|| no_such("camera", label, cameras.iter().map(|c| c.label)));
    }
    let none = || RenderError::Placement("there are no cameras whose lens could be used".to_owned());
    let path = Path::new(name);
    let text = read_text(path, LONGEST_FILE)?;
    let numbers = numbers(&text)
        .ok_or_else(|| RenderError::file(path, "holds something other than the numbers of a pose"))?;
    let pose = pose_of(&numbers).map_err(|problem| RenderError::file(path, problem))?;
    let lens = cameras.first().ok_or_else(none)?.intrinsics.clone();
    Ok((lens, pose))
}

/// A light as people name it.
#[derive(Clone, Debug, PartialEq)]
pub enum LightName {
    /// The number (label) of one of a scene's lights.
    Label(usize),
    /// A position in the world, metres.
    Position([f64; 3]),
    /// A light-to-world pose.
    Pose(Pose),
}

impl FromStr for LightName {
    type Err = RenderError;

    /// Reads a number, a position `X,Y,Z`, or the 16 numbers of a 4x4 matrix.
    fn from_str(name: &str) -> Result<LightName, RenderError> {
        if let Ok(label) = name.trim().parse() {
            return Ok(LightName::Label(label));
        }
        match numbers(name).as_deref() {
            Some(&[x, y, z]) => checked([x, y, z]).map(LightName::Position).map_err(RenderError::Placement),
            Some(numbers) if numbers.len() == 16 => {
                pose_of(numbers).map(LightName::Pose).map_err(RenderError::Placement)
            }
            _ => Err(RenderError::Placement(format!(
                "{name:?} is no light: give the number of one, its position as X,Y,Z in metres, or the 16 numbers of \
                 its light-to-world matrix"
            ))),
        }
    }
}

impl LightName {
    /// The light's pose. A light given by its position alone looks at the focus along +Z, as ReNe's lights do, +Y as far down as
    /// it can be.
    ///
    /// # Errors
    /// [`RenderError::Placement`] if none of `lights` has the number.
    pub fn pose(&self, lights: &[Light], focus: [f64; 3]) -> Result<Pose, RenderError> {
        match *self {
            LightName::Label(label) => lights
                .iter()
                .find(|light| light.label == label)
                .map(|light| light.pose)
                .ok_or_else(|| no_such("light", label, lights.iter().map(|l| l.label))),
            LightName::Position(position) => Ok(Pose::look_at(position, focus)),
            LightName::Pose(pose) => Ok(pose),
        }
    }
}

/// A position that can be one, or what is wrong with it.
pub(crate) fn checked(position: [f64; 3]) -> Result<[f64; 3], String> {
    Pose::check_position(position).map_err(|fault| format!("{fault}. Positions are in metres"))?;
    Ok(position)
}

/// The pose of 16 numbers, or what is wrong with them.
pub(crate) fn pose_of(numbers: &[f64]) -> Result<Pose, String> {
    let matrix: &[f64; 16] = numbers
        .try_into()
        .map_err(|_| format!("{} numbers are no pose: a 4x4 matrix has 16, row by row", numbers.len()))?;
    Pose::from_matrix(matrix).map_err(|fault| format!("{fault}. Poses are rigid, to-world, in metres"))
}

/// The numbers of a text in which they are set apart by blanks, commas or brackets; `None` if it holds anything else.
fn numbers(text: &str) -> Option<Vec<f64>> {
    text.split(|c: char| c.is_whitespace() || ",;[]".contains(c))
        .filter(|word| !word.is_empty())
        .map(|word| word.parse().ok())
        .collect()
}

fn no_such(what: &str, label: usize, labels: impl Iterator<Item = usize>) -> RenderError {
    let (mut lowest, mut highest) = (usize::MAX, 0);
    labels.for_each(|label| (lowest, highest) = (lowest.min(label), highest.max(label)));
    let known =
        if lowest > highest { "has none".to_owned() } else { format!("has numbers {lowest} to {highest}") };
    RenderError::Placement(format!("there is no {what} {label}: the scene {known}"))
}
