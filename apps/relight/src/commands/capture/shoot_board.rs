//! `relight capture shoot-board`: photographs and touches of a board, to calibrate by.

use std::path::{Path, PathBuf};

use anyhow::{Context, bail, ensure};
use relight_capture::rig::{Photographs, RigFile};
use relight_capture::virtual_rig::{BoardCapture, MOST_TOUCHES, TRUTH, VirtualCapture};

use super::board::{BoardOptions, described};
use super::real_board;
use super::run::VIRTUAL;
use crate::commands::render::size;
use crate::console::{Progress, cancel_flag, print_line, unless};

/// Photograph a board from all camera waypoints, and touch it with the light's arm: a session to calibrate by.
///
/// The board lies flat in the middle of the world. After the waypoints come photographs for the lens alone: rolled cameras and
/// a board tilted in all directions tell focal lengths and principal point apart, which waypoints that all look down at one
/// place under the same tilt cannot. The simulated arms of `capture run` go to the waypoints, by the same planned motions and
/// drivers, and come to rest with 0.03 mm of noise; photographs for the lens are taken by hand. The sensor is noisy too.
///
/// With a rig file that names controllers and a camera, the real arms take the real camera to the waypoints, under the highest
/// light. Photographs for the lens and touches are then yours to take; what is left to do is told at the end.
#[derive(clap::Args)]
#[command(after_help = format!(
    "Example:\n  relight capture shoot-board --out SESSION\n  relight capture calibrate SESSION\n\n\
     Writes SESSION/board.toml, SESSION/board/LABEL.png, SESSION/lens/LABEL.png, and SESSION/{TRUTH}, which calibrating never reads;\n\
     of real photographs, the first two."
))]
pub struct Args {
    /// Whose board, waypoints and arms: `virtual`, or a rig file. The path tracer shoots, unless that has a camera.
    #[arg(long, default_value = VIRTUAL, value_name = "virtual|FILE")]
    pub(super) rig: String,
    /// Folder of the session, made anew.
    #[arg(long, value_name = "SESSION")]
    pub(super) out: PathBuf,
    #[command(flatten)]
    pub(super) board: BoardOptions,
    /// Size of virtual photographs.
    #[arg(long, value_name = "WxH", default_value = "1440x1080", value_parser = size)]
    size: (u32, u32),
    /// Camera waypoints [default: 50, or the rig file's].
    #[arg(long, value_name = "N")]
    pub(super) views: Option<usize>,
    /// Virtual photographs for the lens alone.
    #[arg(long, value_name = "N", default_value_t = 12)]
    lens_views: usize,
    /// How often the virtual light's arm touches the board; fewer than three with a declared alignment.
    #[arg(long, value_name = "N", default_value_t = 4, value_parser = clap::value_parser!(u64).range(..=MOST_TOUCHES as u64))]
    touches: u64,
    /// Distortion of the virtual lens, as OpenCV has it; none, as `capture run` shoots, if not given.
    #[arg(long, value_name = "K1,K2,P1,P2,K3", allow_hyphen_values = true, value_parser = distortion)]
    distortion: Option<[f64; 5]>,
    /// Camera rays a pixel of virtual photographs.
    #[arg(long, value_name = "N", default_value_t = 8)]
    samples: u32,
    /// Seed of the virtual arms' and sensor's noise.
    #[arg(long, default_value_t = 0)]
    seed: u64,
    /// Go on with the session in SESSION; begin it if there is none.
    #[arg(long)]
    pub(super) resume: bool,
}

pub fn run(args: &Args, quiet: bool) -> anyhow::Result<()> {
    let (mut plan, arms, of_rig) = if args.rig == VIRTUAL {
        (VirtualCapture::domes(), VirtualCapture::arms(), None)
    } else {
        let file = RigFile::read(Path::new(&args.rig))?;
        if file.photographs.as_ref().and_then(Photographs::size).is_some() {
            return real_board::run(args, &file, quiet);
        }
        ensure!(
            file.controllers.is_none(),
            "{}: has real arms and no real camera; add a table [photographs] with from = \"folder\" or \"gige\"",
            args.rig
        );
        let arms =
            file.arms.clone().with_context(|| format!("{}: has no arms; add a table [arms]", args.rig))?;
        (file.plan_settings(), arms, file.board)
    };
    plan.camera.waypoints = args.views.unwrap_or(plan.camera.waypoints);
    let board = args.board.board(of_rig.as_ref())?;
    let capture = BoardCapture {
        board,
        plan,
        arms,
        lens_views: args.lens_views,
        touches: args.touches as usize,
        distortion: args.distortion.unwrap_or_default(),
        width: args.size.0,
        height: args.size.1,
        samples: args.samples,
        seed: args.seed,
    };
    let cancel = cancel_flag()?;
    let bar = Progress::new("shooting", (plan.camera.waypoints + args.lens_views) as u64, quiet);
    let mut photographs = 0;
    let complete = capture.shoot(&args.out, args.resume, &mut |done, total| {
        photographs = total;
        bar.count(done, total, "photographs");
        unless(cancel)
    })?;
    bar.clear();
    let out = args.out.display();
    if !complete {
        bail!("{out}: stopped; go on with the same command and --resume");
    }
    let (views, lens, touches) = (photographs - args.lens_views, args.lens_views, args.touches);
    print_line(&format!(
        "{out}: a {} from {views} waypoints, {lens} photographs for the lens, {touches} touches; next: relight capture calibrate {out}",
        described(&board)
    ))
}

fn distortion(text: &str) -> Result<[f64; 5], String> {
    let numbers: Result<Vec<f64>, _> = text.split(',').map(|number| number.trim().parse()).collect();
    let numbers = numbers.ok().and_then(|numbers| <[f64; 5]>::try_from(numbers).ok());
    numbers
        .filter(|numbers| numbers.iter().all(|v| v.is_finite()))
        .ok_or_else(|| "this wants five numbers, as in -0.1,0.05,0,0,0".to_owned())
}
