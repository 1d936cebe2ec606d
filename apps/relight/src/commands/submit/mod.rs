//! `relight submit`: take part in a benchmark. One file a subcommand.

mod check;
mod pack;
mod send;

/// Take part in a benchmark: pack the test images of trained runs, check the zip, send it.
#[derive(clap::Args)]
#[command(
    after_help = "Example:\n  relight submit pack runs/* --out entry.zip\n  relight submit check entry.zip --scenes SCENES\n  \
                  relight submit send entry.zip --to https://bench.example.org --benchmark rene --method \"My method\" --wait\n\n\
                  The token is read from RELIGHT_TOKEN, or given as --token."
)]
pub struct Args {
    #[command(subcommand)]
    command: Command,
}

#[derive(clap::Subcommand)]
enum Command {
    Pack(pack::Args),
    Check(check::Args),
    Send(Box<send::Args>),
}

pub fn run(args: &Args, quiet: bool) -> anyhow::Result<()> {
    match &args.command {
        Command::Pack(args) => pack::run(args, quiet),
        Command::Check(args) => check::run(args, quiet),
        Command::Send(args) => send::run(args, quiet),
    }
}
