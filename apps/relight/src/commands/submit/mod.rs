//! `relight submit`: take part in a benchmark. One file a subcommand.

mod check;
mod client;
mod pack;
mod send;
mod verify;

/// Take part in a benchmark: pack the test images of trained runs, check the zip, send it, verify the receipt.
#[derive(clap::Args)]
#[command(
    after_help = "Example:\n  relight submit pack runs/* --out entry.zip\n  relight submit check entry.zip --scenes SCENES\n  \
                  relight submit send entry.zip --to https://bench.example.org --benchmark rene --method \"My method\" --wait\n  \
                  relight submit verify receipt.json --from https://bench.example.org --zip entry.zip\n\n\
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
    Verify(verify::Args),
}

pub fn run(args: &Args, quiet: bool) -> anyhow::Result<()> {
    match &args.command {
        Command::Pack(args) => pack::run(args, quiet),
        Command::Check(args) => check::run(args, quiet),
        Command::Send(args) => send::run(args, quiet),
        Command::Verify(args) => verify::run(args),
    }
}
