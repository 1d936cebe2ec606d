//! From scenes, models and seeds to tables: what both commands share.

use std::collections::BTreeMap;
use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};

use anyhow::{Context, bail};
use relight_bench::{
    Ended, Failure, JobList, Kind, Need, Record, Report, Results, SceneFacts, Settings, available_memory,
    side_by_side,
};
use relight_train::schedule::Budget;

use super::Shared;
use super::display::{Display, duration};
use super::work::{Scenes, finished, run_job};
use crate::commands::train::recipe;
use crate::console::{cancel_flag, print_line, told_once};
use crate::preparation::open;
use crate::{engines, places};

/// What was found out about a scene before any work.
struct Seen {
    facts: SceneFacts,
    need: Need,
}

/// Trains what is missing, and writes the tables after each training.
pub fn make(kind: Kind, args: &Shared, models: &[String], quiet: bool) -> anyhow::Result<()> {
    engines::check(args.device)?;
    let out = &args.out;
    places::check_folder(out)?;
    let models: Vec<String> = models.iter().map(|model| model.to_lowercase()).collect();
    let first = models.first().context("name a model")?;
    let settings = Settings {
        preset: args.preset.name().to_owned(),
        budget: Budget { steps: args.steps, minutes: args.minutes },
        recipe: recipe(args.preset, args.recipe.as_deref(), first)?,
    };
    let list = JobList::new(settings, &args.scenes, &models, &args.seeds)?;
    list.keep(out)?;

    let seen = look(&list);
    let mut standing = Standing::new(kind, &list, out, &seen);
    let missing = standing.take_finished();
    standing.write()?;
    let together = together(args, &list, &missing, &seen);
    let display = Display::new(list.jobs.len(), list.jobs.len() - missing.len(), quiet);
    if !missing.is_empty() {
        display.note(&plan(args, &list, missing.len(), together));
    }
    let cancel = cancel_flag()?;
    let scenes = Scenes::of(&list);
    let threads = rayon::current_num_threads();
    let mut unwritten = None;
    side_by_side(
        missing.len(),
        together,
        threads,
        cancel,
        |n| {
            let name = &list.jobs[missing[n]].id;
            let tell =
                |share: f64, message: &dyn Fn() -> String| display.tell(missing[n], name, share, message);
            match run_job(&list, missing[n], out, &scenes, args.device, cancel, &tell) {
                Ok(Some(record)) => Ended::Done(record),
                Ok(None) => Ended::Stopped,
                Err(error) => Ended::Failed(told_once(&error)),
            }
        },
        |n, ended| {
            let index = missing[n];
            let name = &list.jobs[index].id;
            let (is_done, line) = match ended {
                Ended::Done(record) => {
                    let line = format!("{name}: {}", scores(&record));
                    standing.records.push(record);
                    (true, line)
                }
                Ended::Stopped => (false, format!("{name}: stopped")),
                Ended::Failed(reason) => {
                    let line = format!("{name} failed: {reason}");
                    standing.failures.push(Failure { job: name.clone(), reason });
                    (false, line)
                }
            };
            display.ended(index, is_done, &line);
            if let Err(error) = standing.write() {
                // Trainings whose tables cannot be written are in vain as well.
                cancel.store(true, Ordering::Relaxed);
                unwritten.get_or_insert(error);
            }
        },
    );
    display.clear();
    if let Some(error) = unwritten {
        return Err(error);
    }
    print_line(standing.report(&standing.results()).markdown().trim_end())?;
    standing.verdict(cancel)
}

/// Opens every scene. One that cannot be opened is none's but its own jobs' fault.
fn look(list: &JobList) -> BTreeMap<String, Seen> {
    let mut seen = BTreeMap::new();
    for job in &list.jobs {
        if !seen.contains_key(&job.scene_name)
            && let Ok((scene, splits)) = open(&job.scene)
        {
            let need = Need::of(&scene, &splits, &list.settings.recipe);
            seen.insert(job.scene_name.clone(), Seen { facts: SceneFacts::of(&scene), need });
        }
    }
    seen
}

/// How many jobs run side by side.
fn together(args: &Shared, list: &JobList, missing: &[usize], seen: &BTreeMap<String, Seen>) -> usize {
    let needs: Vec<Need> =
        missing.iter().filter_map(|&index| Some(seen.get(&list.jobs[index].scene_name)?.need)).collect();
    let fit = available_memory().map_or(1, |bytes| Need::together(&needs, bytes));
    match args.jobs {
        Some(jobs) => {
            if jobs.get() > fit {
                tracing::warn!("--jobs {jobs}: memory may not suffice for more than {fit} at once");
            }
            jobs.get()
        }
        None if args.minutes.is_some() => 1,
        None => fit.min(rayon::current_num_threads()),
    }
    .min(missing.len())
    .max(1)
}

/// What is about to be done.
fn plan(args: &Shared, list: &JobList, missing: usize, together: usize) -> String {
    let all = list.jobs.len();
    let mut plan = format!("{missing} of {all} runs to train, {together} at a time");
    if let Some(minutes) = args.minutes {
        if args.jobs.is_none() {
            plan += " (side by side they would slow each other, and their minutes would hold fewer steps; --jobs N does it all the same)";
        }
        let rounds = missing.div_ceil(together) as f64;
        plan += &format!(": about {} of training", duration(60.0 * minutes * rounds));
    }
    plan
}

/// A record in a few words.
fn scores(record: &Record) -> String {
    use relight_scene::Split::{Easy, Hard, Val};
    let scored = [Val, Easy, Hard]
        .iter()
        .filter_map(|&split| Some(format!("{split} {:.2} dB", record.evaluation(split)?.mean.psnr)));
    scored.collect::<Vec<_>>().join(", ")
}

/// What there is so far.
struct Standing<'a> {
    kind: Kind,
    list: &'a JobList,
    out: &'a Path,
    seen: &'a BTreeMap<String, Seen>,
    records: Vec<Record>,
    failures: Vec<Failure>,
}

impl<'a> Standing<'a> {
    fn new(kind: Kind, list: &'a JobList, out: &'a Path, seen: &'a BTreeMap<String, Seen>) -> Self {
        Self { kind, list, out, seen, records: Vec::new(), failures: Vec::new() }
    }

    /// Takes what earlier starts finished, and tells which jobs are missing.
    fn take_finished(&mut self) -> Vec<usize> {
        let mut missing = Vec::new();
        for (index, job) in self.list.jobs.iter().enumerate() {
            match finished(self.list, job, self.out) {
                Ok(Some(record)) => self.records.push(record),
                Ok(None) => missing.push(index),
                Err(error) => self.failures.push(Failure { job: job.id.clone(), reason: told_once(&error) }),
            }
        }
        missing
    }

    fn results(&self) -> Results {
        let facts = |scene: &str| self.seen.get(scene).map(|seen| seen.facts);
        Results::gather(self.list, self.out, &facts, self.records.clone(), self.failures.clone())
    }

    fn report<'r>(&self, results: &'r Results) -> Report<'r> {
        Report::new(self.kind, results)
    }

    fn write(&self) -> anyhow::Result<()> {
        self.report(&self.results()).write(self.out)?;
        Ok(())
    }

    /// Success, if all that was asked was done.
    fn verdict(&self, cancel: &AtomicBool) -> anyhow::Result<()> {
        let (all, done) = (self.list.jobs.len(), self.records.len());
        for failure in &self.failures {
            eprintln!("{} failed: {}", failure.job, failure.reason);
        }
        match self.failures.len() {
            _ if done == all => Ok(()),
            _ if cancel.load(Ordering::Relaxed) => {
                bail!("stopped with {done} of {all} runs done; the same command goes on")
            }
            failed => bail!("{failed} of {all} runs failed; the same command tries them again"),
        }
    }
}
