//! `relight submit check`: the server's rules, offline.

use std::path::{Path, PathBuf};

use anyhow::bail;
use relight_scene::Split;
use relight_server::benchmark::Benchmark;
use relight_server::method::Phase;
use relight_server::submission::{Limits, Problem, Submission, SubmissionError, check};
use serde::Serialize;

use crate::console::{Progress, cancel_flag, print_json, print_line, unless};

/// Check a zip by the rules of the evaluation server, which will refuse what this refuses.
///
/// Which images there must be, and of which size, is read from the folder of scenes; their test images may be black, as in the
/// official release. Every problem is told with the entry, the mend and a code, which docs/submissions.md explains.
#[derive(clap::Args)]
#[command(after_help = "Example:\n  relight submit check entry.zip --scenes SCENES")]
pub struct Args {
    /// The submission.
    zip: PathBuf,
    /// Folder of the benchmark's scenes.
    #[arg(long, value_name = "DIR")]
    scenes: PathBuf,
    /// The phase that it is for: `val` takes validation images alone, `test` no zip that has nothing else. [default: whichever
    /// its images are for]
    #[arg(long, value_name = "test|val")]
    phase: Option<Phase>,
    /// One JSON object on standard output.
    #[arg(long)]
    json: bool,
}

#[derive(Serialize)]
struct Verdict<'a> {
    passed: bool,
    images: usize,
    splits: Vec<String>,
    problems: &'a [Problem],
    more_problems: usize,
}

pub fn run(args: &Args, quiet: bool) -> anyhow::Result<()> {
    let refusal = match checked(&args.zip, &args.scenes, quiet) {
        Ok(submission) => {
            let fits = check_phase(&submission, args.phase, &args.zip);
            let splits: Vec<String> = submission.splits.iter().map(ToString::to_string).collect();
            let images = submission.images.len();
            if args.json {
                let passed = fits.is_ok();
                print_json(&Verdict { passed, images, splits, problems: &[], more_problems: 0 })?;
                return fits;
            }
            fits?;
            let splits = splits.join(", ");
            return print_line(&format!("{}: all right, {images} images ({splits})", args.zip.display()));
        }
        Err(error) => match error.downcast::<SubmissionError>()? {
            SubmissionError::Refused(refusal) => refusal,
            other => return Err(other.into()),
        },
    };
    let all = refusal.problems.len() + refusal.more;
    if args.json {
        let (problems, more_problems) = (&refusal.problems[..], refusal.more);
        print_json(&Verdict { passed: false, images: 0, splits: Vec::new(), problems, more_problems })?;
    } else {
        for problem in &refusal.problems {
            print_line(&problem.to_string())?;
        }
        if refusal.more > 0 {
            print_line(&format!("and {} more problems", refusal.more))?;
        }
    }
    bail!(
        "{}: the server would refuse it, for {all} problem{}",
        args.zip.display(),
        if all == 1 { "" } else { "s" }
    )
}

/// The phase that a submission's images are for.
pub(super) fn phase_of(submission: &Submission) -> Phase {
    if submission.splits == [Split::Val] { Phase::Val } else { Phase::Test }
}

/// Refuses, as the server does, a submission that is for another phase than the one that is meant.
pub(super) fn check_phase(submission: &Submission, meant: Option<Phase>, zip: &Path) -> anyhow::Result<()> {
    let fits = phase_of(submission);
    if let Some(meant) = meant.filter(|&meant| meant != fits) {
        let holds =
            if fits == Phase::Val { "validation images alone" } else { "images of the hidden splits" };
        bail!(
            "{}: the server would refuse it in the {meant} phase, for it holds {holds}: send it to {fits}",
            zip.display()
        );
    }
    Ok(())
}

/// Checks a zip against a folder of scenes, with progress, until Ctrl-C.
pub(super) fn checked(zip: &Path, scenes: &Path, quiet: bool) -> anyhow::Result<Submission> {
    let benchmark = Benchmark::layout(scenes)?;
    let cancel = cancel_flag()?;
    let bar = Progress::new("checking", 0, quiet);
    let submission = check(zip, &benchmark, &Limits::default(), &mut |progress| {
        bar.count(progress.done, progress.all, "images");
        unless(cancel)
    });
    bar.clear();
    Ok(submission?)
}
