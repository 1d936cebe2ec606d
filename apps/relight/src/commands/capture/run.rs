//! `relight capture run`: every view under every light.

use std::path::PathBuf;
use std::time::Instant;

use anyhow::{bail, ensure};
use clap::ValueEnum;
use relight_capture::session::{self, Ending, STATE};
use relight_capture::virtual_rig::VirtualCapture;
use relight_capture::virtual_rig::objects::ALL;

use crate::commands::render::size;
use crate::console::{Progress, cancel_flag, print_line, unless};

/// Shoot a capture: every view under every light.
///
/// The virtual rig traces an object on a floor between two walls, with cameras and lights where the real rig has them, and
/// ends in a folder of the official ReNe layout with its splits. Every frame is journalled: --resume goes on after a kill
/// at any moment, without a lost or a doubled frame, and ends in the very same bytes.
#[derive(clap::Args)]
#[command(after_help = format!(
    "Examples:\n  relight capture run --object fern --out scenes/fern --size 320x240\n  \
     relight capture run --object teapot.glb --out scenes/teapot --resume\n\n\
     Built-in objects:\n{}",
    ALL.map(|object| format!("  {:<14} {}", object.name, object.about)).join("\n")
))]
pub struct Args {
    /// What shoots.
    #[arg(long, default_value = "virtual")]
    rig: RigKind,
    /// What stands there: a built-in object, or a mesh as .glb, .gltf or .obj.
    #[arg(long, value_name = "NAME|FILE")]
    object: String,
    /// Folder of the scene, made anew.
    #[arg(long, value_name = "SCENE")]
    out: PathBuf,
    /// Size of the photographs.
    #[arg(long, value_name = "WxH", default_value = "320x240", value_parser = size)]
    size: (u32, u32),
    /// Views.
    #[arg(long, value_name = "N", default_value_t = 50)]
    views: usize,
    /// Lights.
    #[arg(long, value_name = "N", default_value_t = 40)]
    lights: usize,
    /// Camera rays a pixel.
    #[arg(long, value_name = "N", default_value_t = 32)]
    samples: u32,
    /// Seed of paths and of the sensor's noise.
    #[arg(long, default_value_t = 0)]
    seed: u64,
    /// Go on with the session in SCENE; begin it if there is none.
    #[arg(long)]
    resume: bool,
    /// Say what would be shot, and shoot nothing.
    #[arg(long)]
    dry_run: bool,
}

#[derive(Clone, Copy, Debug, ValueEnum)]
enum RigKind {
    /// A path tracer in the place of arms, lamp and camera.
    Virtual,
}

pub fn run(args: &Args, quiet: bool) -> anyhow::Result<()> {
    ensure!(!args.out.is_file(), "{}: is a file; name a folder", args.out.display());
    // The only one.
    let RigKind::Virtual = args.rig;
    let (width, height) = args.size;
    let capture = VirtualCapture {
        object: args.object.clone(),
        views: args.views,
        lights: args.lights,
        width,
        height,
        samples: args.samples,
        seed: args.seed,
    };
    if args.dry_run {
        return rehearse(&capture);
    }
    let ending = shoot(&capture, args, quiet)?;
    let Ending::Complete { blurred, moved } = ending else {
        bail!(
            "stopped; go on with the same command and --resume. What is shot so far: {}",
            args.out.join(STATE).join(session::SHEET).display()
        );
    };
    for (view, light) in blurred {
        tracing::warn!("view {view} under light {light} is blurred beside the others");
    }
    for (view, light) in moved {
        tracing::warn!("view {view} under light {light}: something moved while the view was shot");
    }
    print_line(&format!("{}: {} views under {} lights", args.out.display(), args.views, args.lights))
}

fn shoot(capture: &VirtualCapture, args: &Args, quiet: bool) -> anyhow::Result<Ending> {
    let cancel = cancel_flag()?;
    let bar = Progress::new("shooting", (args.views * args.lights) as u64, quiet);
    let started = Instant::now();
    let ending = capture.shoot(&args.out, args.resume, &mut |progress| {
        let session::Progress { done, resumed, total } = progress;
        bar.update(done as u64, total as u64, || {
            let rate = (done - resumed) as f64 / started.elapsed().as_secs_f64();
            format!("{done} of {total} photographs, {rate:.1}/s")
        });
        unless(cancel)
    });
    bar.clear();
    Ok(ending?)
}

/// Tells what would be shot.
fn rehearse(capture: &VirtualCapture) -> anyhow::Result<()> {
    let plan = capture.rehearse()?;
    let (views, lights) = (plan.camera.order.len(), plan.light.order.len());
    print_line(&format!(
        "{views} views under {lights} lights: {} photographs of {}x{} pixels\ncamera: {:.2} m from first view to last\nlight: \
         {:.2} m from first light to last, once a view",
        views * lights,
        capture.width,
        capture.height,
        plan.camera.length(),
        plan.light.length()
    ))
}
