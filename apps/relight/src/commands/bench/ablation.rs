//! `relight bench ablation`: what each change of the architecture brings.

use relight_bench::Kind;
use relight_field::architecture::VARIANTS;

use super::{REMARKS, Shared, tables};

/// Train the models V0 to V5 on scenes, and table what each change of the architecture brings.
///
/// Leaves in DIR ablation.md, .tex, .csv, .json and .html (with pictures), written anew after each training, and the runs. Scores
/// are on validation, as the paper has them, and on easy and hard, with two baselines that learn nothing; for official scenes at
/// full size the published figures stand beside them.
#[derive(clap::Args)]
#[command(after_help = format!(
    "Examples:\n  relight bench ablation scenes/cube scenes/savannah --out tables --minutes 10\n  \
     relight bench ablation scenes/cube --out tables --models v1,v5 --steps 20000 --seeds 0,1,2\n\n{REMARKS}"
))]
pub struct Args {
    #[command(flatten)]
    shared: Shared,
    /// Models to compare. [default: all six]
    #[arg(long, value_name = "NAME,…", value_delimiter = ',', value_parser = VARIANTS.map(|(name, _)| name), ignore_case = true)]
    models: Vec<String>,
}

pub fn run(args: &Args, quiet: bool) -> anyhow::Result<()> {
    let all = || VARIANTS.map(|(name, _)| name.to_owned()).into();
    let models = if args.models.is_empty() { all() } else { args.models.clone() };
    tables::make(Kind::Ablation, &args.shared, &models, quiet)
}
