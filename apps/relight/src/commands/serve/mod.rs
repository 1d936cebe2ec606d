//! `relight serve`: the benchmark server. Admins' commands are in `admin`.

mod admin;
mod baselines;

use std::net::SocketAddr;
use std::num::{NonZeroU32, NonZeroU64};
use std::path::PathBuf;
use std::sync::atomic::Ordering;
use std::time::Duration;

use anyhow::Context;
use relight_server::app::Settings;
use relight_server::server::serve;
use relight_server::submission::Limits;
use relight_server::worker::{self, Scorer};

use crate::console::{Log, cancel_flag, print_line};

/// How often Ctrl-C is looked for.
const LOOK: Duration = Duration::from_millis(50);

/// Host a benchmark: leaderboard, submissions, scoring.
///
/// Needs nothing but a folder for its data. Benchmarks and users are added by `relight serve admin`, also while it runs.
/// Ctrl-C or SIGTERM stops it: requests are answered first, and what is being scored goes on at the next start. It speaks
/// plain HTTP: put a reverse proxy with TLS before it where others can reach it (docs/benchmark.md shows one).
#[derive(clap::Args)]
#[command(
    args_conflicts_with_subcommands = true,
    subcommand_negates_reqs = true,
    after_help = "Example, from nothing to a benchmark:\n  \
                  relight serve admin --data board add-benchmark rene SCENES\n  \
                  relight serve admin --data board add-user ada ada@example.org      prints her token once\n  \
                  relight serve --data board --listen 127.0.0.1:8080"
)]
pub struct Args {
    /// Folder for all that the server keeps.
    #[arg(long, value_name = "DIR", required = true)]
    data: Option<PathBuf>,
    /// Address to listen at; port 0 takes any free one. It is printed.
    #[arg(long, value_name = "ADDR", default_value = "127.0.0.1:8080")]
    listen: SocketAddr,
    /// All requests come through a proxy that sets X-Forwarded-For: take clients' addresses from there.
    #[arg(long)]
    behind_proxy: bool,
    /// Requests a second that one client may make.
    #[arg(long, value_name = "N", default_value = "5000")]
    requests_per_second: NonZeroU32,
    /// The longest zip, MiB.
    #[arg(long, value_name = "MIB", default_value = "16384")]
    zip_mib: NonZeroU64,
    /// Memory of the process that scores, MiB.
    #[arg(long, value_name = "MIB", default_value = "4096")]
    scoring_mib: NonZeroU64,
    /// The longest that scoring a submission may take, minutes.
    #[arg(long, value_name = "N", default_value = "60")]
    scoring_minutes: NonZeroU64,
    /// Log one JSON object a line, for programs that collect logs.
    #[arg(long)]
    log_json: bool,
    #[command(subcommand)]
    command: Option<Command>,
}

#[derive(clap::Subcommand)]
enum Command {
    Admin(admin::Args),
    /// What the server starts to score one submission.
    #[command(hide = true)]
    ScoreOne {
        /// The job, JSON.
        job: String,
    },
}

impl Args {
    /// The log of what runs: the server itself, or something else.
    pub fn log(&self) -> Log {
        match (&self.command, self.log_json) {
            (Some(_), _) => Log::Plain,
            (None, false) => Log::Timed,
            (None, true) => Log::Json,
        }
    }
}

pub fn run(args: &Args, quiet: bool) -> anyhow::Result<()> {
    match &args.command {
        Some(Command::Admin(args)) => runtime()?.block_on(admin::run(args, quiet)),
        Some(Command::ScoreOne { job }) => worker::run(job).context("nobody asks for the scores any more"),
        None => run_server(args),
    }
}

fn runtime() -> anyhow::Result<tokio::runtime::Runtime> {
    tokio::runtime::Builder::new_multi_thread().enable_all().build().context("threads cannot be started")
}

fn run_server(args: &Args) -> anyhow::Result<()> {
    let data = args.data.as_ref().context("name a folder: --data DIR")?;
    let settings = Settings {
        behind_proxy: args.behind_proxy,
        requests_per_second: args.requests_per_second,
        limits: Limits { zip_bytes: args.zip_mib.get().saturating_mul(1 << 20), ..Limits::default() },
        scoring_memory: args.scoring_mib.get().saturating_mul(1 << 20),
        scoring_time: Duration::from_secs(args.scoring_minutes.get().saturating_mul(60)),
    };
    let scorer = Scorer {
        program: std::env::current_exe().context("where this program is cannot be found out")?,
        arguments: ["serve", "score-one"].map(str::to_owned).into(),
    };
    let flag = cancel_flag()?;
    let stop = async {
        while !flag.load(Ordering::Relaxed) {
            tokio::time::sleep(LOOK).await;
        }
    };
    let ready = |address| {
        // Scripts read the address from here; a server whose output is closed serves all the same.
        let _ = print_line(&format!("http://{address}"));
    };
    runtime()?.block_on(serve(data, settings, scorer, args.listen, ready, stop))?;
    Ok(())
}
