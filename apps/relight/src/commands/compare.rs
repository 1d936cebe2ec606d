//! `relight compare`: scores of one picture against another.

use std::path::PathBuf;

use anyhow::{Context, ensure};
use relight_metrics::{MetricError, psnr, ssim, ssim_uniform7};
use relight_scene::read_image;
use serde::Serialize;

use crate::console::{print_json, print_line};

/// Compare two pictures: PSNR and SSIM.
///
/// Both are taken as 8-bit sRGB of the same size. `ssim` is the benchmark's (11x11 Gaussian window of sigma 1.5, as
/// torchmetrics has it), `ssim_uniform7` that of a 7x7 uniform window, as scikit-image has it. The PSNR of equal pictures is
/// infinite, which JSON writes as null.
#[derive(clap::Args)]
#[command(after_help = "Example:\n  relight compare truth.png rendering.png --json")]
pub struct Args {
    /// The reference.
    a: PathBuf,
    /// The other picture.
    b: PathBuf,
    /// One JSON object on standard output.
    #[arg(long)]
    json: bool,
}

#[derive(Serialize)]
struct Comparison {
    psnr: f64,
    ssim: f64,
    ssim_uniform7: f64,
}

pub fn run(args: &Args) -> anyhow::Result<()> {
    let (a, b) = (read_image(&args.a)?, read_image(&args.b)?);
    ensure!(
        (a.width, a.height) == (b.width, b.height),
        "{}: {}x{} pixels, but {} has {}x{}; only pictures of one size can be compared",
        args.b.display(),
        b.width,
        b.height,
        args.a.display(),
        a.width,
        a.height
    );
    let (truth, picture) = (&a.data, &b.data);
    let scored = || -> Result<Comparison, MetricError> {
        Ok(Comparison {
            psnr: psnr(picture, truth)?,
            ssim: ssim(picture, truth, a.width, a.height)?,
            ssim_uniform7: ssim_uniform7(picture, truth, a.width, a.height)?,
        })
    };
    let scores = scored().with_context(|| args.a.display().to_string())?;
    if args.json {
        return print_json(&scores);
    }
    print_line(&format!(
        "PSNR {:.2} dB, SSIM {:.4} (7x7 uniform window: {:.4})",
        scores.psnr, scores.ssim, scores.ssim_uniform7
    ))
}
