//! `relight bench benchmark`: every scene, on easy and hard.

use relight_bench::Kind;
use relight_field::architecture::VARIANTS;

use super::{REMARKS, Shared, tables};

/// Train a model on every scene, and table its scores on easy and hard.
///
/// Leaves in DIR benchmark.md, .tex, .csv, .json and .html (with pictures), written anew after each training, and the runs. Two
/// baselines that learn nothing are beside each scene's scores; for official scenes at full size the published figures are too.
#[derive(clap::Args)]
#[command(after_help = format!(
    "Examples:\n  relight bench benchmark scenes/* --out tables --minutes 30\n  \
     relight bench benchmark scenes/* --out tables --minutes 30 --models v5,v0    as the paper has it\n\n{REMARKS}"
))]
pub struct Args {
    #[command(flatten)]
    shared: Shared,
    /// Models to score.
    #[arg(long, value_name = "NAME,…", value_delimiter = ',', default_value = "v5", value_parser = VARIANTS.map(|(name, _)| name), ignore_case = true)]
    models: Vec<String>,
}

pub fn run(args: &Args, quiet: bool) -> anyhow::Result<()> {
    tables::make(Kind::Benchmark, &args.shared, &args.models, quiet)
}
