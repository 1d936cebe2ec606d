//! Progress of many jobs: on a terminal a bar for each that runs and one for all, elsewhere a plain line now and then.

use std::collections::BTreeMap;
use std::io::IsTerminal;
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::Instant;

use indicatif::{MultiProgress, ProgressBar, ProgressStyle};

use crate::console::LINE_EVERY;

/// Progress of all jobs.
pub struct Display {
    bars: Option<(MultiProgress, ProgressBar)>,
    is_silent: bool,
    started: Instant,
    state: Mutex<State>,
}

struct State {
    all: usize,
    /// Jobs at their end, those of earlier starts too.
    done: usize,
    running: BTreeMap<usize, Running>,
    /// Jobs' worth of work done since the start, but for what is running.
    worked: f64,
    line: Instant,
}

struct Running {
    bar: Option<ProgressBar>,
    name: String,
    /// Share that was done when it was first heard of in this start.
    first: f64,
    share: f64,
    message: String,
}

impl Display {
    /// Of `all` jobs, `done` of which are done already.
    pub fn new(all: usize, done: usize, quiet: bool) -> Self {
        let bars = (std::io::stderr().is_terminal() && !quiet).then(|| {
            let bars = MultiProgress::new();
            let total = bars.add(bar("all", "{prefix} {bar:24} {percent:>3}%  {msg}"));
            (bars, total)
        });
        let state = State { all, done, running: BTreeMap::new(), worked: 0.0, line: Instant::now() };
        Self { bars, is_silent: quiet, started: Instant::now(), state: Mutex::new(state) }
    }

    /// A job is so far.
    pub fn tell(&self, job: usize, name: &str, share: f64, message: &dyn Fn() -> String) {
        let message = message();
        let mut state = self.state();
        let running = state.running.entry(job).or_insert_with(|| Running {
            bar: self.bars.as_ref().map(|(bars, total)| {
                let new = bar(name, "{prefix} {bar:24} {percent:>3}%  {msg}");
                bars.insert_before(total, new)
            }),
            name: name.to_owned(),
            first: share,
            share,
            message: String::new(),
        });
        // What is at nothing yet is loading; the first share of a resumed training is not this start's work.
        if running.share == 0.0 && running.first == 0.0 && share > 0.0 {
            running.first = share;
        }
        running.share = share;
        if let Some(bar) = &running.bar {
            bar.set_position((share * 1000.0) as u64);
            bar.set_message(message.clone());
        }
        running.message = message;
        self.total(&mut state);
    }

    /// A job is at its end, done or not; `line` stays.
    pub fn ended(&self, job: usize, is_done: bool, line: &str) {
        let mut state = self.state();
        if let Some(running) = state.running.remove(&job) {
            state.worked += 1.0 - running.first;
            if let Some(bar) = running.bar {
                bar.finish_and_clear();
            }
        }
        state.done += usize::from(is_done);
        self.note(line);
        self.total(&mut state);
    }

    /// Writes a line that stays.
    pub fn note(&self, line: &str) {
        match &self.bars {
            // A terminal that is gone loses a line, and nothing else.
            Some((bars, _)) => drop(bars.println(line)),
            None if self.is_silent => {}
            None => eprintln!("{line}"),
        }
    }

    /// Takes all bars away.
    pub fn clear(&self) {
        if let Some((bars, total)) = &self.bars {
            total.finish_and_clear();
            // As above.
            drop(bars.clear());
        }
    }

    fn total(&self, state: &mut State) {
        let shares: f64 = state.running.values().map(|r| r.share).sum();
        let all = state.all.max(1) as f64;
        let share = ((state.done as f64 + shares) / all).min(1.0);
        let worked = state.worked + state.running.values().map(|r| r.share - r.first).sum::<f64>();
        let message =
            format!("{} of {} done{}", state.done, state.all, self.left(worked, all * (1.0 - share)));
        if let Some((_, total)) = &self.bars {
            total.set_position((share * 1000.0) as u64);
            total.set_message(message);
        } else if !self.is_silent && state.line.elapsed() >= LINE_EVERY {
            state.line = Instant::now();
            eprintln!("{:.0} %, {message}", 100.0 * share);
            for running in state.running.values() {
                eprintln!("  {}: {:.0} %, {}", running.name, 100.0 * running.share, running.message);
            }
        }
    }

    /// The time that the rest takes, once enough is done to tell.
    fn left(&self, worked: f64, rest: f64) -> String {
        let elapsed = self.started.elapsed().as_secs_f64();
        if worked < 0.01 || elapsed < 1.0 {
            return String::new();
        }
        format!(", {} left", duration(elapsed * rest / worked))
    }

    fn state(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

fn bar(name: &str, template: &str) -> ProgressBar {
    let bar = ProgressBar::new(1000);
    if let Ok(style) = ProgressStyle::with_template(template) {
        bar.set_style(style);
    }
    bar.set_prefix(format!("{name:>20}"));
    bar
}

/// A time in words.
pub fn duration(seconds: f64) -> String {
    let minutes = (seconds / 60.0).round() as u64;
    match (minutes / 60, minutes % 60) {
        _ if seconds < 90.0 => format!("{seconds:.0} s"),
        (0, minutes) => format!("{minutes} min"),
        (hours, minutes) => format!("{hours} h {minutes:02} min"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn times_are_told_in_fitting_units() {
        assert_eq!(duration(4.4), "4 s");
        assert_eq!(duration(89.0), "89 s");
        assert_eq!(duration(90.0), "2 min");
        assert_eq!(duration(3599.0), "1 h 00 min");
        assert_eq!(duration(26.0 * 3600.0 + 300.0), "26 h 05 min");
    }

    #[test]
    fn what_earlier_starts_did_is_no_work_of_this_one() {
        let display = Display::new(4, 1, true);
        let message = || String::new();
        display.tell(1, "b", 0.0, &message);
        display.tell(1, "b", 0.6, &message);
        display.tell(1, "b", 0.8, &message);
        let state = display.state();
        let running = &state.running[&1];
        assert!((running.share - running.first - 0.2).abs() < 1e-12, "resumed at 0.6");
        drop(state);
        display.ended(1, true, "");
        let state = display.state();
        assert!((state.worked - 0.4).abs() < 1e-12);
        assert_eq!((state.done, state.running.len()), (2, 0));
    }
}
