//! Talking to whoever started the program: logs and progress on standard error, results on standard output, Ctrl-C.

use std::io::{IsTerminal, Write};
use std::ops::ControlFlow;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Mutex, OnceLock, PoisonError};
use std::time::{Duration, Instant};

use anyhow::Context;
use indicatif::{FormattedDuration, ProgressBar, ProgressStyle};
use serde::Serialize;
use signal_hook::consts::{SIGINT, SIGTERM};
use signal_hook::iterator::Signals;
use tracing::level_filters::LevelFilter;
use tracing_subscriber::Layer;
use tracing_subscriber::filter::Targets;
use tracing_subscriber::layer::SubscriberExt;
use tracing_subscriber::util::SubscriberInitExt;

/// Signals that come so soon after the first mean the same: `timeout` sends its own to the program and then to its group.
const PATIENCE: Duration = Duration::from_secs(1);
/// The same where the second is to stop something that moves, and somebody may be in a hurry.
const SAME: Duration = Duration::from_millis(200);

/// Time between plain lines of progress.
pub const LINE_EVERY: Duration = Duration::from_secs(10);

/// How the log looks.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Log {
    /// Lines of text.
    Plain,
    /// The same with times, and more of them: a server's.
    Timed,
    /// A server's, one JSON object a line.
    Json,
}

/// Sends logs to standard error: warnings, or more with `verbose`, or errors only.
pub fn start_logging(verbose: u8, quiet: bool, log: Log) {
    let level = match (quiet, verbose.saturating_add((log != Log::Plain).into())) {
        (true, _) => tracing::Level::ERROR,
        (_, 0) => tracing::Level::WARN,
        (_, 1) => tracing::Level::INFO,
        (_, 2) => tracing::Level::DEBUG,
        _ => tracing::Level::TRACE,
    };
    let lines = tracing_subscriber::fmt::layer()
        .with_writer(std::io::stderr)
        .with_ansi(std::io::stderr().is_terminal())
        .with_target(false);
    let lines = match log {
        Log::Plain => lines.without_time().boxed(),
        Log::Timed => lines.boxed(),
        Log::Json => lines.json().flatten_event(true).boxed(),
    };
    // The search for boards warns of each of its many tries; what comes of them is told by whoever asked.
    let heard = Targets::new().with_default(level).with_target("calib_targets_charuco", LevelFilter::ERROR);
    tracing_subscriber::registry().with(lines).with(heard).init();
}

/// Writes `value` to standard output as JSON on one line.
pub fn print_json(value: &impl Serialize) -> anyhow::Result<()> {
    print_line(&serde_json::to_string(value)?)
}

/// Writes a line to standard output.
pub fn print_line(line: &str) -> anyhow::Result<()> {
    let mut out = std::io::stdout().lock();
    writeln!(out, "{line}").and_then(|()| out.flush()).context("standard output")
}

/// Progress of one long piece of work: a bar on a terminal, a plain line now and then elsewhere.
pub struct Progress {
    bar: Option<ProgressBar>,
    name: &'static str,
    /// When something was first told to be done, and how much was.
    first: OnceLock<(Instant, u64)>,
    /// When the last plain line was written; `None` for silence.
    line: Option<Mutex<Instant>>,
}

impl Progress {
    /// Progress of `name` towards `length`, silent if `quiet`.
    pub fn new(name: &'static str, length: u64, quiet: bool) -> Self {
        let terminal = std::io::stderr().is_terminal();
        let bar = (terminal && !quiet).then(|| {
            let bar = ProgressBar::new(length);
            let template = "{prefix:>10} {bar:32} {percent:>3}% {eta:>4} left  {msg}";
            if let Ok(style) = ProgressStyle::with_template(template) {
                bar.set_style(style);
            }
            bar.set_prefix(name);
            bar
        });
        let line = (!terminal && !quiet).then(|| Mutex::new(Instant::now()));
        Self { bar, name, first: OnceLock::new(), line }
    }

    /// Tells that `done` of `length` is done.
    pub fn update(&self, done: u64, length: u64, message: impl FnOnce() -> String) {
        self.first.get_or_init(|| (Instant::now(), done));
        if let Some(bar) = &self.bar {
            bar.set_length(length);
            bar.set_position(done);
            bar.set_message(message());
        } else if let Some(mut last) = self.line.as_ref().and_then(|l| l.lock().ok())
            && last.elapsed() >= LINE_EVERY
        {
            *last = Instant::now();
            let percent = 100.0 * done as f64 / length.max(1) as f64;
            let left = self
                .rate(done)
                .and_then(|rate| Duration::try_from_secs_f64(length.saturating_sub(done) as f64 / rate).ok());
            let left = left.map_or("?".to_owned(), |left| FormattedDuration(left).to_string());
            eprintln!("{}: {percent:.0}% {left} left  {}", self.name, message());
        }
    }

    /// Tells that `done` of `all` things, `what` by name, are done, and how many a second.
    pub fn count(&self, done: usize, all: usize, what: &str) {
        self.update(done as u64, all as u64, || {
            let rate = self.rate(done as u64).map_or(String::new(), |rate| format!(", {rate:.1}/s"));
            format!("{done} of {all} {what}{rate}")
        });
    }

    /// How much was done a second since this start, where that can be told.
    fn rate(&self, done: u64) -> Option<f64> {
        let &(start, before) = self.first.get()?;
        let (done, seconds) = (done.saturating_sub(before) as f64, start.elapsed().as_secs_f64());
        (done > 0.0 && seconds > 0.0).then(|| done / seconds)
    }

    /// Writes a line that stays.
    pub fn note(&self, line: &str) {
        match &self.bar {
            Some(bar) => bar.println(line),
            None if self.line.is_some() => eprintln!("{line}"),
            None => {}
        }
    }

    /// Ends the work and takes the bar away.
    pub fn clear(&self) {
        if let Some(bar) = &self.bar {
            bar.finish_and_clear();
        }
    }

    /// Ends the work, with a last line.
    pub fn finish(self, line: &str) {
        self.clear();
        if self.bar.is_some() || self.line.is_some() {
            eprintln!("{line}");
        }
    }
}

/// Set by the second Ctrl-C where something has to be stopped before the program may end.
static STOP: AtomicBool = AtomicBool::new(false);
static IS_STOP_HEEDED: AtomicBool = AtomicBool::new(false);

/// A flag that the second Ctrl-C or SIGTERM sets, for what must not be left moving; the third ends the program.
pub fn stop_flag() -> &'static AtomicBool {
    IS_STOP_HEEDED.store(true, Ordering::Relaxed);
    &STOP
}

/// A flag that the first Ctrl-C or SIGTERM sets; one a second later ends the program at once, unless somebody heeds
/// [`stop_flag`]. The end of the terminal is left alone, so that `nohup` means what it says.
pub fn cancel_flag() -> anyhow::Result<&'static AtomicBool> {
    static FLAG: AtomicBool = AtomicBool::new(false);
    static IS_LISTENING: Mutex<bool> = Mutex::new(false);
    let mut is_listening = IS_LISTENING.lock().unwrap_or_else(PoisonError::into_inner);
    if !*is_listening {
        let mut signals = Signals::new([SIGINT, SIGTERM])?;
        std::thread::Builder::new().name("signals".to_owned()).spawn(move || {
            let (mut first, mut second) = (None, None);
            for _ in signals.forever() {
                FLAG.store(true, Ordering::Relaxed);
                let mut since = first.get_or_insert_with(Instant::now).elapsed();
                if IS_STOP_HEEDED.load(Ordering::Relaxed) {
                    if since < SAME {
                        continue;
                    }
                    STOP.store(true, Ordering::Relaxed);
                    since = second.get_or_insert_with(Instant::now).elapsed();
                }
                if since >= PATIENCE {
                    signal_hook::low_level::exit(130);
                }
            }
        })?;
        *is_listening = true;
    }
    Ok(&FLAG)
}

/// Goes on unless the flag is set.
pub fn unless(cancel: &AtomicBool) -> ControlFlow<()> {
    if cancel.load(Ordering::Relaxed) { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
}

/// A number of things, by the name of one.
pub fn counted(number: usize, one: &str) -> String {
    if number == 1 { format!("1 {one}") } else { format!("{number} {one}s") }
}

/// An error with its causes, those left out that the message before them repeats.
pub fn told_once(error: &anyhow::Error) -> String {
    let mut told = String::new();
    for cause in error.chain().map(ToString::to_string) {
        if told.is_empty() {
            told = cause;
        } else if !told.contains(&cause) {
            told = format!("{told}: {cause}");
        }
    }
    told
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_cause_is_told_once() {
        let error = anyhow::anyhow!("no space").context("a.png: no space").context("scene");
        assert_eq!(told_once(&error), "scene: a.png: no space");
    }
}
