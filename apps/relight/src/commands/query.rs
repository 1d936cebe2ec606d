//! `relight query`: the field itself at given points.

use std::path::PathBuf;

use anyhow::{Context, bail, ensure};
use relight_field::architecture::LightInput;
use relight_field::engine::{LightPose, Points};
use relight_field::reference::{self, Field};
use relight_scene::{Pose, read_text};
use relight_train::run::RunFolder;
use serde::{Deserialize, Serialize};

use crate::console::print_json;
use crate::engines;

/// Most points in a file; a file with more is a mistake.
const MAX_POINTS: usize = 10_000_000;
/// Longest file, bytes: that many points with all their digits.
const LONGEST: u64 = 1 << 31;

/// Evaluate the field at points of the world.
///
/// Density is per metre and zero outside the box; rgb is the radiance with visibility included, in 0..1.
#[derive(clap::Args)]
#[command(after_help = "Example:\n  relight query RUN points.json --json > values.json\n\n\
                  Reads {\"points\":[[x,y,z],…],\"directions\":[[x,y,z],…],\"light\":[16 numbers]}: metres, world \
                  frame. Directions point from the camera into the scene and are made unit vectors; the light is its \
                  4x4 light-to-world matrix, row by row.\n\
                  Writes {\"density\":[…],\"rgb\":[[r,g,b],…],\"visibility\":[…] or null}.")]
pub struct Args {
    /// Folder of a trained run.
    run: PathBuf,
    /// The points.
    points: PathBuf,
    /// JSON on standard output (the only form there is).
    #[arg(long)]
    json: bool,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Question {
    points: Vec<[f64; 3]>,
    directions: Vec<[f64; 3]>,
    #[serde(default)]
    light: Option<[f64; 16]>,
}

#[derive(Serialize)]
struct Answer {
    density: Vec<f32>,
    rgb: Vec<[f32; 3]>,
    visibility: Option<Vec<f32>>,
}

pub fn run(args: &Args) -> anyhow::Result<()> {
    let (run, config) = RunFolder::open(&args.run)?;
    let file = args.points.display().to_string();
    let text = read_text(&args.points, LONGEST)?;
    let points = parse(&text).with_context(|| file.clone())?;
    if points.light.is_none() && config.field()?.architecture.light != LightInput::None {
        bail!("{file}: no \"light\": model {} needs the light's 16 numbers, row by row", config.model);
    }
    // The plain engine in double precision: what others compare with should carry no rounding of ours.
    let parameters = engines::weights(&run, &config)?;
    let values = reference::query(&Field::<f64>::new(&parameters)?, &points)?;
    print_json(&Answer { density: values.density, rgb: values.rgb, visibility: values.visibility })
}

/// Reads the question and checks every number of it.
fn parse(text: &str) -> anyhow::Result<Points> {
    let question: Question = serde_json::from_str(text)
        .context("not {\"points\":[[x,y,z]…],\"directions\":[[x,y,z]…],\"light\":[16 numbers]}")?;
    let n = question.points.len();
    ensure!(n <= MAX_POINTS, "{n} points; at most {MAX_POINTS} at once: split the file");
    ensure!(
        question.directions.len() == n,
        "{n} points but {} directions; each point needs one",
        question.directions.len()
    );
    if let Some(i) = question.points.iter().position(|p| p.iter().any(|c| !c.is_finite())) {
        bail!("point {i} is not finite");
    }
    let directions = question.directions.iter().enumerate().map(|(i, d)| {
        let norm = d.iter().map(|c| c * c).sum::<f64>().sqrt();
        ensure!(norm.is_finite() && norm > 0.0, "direction {i} has no direction: {d:?}");
        Ok(d.map(|c| c / norm))
    });
    let directions = directions.collect::<anyhow::Result<_>>()?;
    let light = question.light.map(|matrix| {
        let pose = Pose::from_matrix(&matrix).context(
            "\"light\" is no light-to-world matrix: rigid, in metres, row by row, its last row 0 0 0 1",
        )?;
        anyhow::Ok(LightPose(pose.row_major_f32()))
    });
    Ok(Points { positions: question.points, directions, light: light.transpose()? })
}

#[cfg(test)]
mod tests {
    use super::*;

    const LIGHT: &str = "[1,0,0,0, 0,1,0,0, 0,0,1,0.5, 0,0,0,1]";

    #[test]
    fn directions_become_unit_vectors_and_the_light_keeps_its_position() {
        let text = format!(r#"{{"points":[[0,0,1]],"directions":[[0,0,-2]],"light":{LIGHT}}}"#);
        let points = parse(&text).unwrap();
        assert_eq!(points.directions, [[0.0, 0.0, -1.0]]);
        assert_eq!(points.light.unwrap().position(), [0.0, 0.0, 0.5]);
    }

    #[test]
    fn faults_are_named() {
        let fault = |text: &str| format!("{:#}", parse(text).unwrap_err());
        assert!(fault(r#"{"points":[[0,0,1]],"directions":[]}"#).contains("0 directions"));
        assert!(fault(r#"{"points":[[0,0,1]],"directions":[[0,0,0]]}"#).contains("direction 0"));
        assert!(fault(r#"{"points":[[0,0]],"directions":[[0,0,1]]}"#).contains("line 1"));
        assert!(fault(r#"{"points":[],"directions":[],"light":[1,2]}"#).contains("16 numbers"));
        for (light, problem) in [
            ("[1,0,0,0, 0,1,0,0, 0,0,1,0, 0,0,0.5,1]", "transposed"),
            ("[1,0,0,0, 0,1,0,0, 0,0,1,0, 0,0,0,2]", "last row"),
            ("[2,0,0,0, 0,2,0,0, 0,0,2,0.5, 0,0,0,1]", "scaled by 2"),
            ("[1,0.2,0,0, 0,1,0,0, 0,0,1,0.5, 0,0,0,1]", "not orthonormal"),
            ("[-1,0,0,0, 0,1,0,0, 0,0,1,0.5, 0,0,0,1]", "mirrors"),
        ] {
            let told = fault(&format!(r#"{{"points":[],"directions":[],"light":{light}}}"#));
            assert!(told.contains(problem) && told.contains("row by row"), "{light}: {told}");
        }
    }
}
