//! `relight capture plan`: where camera and light go, and in which order.

use std::path::{Path, PathBuf};

use anyhow::Context;
use relight_capture::kinematics::{ArmsSettings, Cell};
use relight_capture::rig::{Itinerary, RigFile, SetupError};
use relight_capture::trajectory::{Plan, Reach, Trajectory, picture};
use relight_capture::virtual_rig::VirtualCapture;

use super::run::VIRTUAL;
use crate::console::print_line;
use crate::places;

/// Plan a capture: waypoints of camera and light on equal-area cells around the object, and a short way through them.
///
/// Without a rig file the plan is that of the paper: 50 cameras on a wedge, 40 lights on a dome, and no arms that are asked.
#[derive(clap::Args)]
#[command(
    after_help = "Example:\n  relight capture plan --rig rig.toml --out plan.json --picture plan.png\n\n\
                  A rig file holds some or all of these tables, each as a whole; here with what is taken without them:\n\n  \
                  [object]                               # the box that holds it, metres; all look at its middle\n  \
                  lo = [-0.1, -0.1, 0.0]\n  \
                  hi = [0.1, 0.1, 0.15]\n\n  \
                  [camera]\n  \
                  waypoints = 50\n  \
                  colatitude-degrees = [48.0, 68.0]      # 0 at the zenith (+Z), 90 at the horizon\n  \
                  azimuth-degrees = [-118.5, -61.5]      # from +X towards +Y; the whole circle if left out\n  \
                  radius-metres = [0.602, 0.623]\n  \
                  centre-metres = [0.0, 0.0, 0.0]        # of the sphere; the origin if left out\n  \
                  roll-degrees = 0.0                     # about the direction of sight; none if left out\n\n  \
                  [light]\n  \
                  waypoints = 40\n  \
                  colatitude-degrees = [5.0, 43.0]\n  \
                  radius-metres = [0.363, 0.414]\n\n\
                  With a table of arms, which waypoints they reach is found out, and joints travel little; without it all are \
                  taken to be reached:\n\n  \
                  [arms]\n  \
                  camera = { model = \"ec66\", base-metres = [0.0, -1.0, 0.0], yaw-degrees = 0.0 }\n  \
                  light = { model = \"ur5e\", base-metres = [-0.124, 0.464, 0.03] }\n  \
                  table-metres = 0.0                     # height of the table\n  \
                  clearance-metres = 0.01                # how far all must stay from each other\n  \
                  walls = []                             # that nothing may meet: { lo = [x, y, z], hi = [x, y, z] }\n  \
                  # camera and light take home-degrees = [6 joints] too: where the arm waits; upright if left out\n\n\
                  `relight capture run --help` shows the tables that shooting takes."
)]
pub struct Args {
    /// Where camera and light may stand, the object, and the arms: a TOML file; or `virtual`, the rig of `capture run`.
    #[arg(long, value_name = "virtual|rig.toml")]
    rig: Option<PathBuf>,
    /// Plan to write.
    #[arg(long, value_name = "plan.json")]
    out: PathBuf,
    /// Picture of the plan to write.
    #[arg(long, value_name = "plan.png")]
    picture: Option<PathBuf>,
}

pub fn run(args: &Args) -> anyhow::Result<()> {
    for path in [Some(&args.out), args.picture.as_ref()].into_iter().flatten() {
        places::check_file(path)?;
    }
    let file = match args.rig.as_deref() {
        Some(rig) if rig == Path::new(VIRTUAL) => virtual_rig(),
        Some(rig) => RigFile::read(rig)?,
        None => RigFile::default(),
    };
    let named = || match &args.rig {
        Some(rig) => rig.display().to_string(),
        None => "the paper's rig".to_owned(),
    };
    let mut plan = Plan::new(&file.plan_settings()).with_context(named)?;
    let planned = |arms: ArmsSettings| -> Result<Itinerary, SetupError> {
        Ok(Itinerary::plan(arms.cell(plan.object)?, &arms.homes(), &mut plan)?)
    };
    let itinerary = file.arms.map(planned).transpose().with_context(named)?;
    plan.write(&args.out)?;
    if let Some(path) = &args.picture {
        let [camera, light] =
            itinerary.as_ref().map(|it| reaches(it.cell())).map_or([None, None], |reaches| reaches.map(Some));
        picture(&plan, camera.as_ref(), light.as_ref()).write_png(path)?;
    }
    print_line(&format!("{}\n{}", told("camera", &plan.camera), told("light", &plan.light)))?;
    if itinerary.is_none() {
        print_line(
            "no arms were asked whether they reach these: name a rig file with a table [arms], or --rig virtual",
        )?;
    }
    Ok(())
}

/// The rig that needs no file.
fn virtual_rig() -> RigFile {
    let domes = VirtualCapture::domes();
    RigFile {
        object: Some(domes.object),
        camera: Some(domes.camera),
        light: Some(domes.light),
        arms: Some(VirtualCapture::arms()),
        ..RigFile::default()
    }
}

/// How far both arms reach with what they carry.
fn reaches(cell: &Cell<2>) -> [Reach; 2] {
    cell.arms().each_ref().map(|arm| {
        let [x, y, z] = arm.base.position();
        let tool = arm.tool.mount.position().iter().map(|c| c * c).sum::<f64>().sqrt();
        let model = &arm.model;
        let radius = model.a2.abs() + model.a3.abs() + model.d4.abs().hypot(model.d5 + model.d6) + tool;
        Reach { name: arm.name.clone(), shoulder: [x, y, z + model.d1], radius }
    })
}

/// A trajectory for people: how much it is, and which waypoints are unreachable and why.
fn told(name: &str, trajectory: &Trajectory) -> String {
    let [near, far] = trajectory.radius;
    let (visited, all) = (trajectory.order.len(), trajectory.waypoints.len());
    let mut lines = vec![format!(
        "{name:<6} {visited} of {all} waypoints, {near:.3} to {far:.3} m out, {:.2} m from first to last",
        trajectory.length()
    )];
    lines.extend(trajectory.waypoints.iter().filter_map(|waypoint| {
        let reason = waypoint.unreachable.as_ref()?;
        Some(format!("  {name} {} is unreachable: {reason}", waypoint.label))
    }));
    lines.join("\n")
}
