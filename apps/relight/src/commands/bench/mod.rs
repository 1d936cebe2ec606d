//! `relight bench`: the paper's two tables. One file a subcommand.

mod ablation;
mod benchmark;
mod display;
mod tables;
mod work;

use std::num::NonZeroUsize;
use std::path::PathBuf;

use relight_train::recipe::Preset;

use crate::commands::train::{positive, presets};
use crate::engines::Device;

/// Train and score whole tables: the paper's ablation, and its benchmark, on any scenes.
#[derive(clap::Args)]
pub struct Args {
    #[command(subcommand)]
    command: Command,
}

#[derive(clap::Subcommand)]
enum Command {
    Ablation(ablation::Args),
    Benchmark(benchmark::Args),
}

pub fn run(args: &Args, quiet: bool) -> anyhow::Result<()> {
    match &args.command {
        Command::Ablation(args) => ablation::run(args, quiet),
        Command::Benchmark(args) => benchmark::run(args, quiet),
    }
}

/// What both tables are told.
#[derive(clap::Args)]
struct Shared {
    /// Folders of scenes.
    #[arg(required = true)]
    scenes: Vec<PathBuf>,
    /// Folder for the tables and the runs, which are kept.
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// Minutes to train each for.
    #[arg(long, value_name = "F", value_parser = positive)]
    minutes: Option<f64>,
    /// Steps to train each for.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(1..))]
    steps: Option<u64>,
    /// Seeds to train each with; with several, tables hold means and standard deviations.
    #[arg(long, value_name = "N,…", value_delimiter = ',', default_value = "0")]
    seeds: Vec<u32>,
    /// How to train: `fast` is ours, `paper` the published recipe to the letter.
    #[arg(long, default_value = "fast", value_parser = presets())]
    preset: Preset,
    /// Settings to use instead of the preset's: a TOML file such as the table `recipe` of a run's config.toml.
    #[arg(long, value_name = "FILE.toml")]
    recipe: Option<PathBuf>,
    /// Where to train.
    #[arg(long, default_value = "auto")]
    device: Device,
    /// Trainings side by side. Without it: as many as there are cores and as fit into memory, but one where --minutes is
    /// given, since they slow each other.
    #[arg(long, value_name = "N")]
    jobs: Option<NonZeroUsize>,
}

/// What every help ends in.
const REMARKS: &str = "What is trained already is kept: the same command goes on after Ctrl-C or a kill, and more scenes, models or seeds \
     cost only what is new. A training that fails stops no other; the exit status is then 1. Black test images, as the official \
     release has them, are not scored. Without --steps and --minutes each trains until validation stops improving.";
