//! `relight capture shoot-board` with real arms and a real camera.

use std::fs;
use std::io::Write;

use anyhow::{Context, bail, ensure};
use relight_capture::calibration::{BOARD, BoardFile, LENS_VIEWS, VIEWS, photograph_name, shoot_board};
use relight_capture::rig::{ArmsRig, CAMERA, LIGHT, Photographs, Prepared, RigFile, SetupError, connect};
use relight_scene::write_whole;
use serde_json::{Value, json};

use super::board::described;
use super::run::real_eye;
use super::shoot_board::Args;
use crate::console::{Progress, cancel_flag, print_line, stop_flag, unless};

/// Where the photographs of the session were taken.
const PLACES: &str = "places.json";
const FORMAT: &str = "relight-board-places-1";

/// Photographs the board from every waypoint that the arms reach.
pub fn run(args: &Args, file: &RigFile, quiet: bool) -> anyhow::Result<()> {
    let named = || args.rig.clone();
    let arms = file.arms.clone().with_context(|| format!("{}: has no arms; add a table [arms]", args.rig))?;
    let controllers = file.controllers.as_ref().with_context(|| {
        format!("{}: nobody knows where the arms listen; add a table [controllers]", args.rig)
    })?;
    let mut plan = file.plan_settings();
    plan.camera.waypoints = args.views.unwrap_or(plan.camera.waypoints);
    let board = args.board.board(file.board.as_ref())?;
    let prepared = Prepared::new(&plan, &arms).with_context(named)?;
    prepared.left_out().iter().for_each(|line| tracing::warn!("{line}"));
    let itinerary = &prepared.itinerary;
    // Under the highest light least of the board is in glancing light.
    let height = |&label: &usize| itinerary.pose(LIGHT, label).position()[2];
    let lights = prepared.labels[LIGHT].iter().copied();
    let lamp = lights.max_by(|a, b| height(a).total_cmp(&height(b))).context("no light is reached")?;
    let labels = [prepared.labels[CAMERA].clone(), vec![lamp]];
    let views = labels[CAMERA].iter().enumerate();
    let views: Vec<_> =
        views.map(|(number, &label)| (number, args.out.join(VIEWS).join(photograph_name(label)))).collect();
    let poses = labels[CAMERA].iter().map(|&label| json!([label, itinerary.pose(CAMERA, label).to_matrix()]));
    let subject = json!({
        "format": FORMAT,
        "size": file.photographs.as_ref().and_then(Photographs::size),
        "development": format!("{:?}", file.development()),
        "light": [lamp, itinerary.pose(LIGHT, lamp).to_matrix()],
        "cameras": poses.collect::<Vec<_>>(),
    });
    let eye = real_eye(file, &args.rig)?;
    let arms = connect(itinerary, &arms, controllers)?;
    let rig = ArmsRig::new(itinerary, labels, arms, eye, file.pace()).map_err(SetupError::from)?;
    let mut rig = rig.interruptible(stop_flag());
    begin(
        args,
        &BoardFile { board, board_to_world: None, light_base_to_world: None, touches: Vec::new() },
        &subject,
    )?;
    let cancel = cancel_flag()?;
    let bar = Progress::new("shooting", views.len() as u64, quiet);
    let complete = shoot_board(&mut rig, &views, &file.development(), &mut |done| {
        bar.count(done, views.len(), "photographs");
        unless(cancel)
    })?;
    bar.clear();
    let out = args.out.display();
    if !complete {
        bail!("{out}: stopped; the arms stand where they are; go on with the same command and --resume");
    }
    rig.park()?;
    print_line(&format!(
        "{out}: a {} from {} waypoints. Now, at the same focus, take a dozen photographs of it into {out}/{LENS_VIEWS}, the camera \
         rolled by quarter turns and tilted by 30 to 45 degrees in all directions; touch the board with the tip of the light's \
         arm, three times or more and not on a line, and write the [[touches]] into {out}/{BOARD} (relight capture calibrate \
         --help); then: relight capture calibrate {out}",
        described(&board),
        views.len()
    ))
}

/// Makes the session's folder, or looks whether the one that is there is of this board and of these places. What somebody has
/// written to its `board.toml` since stays.
fn begin(args: &Args, file: &BoardFile, subject: &Value) -> anyhow::Result<()> {
    let (path, places) = (args.out.join(BOARD), args.out.join(PLACES));
    let subject = serde_json::to_string_pretty(subject)?;
    if path.exists() {
        ensure!(
            args.resume,
            "{}: is not empty; go on with --resume, or name another folder",
            args.out.display()
        );
        let there = BoardFile::read(&path, Some(file.board))?;
        ensure!(
            there.board == file.board,
            "{}: tells of another board; name its options, or begin in another folder",
            path.display()
        );
        let begun = fs::read_to_string(&places).with_context(|| places.display().to_string())?;
        ensure!(
            begun == subject,
            "{}: the session was begun with other waypoints, arms or photographs; go on with its own rig file, or begin in \
             another folder",
            places.display()
        );
    } else {
        let is_empty = !args.out.exists() || fs::read_dir(&args.out)?.next().is_none();
        ensure!(
            is_empty,
            "{}: is not empty, and no session of a board; name another folder",
            args.out.display()
        );
    }
    for folder in [VIEWS, LENS_VIEWS] {
        let folder = args.out.join(folder);
        fs::create_dir_all(&folder).with_context(|| folder.display().to_string())?;
    }
    if !path.exists() {
        write_whole(&places, |out| out.write_all(subject.as_bytes()))
            .with_context(|| places.display().to_string())?;
        let text = file.to_toml().with_context(|| path.display().to_string())?;
        write_whole(&path, |out| out.write_all(text.as_bytes()))
            .with_context(|| path.display().to_string())?;
    }
    Ok(())
}
