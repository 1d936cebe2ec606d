//! `relight eval`: scores of a run.

use std::fs;
use std::path::PathBuf;

use anyhow::bail;
use clap::builder::{PossibleValuesParser, TypedValueParser};
use relight_scene::{Split, Splits};
use relight_train::TrainError;
use relight_train::baselines::mean_image;
use relight_train::evaluation::{Drawn, Evaluation, Scores, evaluate};
use relight_train::run::RunFolder;

use super::render::settings;
use crate::console::{Progress, cancel_flag, counted, print_json, print_line, unless};
use crate::preparation::{check_splits, open_scene};
use crate::{engines, places};

/// Score a trained run on images that it has not seen.
///
/// Draws each image of the split and compares it with the photograph: PSNR and SSIM (11x11 Gaussian window) of the
/// 8-bit pictures, averaged over images. Two baselines that learn nothing stand beside: the mean of all training
/// images, and the image of the nearest training camera under the nearest training light.
#[derive(clap::Args)]
#[command(after_help = "Examples:\n  relight eval RUN                              the validation split\n  \
                  relight eval RUN --split hard --json          unseen cameras under unseen lights\n  \
                  relight eval RUN --split easy --images DIR    keep the pictures\n\n\
                  Scores at reduced resolution are higher than at full resolution: never compare the two.")]
pub struct Args {
    /// Folder of a trained run.
    run: PathBuf,
    /// val (held-out images of training cameras), easy (unseen cameras), hard (unseen cameras and lights).
    #[arg(long, default_value = "val", value_parser = splits())]
    split: Split,
    /// Folder of the scene, where it is not where it was.
    #[arg(long)]
    scene: Option<PathBuf>,
    /// Folder for the pictures, named {scene}_{light}_{camera}.png.
    #[arg(long, value_name = "DIR")]
    images: Option<PathBuf>,
    /// Samples a ray, for each thing that it looks at; the engine chooses without it.
    #[arg(long, value_parser = clap::value_parser!(u32).range(2..=4096))]
    samples: Option<u32>,
    /// One JSON object on standard output.
    #[arg(long)]
    json: bool,
}

/// The splits that may be scored; what was learnt from is none.
fn splits() -> impl TypedValueParser<Value = Split> {
    PossibleValuesParser::new(["val", "easy", "hard"]).try_map(|name| name.parse::<Split>())
}

pub fn run(args: &Args, quiet: bool) -> anyhow::Result<()> {
    if let Some(folder) = &args.images {
        places::check_folder(folder)?;
    }
    let (run, config) = RunFolder::open(&args.run)?;
    let scene = open_scene(args.scene.as_deref(), &run, &config)?;
    let splits = Splits::of(&scene)?;
    check_splits(&scene, &splits, &config)?;
    let engine = engines::of_run(&run, &config)?;
    if let Some(folder) = &args.images {
        fs::create_dir_all(folder).map_err(|source| TrainError::Io { path: folder.clone(), source })?;
    }
    let cancel = cancel_flag()?;
    let bar = Progress::new("averaging", splits.train.len() as u64, quiet);
    let mean = mean_image(&scene, &splits.train, &|done, all| {
        bar.count(done, all, "training images");
        unless(cancel)
    })?;
    bar.clear();
    let bar = Progress::new("scoring", splits.get(args.split).len() as u64, quiet);
    let (mean, model) = (mean.as_ref(), &config.model);
    let settings = settings(args.samples);
    let engine = (engine.as_ref(), &settings);
    let result = evaluate(&scene, &splits, args.split, mean, model, engine, &mut |drawn| {
        let Drawn { done, all, .. } = drawn;
        bar.count(done, all, "images");
        if let Some(folder) = &args.images {
            let frame = &scene.frames[drawn.frame];
            let (light, camera) = (scene.lights[frame.light].label, scene.cameras[frame.camera].label);
            let name = format!("{}_{light:02}_{camera:02}.png", scene.name);
            drawn.image.write_png(&folder.join(name))?;
        }
        Ok(unless(cancel))
    })?;
    let Some(scores) = result else { bail!("stopped before all images were scored") };
    bar.finish(&format!("{} scored", counted(scores.images.len(), "image")));
    if args.json { print_json(&scores) } else { print_line(&table(&scores)) }
}

/// The scores as a table for people.
fn table(scores: &Evaluation) -> String {
    let row = |name: &str, s: Option<Scores>| match s {
        Some(s) => format!("{name:<14} {:>6.2} dB  {:.4}", s.psnr, s.ssim),
        None => format!("{name:<14} does not apply to this scene"),
    };
    [
        format!("{}, split {}, {}", scores.scene, scores.split, counted(scores.images.len(), "image")),
        format!("{:<14} {:>9}  {}", "", "PSNR", "SSIM"),
        row(&scores.model, Some(scores.mean)),
        row("mean-image", scores.baselines.mean_image),
        row("nearest-light", scores.baselines.nearest_light),
    ]
    .join("\n")
}
