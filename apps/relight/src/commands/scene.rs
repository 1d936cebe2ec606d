//! `relight scene`: what a folder holds, what is wrong with it, and what it looks like.

use std::path::PathBuf;

use anyhow::bail;
use relight_scene::{Scene, SceneInfo, Severity, check, contact_sheet};

use crate::console::{Progress, counted, print_json, print_line};
use crate::places;

/// Look at a scene: what it holds, what is wrong with it, a sheet of its photographs.
#[derive(clap::Args)]
pub struct Args {
    #[command(subcommand)]
    command: Command,
}

#[derive(clap::Subcommand)]
enum Command {
    Info(Info),
    Check(Check),
    Sheet(Sheet),
}

/// What a scene holds: views, lights, size, bounds, splits, black test images.
#[derive(clap::Args)]
#[command(after_help = "Example:\n  relight scene info SCENE --json")]
struct Info {
    /// Folder of the scene.
    scene: PathBuf,
    /// One JSON object on standard output.
    #[arg(long)]
    json: bool,
}

/// Every fault of a folder, each with its file and how to mend it.
///
/// Decodes every image. The exit status is 1 if the scene cannot be used as it is; notes and warnings alone leave
/// it 0.
#[derive(clap::Args)]
#[command(after_help = "Example:\n  relight scene check SCENE")]
struct Check {
    /// Folder of the scene.
    scene: PathBuf,
}

/// A contact sheet of views and lights, and the poses drawn in 3D.
#[derive(clap::Args)]
#[command(after_help = "Example:\n  relight scene sheet SCENE --out sheet.png\n\n\
                  Beside the photographs, the poses from aslant and from above: training cameras blue, validation \
                  green, test red; training lights yellow, test lights orange; grey the box found from cameras and lights, which preset \
                  fast makes tighter around the surfaces that stereo finds.")]
struct Sheet {
    /// Folder of the scene.
    scene: PathBuf,
    /// Picture to write.
    #[arg(long, value_name = "sheet.png")]
    out: PathBuf,
}

pub fn run(args: &Args, quiet: bool) -> anyhow::Result<()> {
    match &args.command {
        Command::Info(args) => info(args),
        Command::Check(args) => run_check(args, quiet),
        Command::Sheet(args) => {
            places::check_file(&args.out)?;
            let scene = Scene::open(&args.scene)?;
            Ok(contact_sheet(&scene)?.write_png(&args.out)?)
        }
    }
}

fn info(args: &Info) -> anyhow::Result<()> {
    let info = SceneInfo::of(&Scene::open(&args.scene)?)?;
    if args.json { print_json(&info) } else { print_line(&describe(&info)) }
}

/// The facts for people.
fn describe(info: &SceneInfo) -> String {
    let corner = |c: [f32; 3]| format!("({:.3}, {:.3}, {:.3})", c[0], c[1], c[2]);
    let splits = &info.splits;
    let mut lines = vec![
        format!("{}: {} views, {} lights, {} images", info.name, info.views, info.lights, info.images),
        format!(
            "size     {}x{}{}{}",
            info.size[0],
            info.size[1],
            if info.same_size { "" } else { ", others too" },
            if info.distorted { ", with lens distortion" } else { "" }
        ),
        format!(
            "bounds   {} to {} m by cameras and lights; preset fast makes it tighter by stereo",
            corner(info.bounds.lo),
            corner(info.bounds.hi)
        ),
        format!(
            "splits   train {} ({:.2} GB of pixels), val {}, easy {}, hard {}",
            splits.train,
            info.training_bytes as f64 / 1e9,
            splits.val,
            splits.easy,
            splits.hard
        ),
    ];
    if info.black_test_images > 0 {
        lines.push(format!(
            "black    {} of {} test images are all black: the official release blacks them out on purpose, this is no \
             corruption; score with --split val",
            info.black_test_images,
            splits.easy + splits.hard
        ));
    }
    lines.join("\n")
}

fn run_check(args: &Check, quiet: bool) -> anyhow::Result<()> {
    let bar = Progress::new("checking", 1, quiet);
    let report = check(&args.scene, &|done, all| {
        bar.count(done, all, "images");
    });
    bar.clear();
    for fault in &report.faults {
        print_line(&format!("{}: {fault}", fault.severity))?;
    }
    if report.faults.is_empty() {
        print_line("no faults found")?;
    }
    if !report.is_usable() {
        let errors = report.count(Severity::Error);
        let faults = counted(errors, "fault");
        bail!("{}: cannot be used as it is: {faults} to mend", args.scene.display());
    }
    Ok(())
}
