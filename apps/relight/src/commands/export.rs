//! `relight export`: the weights of a run as one file.

use std::path::PathBuf;

use relight_field::weights_file;
use relight_train::run::RunFolder;

use crate::{engines, places};

/// Write the weights of a run to a safetensors file.
///
/// The names, shapes and conventions of the tensors are in docs/formats.md; other programs can load them.
#[derive(clap::Args)]
#[command(after_help = "Example:\n  relight export RUN --weights cube.safetensors")]
pub struct Args {
    /// Folder of a trained run.
    run: PathBuf,
    /// File to write.
    #[arg(long, value_name = "FILE.safetensors")]
    weights: PathBuf,
}

pub fn run(args: &Args) -> anyhow::Result<()> {
    places::check_file(&args.weights)?;
    let (run, config) = RunFolder::open(&args.run)?;
    weights_file::save(&engines::weights(&run, &config)?, &args.weights)?;
    Ok(())
}
