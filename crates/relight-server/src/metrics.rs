//! Counters in Prometheus' text format.

use std::collections::BTreeMap;
use std::fmt::Write;
use std::sync::atomic::{AtomicI64, AtomicU64, Ordering};
use std::sync::{Mutex, PoisonError};
use std::time::Duration;

use crate::store::{Store, StoreError};

/// Upper ends of the classes of request times, seconds.
const CLASSES: [f64; 9] = [0.001, 0.005, 0.01, 0.05, 0.1, 0.5, 1.0, 10.0, 60.0];

/// What the server counts since it started.
#[derive(Debug, Default)]
pub struct Metrics {
    /// Requests by route and status, and times by route.
    requests: Mutex<BTreeMap<String, Route>>,
    /// Requests being answered.
    in_flight: AtomicI64,
    /// Bytes of zips received, kept or not.
    pub(crate) uploaded_bytes: AtomicU64,
    /// Uploads that did not become submissions.
    pub(crate) uploads_refused: AtomicU64,
    /// Submissions scored.
    pub(crate) scored: AtomicU64,
    /// Submissions refused while checked.
    pub(crate) refused: AtomicU64,
    /// Times that scoring failed through no fault of the submission's.
    pub(crate) failed: AtomicU64,
    /// Milliseconds spent scoring.
    pub(crate) scoring_milliseconds: AtomicU64,
    /// Requests turned away by a rate limit.
    pub(crate) rate_limited: AtomicU64,
    /// Panics caught.
    pub(crate) panics: AtomicU64,
}

#[derive(Debug, Default)]
struct Route {
    statuses: BTreeMap<u16, u64>,
    classes: [u64; CLASSES.len()],
    seconds: f64,
}

/// A request that is being answered; ends when dropped, also if its client goes away.
#[derive(Debug)]
pub(crate) struct InFlight<'a>(&'a Metrics);

impl Drop for InFlight<'_> {
    fn drop(&mut self) {
        self.0.in_flight.fetch_sub(1, Ordering::Relaxed);
    }
}

impl Metrics {
    pub(crate) fn begin(&self) -> InFlight<'_> {
        self.in_flight.fetch_add(1, Ordering::Relaxed);
        InFlight(self)
    }

    /// Counts an answer. `route` is the pattern of the path, not the path: there are few of them.
    pub(crate) fn answered(&self, route: &str, status: u16, took: Duration) {
        let mut routes = self.requests.lock().unwrap_or_else(PoisonError::into_inner);
        if !routes.contains_key(route) {
            routes.insert(route.to_owned(), Route::default());
        }
        let Some(of) = routes.get_mut(route) else { return };
        *of.statuses.entry(status).or_default() += 1;
        of.seconds += took.as_secs_f64();
        for (class, end) in of.classes.iter_mut().zip(CLASSES) {
            *class += u64::from(took.as_secs_f64() <= end);
        }
    }

    /// All counters as text.
    ///
    /// # Errors
    /// If the numbers that the database holds cannot be read.
    pub async fn text(&self, store: &Store) -> Result<String, StoreError> {
        let counts = store.counts().await?;
        let mut text = String::new();
        self.requests_text(&mut text);
        let load = |counter: &AtomicU64| counter.load(Ordering::Relaxed);
        let mut put = |name: &str, kind: &str, help: &str, value: f64| {
            let _ = write!(
                text,
                "# HELP relight_{name} {help}\n# TYPE relight_{name} {kind}\nrelight_{name} {value}\n"
            );
        };
        let in_flight = self.in_flight.load(Ordering::Relaxed);
        put("http_requests_in_flight", "gauge", "Requests being answered.", in_flight as f64);
        for (name, help, counter) in [
            ("uploaded_bytes_total", "Bytes of zips received.", &self.uploaded_bytes),
            ("uploads_refused_total", "Uploads that did not become submissions.", &self.uploads_refused),
            ("submissions_scored_total", "Submissions scored since the start.", &self.scored),
            (
                "submissions_refused_total",
                "Submissions refused while they were checked, since the start.",
                &self.refused,
            ),
            (
                "scoring_failures_total",
                "Times that scoring failed through no fault of the submission's.",
                &self.failed,
            ),
            ("rate_limited_total", "Requests turned away by a rate limit.", &self.rate_limited),
            ("panics_total", "Panics caught while answering.", &self.panics),
        ] {
            put(name, "counter", help, load(counter) as f64);
        }
        let seconds = load(&self.scoring_milliseconds) as f64 / 1000.0;
        put("scoring_seconds_total", "counter", "Time spent scoring.", seconds);
        text.push_str("# HELP relight_submissions Submissions by state.\n# TYPE relight_submissions gauge\n");
        for state in ["queued", "scoring", "scored", "refused"] {
            let count = counts.iter().find(|(name, _)| name == state).map_or(0, |(_, count)| *count);
            let _ = writeln!(text, "relight_submissions{{state=\"{state}\"}} {count}");
        }
        Ok(text)
    }

    fn requests_text(&self, text: &mut String) {
        let routes = self.requests.lock().unwrap_or_else(PoisonError::into_inner);
        text.push_str(
            "# HELP relight_http_requests_total Requests answered.\n# TYPE relight_http_requests_total counter\n",
        );
        for (route, of) in routes.iter() {
            for (status, count) in &of.statuses {
                let _ = writeln!(
                    text,
                    "relight_http_requests_total{{route=\"{route}\",status=\"{status}\"}} {count}"
                );
            }
        }
        text.push_str(
            "# HELP relight_http_request_seconds Time to the answer's head.\n\
             # TYPE relight_http_request_seconds histogram\n",
        );
        for (route, of) in routes.iter() {
            let all: u64 = of.statuses.values().sum();
            let classes = CLASSES.iter().map(f64::to_string).zip(of.classes);
            for (end, count) in classes.chain([("+Inf".to_owned(), all)]) {
                let _ = writeln!(
                    text,
                    "relight_http_request_seconds_bucket{{route=\"{route}\",le=\"{end}\"}} {count}"
                );
            }
            let _ = writeln!(text, "relight_http_request_seconds_sum{{route=\"{route}\"}} {}", of.seconds);
            let _ = writeln!(text, "relight_http_request_seconds_count{{route=\"{route}\"}} {all}");
        }
    }
}
