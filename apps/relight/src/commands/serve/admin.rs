//! `relight serve admin`: what admins do to a server's data, whether or not it is running.

use std::io::Read;
use std::num::ParseIntError;
use std::path::PathBuf;
use std::str::FromStr;

use anyhow::{Context, ensure};
use relight_server::accounts;
use relight_server::admin::add_benchmark;
use relight_server::backup::{backup, restore};
use relight_server::data_folder::DataFolder;
use relight_server::method::Phase;
use relight_server::retention::{Pruned, prune};
use relight_server::store::{
    BenchmarkEntry, Listing, Quota, SignUpPolicy, State, Store, SubmissionEntry, UserStatus,
};
use relight_server::time::Time;
use serde_json::json;

use super::baselines;
use crate::console::{Progress, cancel_flag, print_json, print_line, unless};
use crate::places::check_file;

/// Add benchmarks and users, set quotas, moderate, back up.
///
/// All but `restore` work while the server runs, which sees the change at once.
#[derive(clap::Args)]
#[command(after_help = "Examples:\n  relight serve admin --data board add-benchmark rene SCENES\n  \
                  relight serve admin --data board add-user ada ada@example.org\n  \
                  relight serve admin --data board quotas rene --phase test --per-day 2 --total 20 --gap 3600\n  \
                  relight serve admin --data board list\n  \
                  relight serve admin --data board hide 4f0c93d2a1b87e55\n  \
                  relight serve admin --data board backup board.tar")]
pub struct Args {
    /// The server's folder.
    #[arg(long, value_name = "DIR")]
    data: PathBuf,
    #[command(subcommand)]
    command: Command,
}

#[derive(clap::Subcommand)]
enum Command {
    /// Add a benchmark: a folder of scenes with their test images. The folder stays where it is.
    AddBenchmark {
        /// Its name: small letters, digits, hyphens.
        name: String,
        /// Folder of scenes.
        folder: PathBuf,
    },
    /// Enter two baselines that learn nothing, and pin them: the mean of all training images of a scene, and the training image of
    /// the nearest camera under the nearest light. The server scores them like all others.
    AddBaselines {
        /// The benchmark.
        benchmark: String,
    },
    /// List the benchmarks with their quotas.
    Benchmarks,
    /// Take submissions to a benchmark again.
    Open {
        /// The benchmark.
        benchmark: String,
    },
    /// Take no more submissions to a benchmark; its pages stay.
    Close {
        /// The benchmark.
        benchmark: String,
    },
    /// Show or set how often a user may submit. Refused submissions never count.
    Quotas {
        /// The benchmark.
        benchmark: String,
        /// val (validation images, whose truth is public) or test (hidden images).
        #[arg(long, default_value = "test")]
        phase: Phase,
        /// Submissions within any 24 hours.
        #[arg(long, value_name = "N")]
        per_day: Option<u32>,
        /// Submissions in all.
        #[arg(long, value_name = "N")]
        total: Option<u32>,
        /// Seconds between two submissions.
        #[arg(long, value_name = "SECONDS")]
        gap: Option<u32>,
    },
    /// Add a user, and print a token for submitting. It is never shown again.
    AddUser {
        /// Name, shown beside public entries.
        name: String,
        /// E-mail address.
        email: String,
    },
    /// List the users.
    Users,
    /// Print a further token for a user.
    AddToken {
        /// The user.
        user: String,
        /// What to call it.
        #[arg(long, default_value = "made by an admin")]
        name: String,
    },
    /// Give a user a password, read from standard input.
    SetPassword {
        /// The user.
        user: String,
    },
    /// Let a user submit who signed up where admins approve, or who was blocked.
    Approve {
        /// The user.
        user: String,
    },
    /// Let a user do nothing any more.
    Block {
        /// The user.
        user: String,
    },
    /// Let a user see and use the pages for admins, /admin: benchmarks, quotas, moderation, the audit log.
    GrantAdmin {
        /// The user.
        user: String,
    },
    /// Take that from a user.
    RevokeAdmin {
        /// The user.
        user: String,
    },
    /// Whether people make accounts for themselves: open, approval (an admin must approve each) or closed.
    SignUp {
        /// The policy; shown if left out.
        policy: Option<SignUpPolicy>,
    },
    /// List the submissions, newest first.
    List {
        /// One JSON object on standard output.
        #[arg(long)]
        json: bool,
    },
    /// Hide a submission from all but its user.
    Hide {
        /// The submission.
        submission: String,
    },
    /// Show a hidden submission again.
    Show {
        /// The submission.
        submission: String,
    },
    /// Pin a submission as a baseline.
    Pin {
        /// The submission.
        submission: String,
    },
    /// Unpin a submission.
    Unpin {
        /// The submission.
        submission: String,
    },
    /// Withdraw a submission for its user. There is no way back.
    Withdraw {
        /// The submission.
        submission: String,
    },
    /// How many days after their scores zips are kept: a number, or all. The server looks every hour.
    KeepZips {
        /// Days, or all; shown if left out.
        days: Option<Kept>,
    },
    /// Remove now the zips that need be kept no longer. Scores, receipts and pictures stay.
    Prune,
    /// Show who did what, newest first.
    Audit {
        /// Lines to show.
        #[arg(long, value_name = "N", default_value = "100")]
        last: u32,
        /// One JSON object a line on standard output.
        #[arg(long)]
        json: bool,
    },
    /// Write all that the server knows, but for the ground truth, to one tar file.
    Backup {
        /// The file.
        file: PathBuf,
        /// Leave out the zips of submissions that have scores.
        #[arg(long)]
        without_zips: bool,
    },
    /// Make the folder --data, which must not exist or be empty, from a backup.
    Restore {
        /// The backup.
        file: PathBuf,
    },
}

/// Days that zips are kept; all of them if `None`.
#[derive(Clone, Copy)]
struct Kept(Option<u32>);

impl FromStr for Kept {
    type Err = ParseIntError;

    fn from_str(text: &str) -> Result<Kept, ParseIntError> {
        if text == "all" { Ok(Kept(None)) } else { text.parse().map(|days| Kept(Some(days))) }
    }
}

pub async fn run(args: &Args, quiet: bool) -> anyhow::Result<()> {
    if let Command::Restore { file } = &args.command {
        let files = restore(file, &args.data).await?;
        return print_line(&format!("{}: restored, {files} files", args.data.display()));
    }
    if let Command::AddBaselines { benchmark } = &args.command {
        DataFolder::open(&args.data)?;
        return baselines::enter(&args.data, benchmark, quiet).await;
    }
    // These two begin a server's data; the others have nothing to do where there is none.
    let begins = matches!(args.command, Command::AddBenchmark { .. } | Command::AddUser { .. });
    let folder = if begins { DataFolder::create(&args.data) } else { DataFolder::open(&args.data) }?;
    let store = Store::open(&folder.database()).await?;
    let done = run_on(&args.command, &folder, &store, quiet).await;
    store.close().await;
    done
}

async fn run_on(command: &Command, folder: &DataFolder, store: &Store, quiet: bool) -> anyhow::Result<()> {
    match command {
        Command::AddBenchmark { name, folder } => {
            let bar = Progress::new("checking", 0, quiet);
            let cancel = cancel_flag()?;
            let scenes = add_benchmark(store, name, folder, &mut |progress| {
                bar.count(progress.done, progress.all, "test images");
                unless(cancel)
            })
            .await?;
            bar.clear();
            let images: usize = scenes.iter().map(|scene| scene.val + scene.easy + scene.hard).sum();
            print_line(&format!("{name}: added, {} scenes, {images} test images", scenes.len()))
        }
        Command::Benchmarks => {
            for benchmark in store.benchmarks().await? {
                print_line(&benchmark_lines(&benchmark))?;
            }
            Ok(())
        }
        Command::AddBaselines { .. } | Command::Restore { .. } => Ok(()),
        Command::Open { benchmark } => Ok(store.set_open(benchmark, true, "admin").await?),
        Command::Close { benchmark } => Ok(store.set_open(benchmark, false, "admin").await?),
        Command::Quotas { benchmark, phase, per_day, total, gap } => {
            let old = store.benchmark(benchmark).await?.quota(*phase);
            if per_day.or(*total).or(*gap).is_some() {
                let quota = Quota {
                    per_day: per_day.unwrap_or(old.per_day),
                    total: total.unwrap_or(old.total),
                    gap_seconds: gap.unwrap_or(old.gap_seconds),
                };
                store.set_quota(benchmark, *phase, quota, "admin").await?;
            }
            print_line(&benchmark_lines(&store.benchmark(benchmark).await?))
        }
        Command::AddUser { name, email } => print_line(&accounts::add_user(store, name, email).await?.1),
        Command::Users => {
            for user in store.users().await? {
                print_line(&format!(
                    "{:<8} {} <{}>, since {}{}",
                    user.status,
                    user.name,
                    user.email,
                    user.created_at,
                    if user.is_admin { ", admin" } else { "" }
                ))?;
            }
            Ok(())
        }
        Command::AddToken { user, name } => {
            let user = store.user(user).await?;
            print_line(&accounts::new_token(store, &user, name, "admin").await?)
        }
        Command::SetPassword { user } => {
            let user = store.user(user).await?;
            let mut password = String::new();
            std::io::stdin().take(10_000).read_to_string(&mut password).context("standard input")?;
            ensure!(!password.is_empty(), "give the password on standard input");
            Ok(accounts::set_password(store, &user, password.trim_end_matches(['\r', '\n']), "admin").await?)
        }
        Command::Approve { user } => Ok(store.set_user_status(user, UserStatus::Active).await?),
        Command::Block { user } => Ok(store.set_user_status(user, UserStatus::Blocked).await?),
        Command::GrantAdmin { user } => Ok(store.set_admin(user, true).await?),
        Command::RevokeAdmin { user } => Ok(store.set_admin(user, false).await?),
        Command::SignUp { policy } => {
            if let Some(policy) = policy {
                store.set_sign_up_policy(*policy).await?;
            }
            print_line(store.sign_up_policy().await?.as_str())
        }
        Command::List { json } => list(&store.submissions(Listing::All).await?, *json),
        Command::Hide { submission } => Ok(store.set_hidden(submission, true, "admin").await?),
        Command::Show { submission } => Ok(store.set_hidden(submission, false, "admin").await?),
        Command::Pin { submission } => Ok(store.set_pinned(submission, true).await?),
        Command::Unpin { submission } => Ok(store.set_pinned(submission, false).await?),
        Command::Withdraw { submission } => {
            store.withdraw(submission, None, "admin", Time::now()).await?;
            // Of what is being scored the server needs the zip, and removes it afterwards.
            match store.submission(submission).await?.state {
                State::Scoring => Ok(()),
                _ => Ok(folder.forget(submission)?),
            }
        }
        Command::KeepZips { days } => {
            if let Some(Kept(days)) = days {
                store.set_zip_days(*days).await?;
            }
            let days = store.zip_days().await?;
            print_line(&days.map_or_else(|| "all".to_owned(), |days| format!("{days} days")))
        }
        Command::Prune => {
            let Pruned { zips, bytes } = prune(folder, store, "admin", Time::now()).await?;
            print_line(&format!("{zips} zips removed, {} MB", bytes / 1_000_000))
        }
        Command::Audit { last, json } => {
            for entry in store.audit(*last).await? {
                if *json {
                    print_json(&entry)?;
                } else {
                    let (at, actor, action) = (entry.at, &entry.actor, &entry.action);
                    print_line(
                        format!("{at}  {actor}: {action} {} {}", entry.subject, entry.detail).trim_end(),
                    )?;
                }
            }
            Ok(())
        }
        Command::Backup { file, without_zips } => {
            check_file(file)?;
            let files = backup(folder, store, file, !without_zips).await?;
            print_line(&format!("{}: {files} files", file.display()))
        }
    }
}

fn benchmark_lines(benchmark: &BenchmarkEntry) -> String {
    let quota = |phase: Phase| {
        let Quota { per_day, total, gap_seconds } = benchmark.quota(phase);
        format!("{phase}: {per_day} a day, {total} in all, {gap_seconds} s apart")
    };
    let state = if benchmark.open { "open" } else { "closed" };
    format!(
        "{}: {state}, {} scenes in {}\n  {}\n  {}",
        benchmark.name,
        benchmark.scenes.len(),
        benchmark.folder.display(),
        quota(Phase::Val),
        quota(Phase::Test)
    )
}

fn list(entries: &[SubmissionEntry], as_json: bool) -> anyhow::Result<()> {
    if as_json {
        let entries: Vec<_> = entries
            .iter()
            .map(|entry| {
                json!({
                    "id": entry.id, "benchmark": entry.benchmark, "user": entry.user_name, "phase": entry.phase,
                    "visibility": entry.visibility, "method": entry.method, "state": entry.state,
                    "submitted_at": entry.submitted_at, "finished_at": entry.finished_at, "reason": entry.reason,
                    "sha256": entry.sha256, "bytes": entry.bytes, "hidden": entry.hidden, "pinned": entry.pinned,
                    "withdrawn_at": entry.withdrawn_at,
                })
            })
            .collect();
        return print_json(&json!({ "submissions": entries }));
    }
    for entry in entries {
        let marks: String = [
            (entry.hidden, " hidden"),
            (entry.pinned, " pinned"),
            (entry.withdrawn_at.is_some(), " withdrawn"),
        ]
        .iter()
        .filter(|(is_so, _)| *is_so)
        .map(|(_, mark)| *mark)
        .collect();
        print_line(&format!(
            "{}  {}  {:<7}  {}, {}, {} by {} ({}){marks}{}",
            entry.id,
            entry.submitted_at,
            entry.state,
            entry.benchmark,
            entry.phase,
            entry.method.name,
            entry.user_name,
            entry.visibility,
            entry.reason.as_ref().map(|reason| format!(": {reason}")).unwrap_or_default()
        ))?;
    }
    Ok(())
}
