//! Scoring: one submission after another, and validation beside them, each in a child process with limits on memory and time, and with low priority.
//!
//! Zips come from anywhere, and the server itself never looks into one. Whatever happens to the child, the server goes on,
//! and a submission is lost or scored twice by no kill of either: see [`crate::store`] for the queue's states.

mod child;
mod job;
pub mod pictures;

use std::path::PathBuf;
use std::process::Stdio;
use std::sync::atomic::Ordering;
use std::time::{Duration, Instant};

use tokio::io::{AsyncBufReadExt, AsyncReadExt, BufReader};
use tokio::process::{Child, ChildStdout, Command};
use tokio::sync::watch;

pub use child::run;
pub use job::{Job, Report};

use crate::Progress;
use crate::app::AppState;
use crate::data_folder::{FolderError, io_at, remove};
use crate::disclosure::tell;
use crate::receipt::Receipt;
use crate::scoring::Scores;
use crate::store::{Claim, StoreError, Verdict};
use crate::time::Time;

/// How long the queue is left alone when it is empty and nobody has told of a submission.
const IDLE: Duration = Duration::from_secs(1);
/// How long after a failure that is not the submission's fault, the first time; twice as long each further time.
const WAIT: Duration = Duration::from_secs(10);
/// The longest wait, as a power of two of [`WAIT`].
const LONGEST_WAIT: u32 = 8;
/// How often a submission may end its child process.
const CRASHES: u32 = 2;
/// The longest report of a child, bytes.
const REPORT: u64 = 1 << 28;

/// The program that scores: this one, with the arguments that make it read a [`Job`] from one further argument.
#[derive(Clone, Debug)]
pub struct Scorer {
    /// The program.
    pub program: PathBuf,
    /// Arguments before the job.
    pub arguments: Vec<String>,
}

/// How scoring in a child process ended.
enum Ended {
    /// With scores.
    Scored(Box<Scores>),
    /// The submission is none.
    Refused(Verdict),
    /// Something else failed; the submission is not at fault.
    Failed(String),
    /// The child died, or took too long: the submission may be at fault.
    Crashed(String),
    /// The server stops.
    Stopped,
}

/// Scores what is in the queue until `stop` turns true: one after the other, and beside that validation, which is promised at once
/// and shall not wait for hidden splits.
pub(crate) async fn score_queue(app: AppState, scorer: Scorer, stop: watch::Receiver<bool>) {
    tokio::join!(
        score_in_turn(&app, &scorer, stop.clone(), false),
        score_in_turn(&app, &scorer, stop.clone(), true),
    );
}

async fn score_in_turn(
    app: &AppState,
    scorer: &Scorer,
    mut stop: watch::Receiver<bool>,
    only_validation: bool,
) {
    while !*stop.borrow() {
        // From now on, so that nothing comes in unheard between the look and the wait.
        let mut told = std::pin::pin!(app.wake.notified());
        told.as_mut().enable();
        match app.store.claim(only_validation, Time::now()).await {
            Ok(Some(claim)) => {
                let first = Progress { done: 0, all: 1 };
                app.set_progress(&claim.id, Some(first));
                if let Err(error) = score_one(app, scorer, &claim, &mut stop).await {
                    tracing::error!(submission = claim.id, %error, "its verdict was not written; it is scored again");
                    put_back(app, &claim, None).await;
                }
                app.set_progress(&claim.id, None);
            }
            Ok(None) => {
                tokio::select! {
                    () = told => {}
                    () = tokio::time::sleep(IDLE) => {}
                    _ = stop.changed() => {}
                }
            }
            Err(error) => {
                tracing::error!(%error, "the queue cannot be read");
                tokio::time::sleep(WAIT).await;
            }
        }
    }
}

/// Scores a submission and writes down what became of it.
async fn score_one(
    app: &AppState,
    scorer: &Scorer,
    claim: &Claim,
    stop: &mut watch::Receiver<bool>,
) -> Result<(), WorkerError> {
    let begun = Instant::now();
    // A name of its own: the scorer of a server that was killed may still write into the folder that it was given.
    let scoring = app.folder.scoring();
    let scratch = tempfile::tempdir_in(&scoring).map_err(io_at(&scoring))?;
    let pictures = scratch.path().join("pictures");
    let ended = score_in_child(app, scorer, claim, &pictures, stop).await;
    let milliseconds = u64::try_from(begun.elapsed().as_millis()).unwrap_or(u64::MAX);
    app.metrics.scoring_milliseconds.fetch_add(milliseconds, Ordering::Relaxed);
    let verdict = match ended {
        Ended::Scored(scores) => scored(app, claim, scores, &pictures).await?,
        Ended::Refused(verdict) => verdict,
        Ended::Crashed(why) if claim.failures + 1 >= CRASHES => Verdict::Refused {
            reason: format!("it cannot be scored within the server's limits: {why}"),
            problems: None,
        },
        Ended::Crashed(why) => {
            failed(app, claim, &why, Duration::ZERO).await;
            return Ok(());
        }
        Ended::Failed(why) => {
            failed(app, claim, &why, WAIT * 2u32.pow(claim.failures.min(LONGEST_WAIT))).await;
            return Ok(());
        }
        Ended::Stopped => {
            put_back(app, claim, None).await;
            return Ok(());
        }
    };
    let now = Time::now();
    app.store.finish(&claim.id, &verdict, now).await?;
    let entry = app.store.submission(&claim.id).await?;
    match &verdict {
        Verdict::Scored { .. } => {
            app.metrics.scored.fetch_add(1, Ordering::Relaxed);
            tracing::info!(submission = claim.id, milliseconds, "scored");
        }
        Verdict::Refused { reason, .. } => {
            app.metrics.refused.fetch_add(1, Ordering::Relaxed);
            tracing::info!(submission = claim.id, milliseconds, reason, "refused");
        }
    }
    if matches!(verdict, Verdict::Refused { .. }) || entry.withdrawn_at.is_some() {
        app.folder.forget(&claim.id)?;
    }
    Ok(())
}

/// The verdict for scores: moves the pictures to their place and signs the receipt.
async fn scored(
    app: &AppState,
    claim: &Claim,
    scores: Box<Scores>,
    pictures: &std::path::Path,
) -> Result<Verdict, WorkerError> {
    if pictures.is_dir() {
        let place = app.folder.pictures_of(&claim.id);
        remove(&place)?;
        std::fs::rename(pictures, &place).map_err(io_at(&place))?;
    }
    let entry = app.store.submission(&claim.id).await?;
    let receipt = app.key.sign(Receipt {
        format: String::new(),
        submission: entry.id,
        benchmark: entry.benchmark,
        method: entry.method.name,
        sha256: entry.sha256,
        submitted_at: entry.submitted_at.to_string(),
        scored_at: Time::now().to_string(),
        evaluator: scores.evaluator.clone(),
        scores: tell(&scores),
        public_key: String::new(),
        signature: String::new(),
    });
    Ok(Verdict::Scored { scores, receipt: Box::new(receipt), phase: claim.phase })
}

/// Runs the child process to its end, or to the end of its time.
async fn score_in_child(
    app: &AppState,
    scorer: &Scorer,
    claim: &Claim,
    pictures: &std::path::Path,
    stop: &mut watch::Receiver<bool>,
) -> Ended {
    let zip = app.folder.zip(&claim.id);
    if !zip.is_file() {
        let reason =
            "its zip is lost: it was not in the backup that this server was restored from".to_owned();
        return Ended::Refused(Verdict::Refused { reason, problems: None });
    }
    let job = Job {
        zip,
        benchmark: claim.benchmark.folder.clone(),
        phase: claim.phase,
        sha256: claim.sha256.clone(),
        pictures: pictures.to_owned(),
        memory: app.settings.scoring_memory,
        zip_bytes: app.settings.limits.zip_bytes,
        server: std::process::id(),
    };
    let mut child = match start(scorer, &job) {
        Ok(child) => child,
        Err(problem) => return Ended::Failed(problem),
    };
    let Some(output) = child.stdout.take() else {
        return Ended::Failed("the child has no output".to_owned());
    };
    let report = async {
        let report = listen(app, &claim.id, output).await;
        (report, child.wait().await)
    };
    let time = app.settings.scoring_time;
    let (report, status) = tokio::select! {
        ended = report => ended,
        () = tokio::time::sleep(time) => {
            // Dropping the child kills it.
            return Ended::Crashed(format!("it took longer than {} s", time.as_secs()));
        }
        // Also if nobody could ask any more.
        _ = stop.wait_for(|stop| *stop) => return Ended::Stopped,
    };
    let status = status.map_or_else(|error| error.to_string(), |status| status.to_string());
    match report {
        Some(Report::Scored { scores }) => Ended::Scored(scores),
        Some(Report::Refused { reason, problems }) => Ended::Refused(Verdict::Refused { reason, problems }),
        Some(Report::Failed { why }) => Ended::Failed(why),
        Some(Report::Progress { .. }) | None => {
            Ended::Crashed(format!("the process that scored it ended early ({status})"))
        }
    }
}

fn start(scorer: &Scorer, job: &Job) -> Result<Child, String> {
    let job = serde_json::to_string(job).map_err(|error| error.to_string())?;
    Command::new(&scorer.program)
        .args(&scorer.arguments)
        .arg(job)
        .stdin(Stdio::null())
        .stdout(Stdio::piped())
        .kill_on_drop(true)
        .spawn()
        .map_err(|error| format!("{}: does not start: {error}", scorer.program.display()))
}

/// Reads what the child reports, one line each, until it has no more to say: the last is what counts.
async fn listen(app: &AppState, id: &str, output: ChildStdout) -> Option<Report> {
    let mut lines = BufReader::new(output.take(REPORT)).lines();
    let mut last = None;
    while let Ok(Some(line)) = lines.next_line().await {
        let report = serde_json::from_str(&line).ok()?;
        if let Report::Progress { done, all } = report {
            app.set_progress(id, Some(Progress { done, all }));
        }
        last = Some(report);
    }
    last
}

/// Back into the queue after something else than a verdict.
async fn failed(app: &AppState, claim: &Claim, why: &str, wait: Duration) {
    app.metrics.failed.fetch_add(1, Ordering::Relaxed);
    tracing::error!(submission = claim.id, why, "scoring failed; it is tried again");
    put_back(app, claim, Some((why, wait))).await;
}

/// Back into the queue, whatever it takes: a submission that stays `scoring` would wait for the next start.
async fn put_back(app: &AppState, claim: &Claim, failure: Option<(&str, Duration)>) {
    for _ in 0..5 {
        match app.store.put_back(&claim.id, failure, Time::now()).await {
            Ok(()) => return,
            Err(error) => tracing::error!(submission = claim.id, %error, "it cannot be put back"),
        }
        tokio::time::sleep(IDLE).await;
    }
}

/// Why a verdict was not written.
#[derive(Debug, thiserror::Error)]
enum WorkerError {
    #[error(transparent)]
    Store(#[from] StoreError),
    #[error(transparent)]
    Folder(#[from] FolderError),
}
