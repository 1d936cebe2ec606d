//! `relight capture`: plan, calibrate and shoot. One file a subcommand.

mod arms;
mod attendant;
mod board;
mod calibrate;
mod controller;
mod detect;
pub mod kinematics;
mod partition;
mod plan;
mod real_board;
mod run;
mod shoot_board;

/// Plan, calibrate and shoot a capture, on real robots or on the virtual rig.
#[derive(clap::Args)]
pub struct Args {
    #[command(subcommand)]
    command: Command,
}

#[derive(clap::Subcommand)]
enum Command {
    Run(run::Args),
    Plan(plan::Args),
    Partition(partition::Args),
    Kinematics(kinematics::Args),
    Board(board::Args),
    Detect(detect::Args),
    ShootBoard(shoot_board::Args),
    Calibrate(calibrate::Args),
    Controller(controller::Args),
}

pub fn run(args: &Args, quiet: bool) -> anyhow::Result<()> {
    match &args.command {
        Command::Run(args) => run::run(args, quiet),
        Command::Plan(args) => plan::run(args),
        Command::Partition(args) => partition::run(args),
        Command::Kinematics(args) => kinematics::run(args),
        Command::Board(args) => board::run(args),
        Command::Detect(args) => detect::run(args),
        Command::ShootBoard(args) => shoot_board::run(args, quiet),
        Command::Calibrate(args) => calibrate::run(args, quiet),
        Command::Controller(args) => controller::run(args),
    }
}
