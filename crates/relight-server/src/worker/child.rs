//! The child process: limits itself, then looks at the zip.

use std::io::{self, Write};
use std::ops::ControlFlow;
use std::time::{Duration, Instant};

use relight_scene::Split;

use super::job::{Job, Report};
use super::pictures::draw;
use crate::Progress;
use crate::benchmark::Benchmark;
use crate::digest::sha256;
use crate::method::Phase;
use crate::scoring::{ScoringError, score};
use crate::submission::{Limits, Refusal, SubmissionError, check, inspect};

/// Between two reports of progress.
const EVERY: Duration = Duration::from_millis(100);

/// Does the job that `text` tells of and reports to standard output. What a child process is started for.
///
/// # Errors
/// If nobody listens any more.
pub fn run(text: &str) -> io::Result<()> {
    let report = match serde_json::from_str::<Job>(text) {
        Ok(job) => match limit(&job).and_then(|()| do_job(&job)) {
            Ok(report) => report,
            Err(why) => Report::Failed { why },
        },
        Err(error) => Report::Failed { why: format!("the job does not read: {error}") },
    };
    tell(&report)
}

fn tell(report: &Report) -> io::Result<()> {
    let mut line = serde_json::to_vec(report)?;
    line.push(b'\n');
    let mut out = io::stdout().lock();
    out.write_all(&line)?;
    out.flush()
}

/// Bounds what whatever the zip holds can do to the machine.
fn limit(job: &Job) -> Result<(), String> {
    #[cfg(unix)]
    {
        use rustix::process::{Resource, Rlimit, nice, setrlimit};
        let failed = |what: &'static str| move |error| format!("{what}: {error}");
        let limit = |bytes| Rlimit { current: Some(bytes), maximum: Some(bytes) };
        setrlimit(Resource::As, limit(job.memory)).map_err(failed("memory cannot be limited"))?;
        setrlimit(Resource::Core, limit(0)).map_err(failed("core files cannot be forbidden"))?;
        // Readers come first.
        nice(10).map_err(failed("priority cannot be lowered"))?;
    }
    #[cfg(target_os = "linux")]
    {
        use rustix::process::{Signal, set_parent_process_death_signal};
        // Scoring on for a server that was killed would only slow the next one.
        set_parent_process_death_signal(Some(Signal::KILL))
            .map_err(|error| format!("cannot be tied to the server: {error}"))?;
        // It may have been killed before that.
        let parent = rustix::process::getppid().map(|pid| pid.as_raw_pid().unsigned_abs());
        if parent != Some(job.server) {
            return Err("the server that asked for it is gone".to_owned());
        }
    }
    Ok(())
}

fn do_job(job: &Job) -> Result<Report, String> {
    let limits = Limits { zip_bytes: job.zip_bytes, ..Limits::default() };
    let benchmark = Benchmark::open(&job.benchmark).map_err(|error| error.to_string())?;
    if sha256(&job.zip).map_err(|error| format!("{}: {error}", job.zip.display()))? != job.sha256 {
        return Err("the zip has changed on the server's disk".to_owned());
    }
    let submission = match inspect(&job.zip, &benchmark, &limits) {
        Ok(submission) => submission,
        Err(error) => return refused(error),
    };
    let is_val = submission.splits == [Split::Val];
    if let Some(reason) = match job.phase {
        Phase::Val if !is_val => Some(
            "it was sent to the validation phase, and holds images of the hidden splits: send it to the test phase",
        ),
        Phase::Test if is_val => Some(
            "it was sent to the test phase, and holds validation images alone: send it to the validation phase",
        ),
        _ => None,
    } {
        return Ok(Report::Refused { reason: reason.to_owned(), problems: None });
    }
    let mut told = Instant::now();
    let mut lost = None;
    let mut progress = |progress: Progress| {
        if told.elapsed() >= EVERY {
            told = Instant::now();
            lost = tell(&Report::Progress { done: progress.done, all: progress.all }).err();
        }
        if lost.is_some() { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
    };
    match score(&submission, &benchmark, &limits, &mut progress) {
        Ok(scores) => {
            // Scores without pictures are better than none.
            if let Err(error) = draw(&submission, &benchmark, &limits, &job.pictures) {
                eprintln!("pictures of {} are not drawn: {error}", job.zip.display());
            }
            Ok(Report::Scored { scores: Box::new(scores) })
        }
        // Scoring stops at the first image that does not decode; whoever sent it is told of all.
        Err(ScoringError::Refused(first)) => match check(&job.zip, &benchmark, &limits, &mut progress) {
            Ok(_) => Ok(refusal(first)),
            Err(error) => refused(error),
        },
        Err(error) => Err(error.to_string()),
    }
}

fn refusal(problems: Refusal) -> Report {
    Report::Refused { reason: problems.to_string(), problems: Some(problems) }
}

fn refused(error: SubmissionError) -> Result<Report, String> {
    match error {
        SubmissionError::Refused(problems) => Ok(refusal(problems)),
        error => Err(error.to_string()),
    }
}
