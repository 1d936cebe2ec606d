//! The command line of relight.

mod commands;
mod console;
mod engines;
mod places;
mod preparation;
mod stored_zip;

use std::process::ExitCode;

use clap::error::ErrorKind;
use clap::{Args, Parser, Subcommand};

use commands::{
    bench, capture, compare, demo, eval, export, profile, query, render, scene, serve, submit, train,
};

/// Most threads that may be asked for: each has buffers of its own, and beyond the cores that there are they bring nothing.
const MOST_THREADS: i64 = 1024;

/// Turns one-light-at-a-time photographs into a scene that can be seen and lit from anywhere.
///
/// A scene is a folder of photographs: many cameras, many lights, one light on at a time. Training makes a field of
/// it, and the field draws any view under any light.
#[derive(Parser)]
#[command(
    name = "relight",
    version,
    after_help = "Start here:\n  relight demo                                  capture a small scene, train on it, score it, relight it\n  \
                  relight scene check SCENE                     is my folder all right?\n  \
                  relight train SCENE --out RUN --minutes 10    train\n  \
                  relight eval RUN --split easy                 score\n  \
                  relight render RUN --path orbit --out a.mp4   look\n\n\
                  Results go to standard output, progress to standard error. The exit status is 0 if all that was asked \
                  was done, 1 after a failure, 2 after bad arguments."
)]
struct Cli {
    /// Say more: -v what is decided, -vv every detail.
    #[arg(short, long, action = clap::ArgAction::Count, global = true, display_order = 900)]
    verbose: u8,
    /// Say nothing but errors and results.
    #[arg(short, long, global = true, conflicts_with = "verbose", display_order = 900)]
    quiet: bool,
    /// Threads to work with; all cores without it. Results do not depend on it.
    #[arg(long, value_name = "N", global = true, display_order = 900,
          value_parser = clap::value_parser!(u16).range(1..=MOST_THREADS))]
    threads: Option<u16>,
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {
    Demo(demo::Args),
    Scene(scene::Args),
    Capture(capture::Args),
    Train(train::Args),
    Eval(eval::Args),
    Render(render::Args),
    Query(query::Args),
    Export(export::Args),
    Compare(compare::Args),
    Profile(profile::Args),
    Bench(bench::Args),
    Serve(serve::Args),
    Submit(submit::Args),
}

fn main() -> ExitCode {
    let cli = Cli::parse_from(capture::kinematics::join_numbers(std::env::args_os()));
    if let Command::Render(args) = &cli.command
        && let Err(error) = args.check()
    {
        let mut command = render::Args::augment_args(clap::Command::new("relight render"));
        command.error(ErrorKind::ValueValidation, error).exit();
    }
    let log = if let Command::Serve(args) = &cli.command { args.log() } else { console::Log::Plain };
    console::start_logging(cli.verbose, cli.quiet, log);
    match run(cli) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("error: {}", console::told_once(&error));
            ExitCode::FAILURE
        }
    }
}

fn run(cli: Cli) -> anyhow::Result<()> {
    if let Some(threads) = cli.threads {
        rayon::ThreadPoolBuilder::new().num_threads(threads.into()).build_global()?;
    }
    let quiet = cli.quiet;
    match cli.command {
        Command::Demo(args) => demo::run(&args, quiet),
        Command::Scene(args) => scene::run(&args, quiet),
        Command::Capture(args) => capture::run(&args, quiet),
        Command::Train(args) => train::run(&args, quiet),
        Command::Eval(args) => eval::run(&args, quiet),
        Command::Render(args) => render::run(&args, quiet),
        Command::Query(args) => query::run(&args),
        Command::Export(args) => export::run(&args),
        Command::Compare(args) => compare::run(&args),
        Command::Profile(args) => profile::run(&args, quiet),
        Command::Bench(args) => bench::run(&args, quiet),
        Command::Serve(args) => serve::run(&args, quiet),
        Command::Submit(args) => submit::run(&args, quiet),
    }
}

#[cfg(test)]
mod tests {
    use clap::CommandFactory;

    use super::*;

    /// Looks at a command and all below it but clap's own `help`; `is_taught`: whether one above it shows examples.
    fn look(command: &clap::Command, is_taught: bool) {
        let name = command.get_bin_name().unwrap_or_else(|| command.get_name());
        let help = command.clone().render_long_help().to_string();
        let is_taught = is_taught || help.contains("Example");
        assert!(help.contains("Usage: relight") && command.get_about().is_some(), "{name}: {help}");
        for argument in command.get_arguments() {
            assert!(argument.get_help().is_some(), "{name} explains {}", argument.get_id());
        }
        let mut below = command.get_subcommands().filter(|command| command.get_name() != "help").peekable();
        assert!(is_taught || below.peek().is_some(), "{name} shows no example: {help}");
        below.for_each(|command| look(command, is_taught));
    }

    #[test]
    fn the_help_of_every_command_teaches() {
        let mut cli = Cli::command();
        cli.build();
        look(&cli, false);
    }
}
