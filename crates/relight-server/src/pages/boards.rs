//! Leaderboards kept ready: worked out when something changes, drawn once, then only copied to whoever asks.

use std::collections::HashMap;
use std::io::Write as _;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

use axum::http::{HeaderMap, header};
use axum::response::{IntoResponse, Response};
use bytes::Bytes;
use flate2::Compression;
use flate2::write::GzEncoder;

use super::board;
use super::home::Card;
use super::shell::{Visitor, page};
use crate::leaderboard::{
    About, Entry, Intervals, Leaderboard, Metric, View, ViewError, ViewQuery, to_csv, to_json,
};
use crate::method::Visibility;
use crate::scoring::Scores;
use crate::store::{BenchmarkEntry, Listing, Store, StoreError, SubmissionEntry};

/// For so long what was found to be new is taken to be.
const FRESH: Duration = Duration::from_millis(100);
/// For so long readers are served from before while the new is being worked out; later ones wait.
const BEARABLE: Duration = Duration::from_secs(1);
/// Drawn pages of a benchmark that are kept.
const KEPT: usize = 500;

/// The leaderboards of all benchmarks.
#[derive(Debug, Default)]
pub struct Boards {
    current: Mutex<Option<(Arc<Snapshot>, Instant)>>,
    refreshing: tokio::sync::Mutex<()>,
    /// What was worked out, by submission: scores never change once written.
    scored: Mutex<HashMap<String, Scored>>,
}

/// What takes long to work out of a submission.
type Scored = (Arc<Scores>, Intervals);

/// All benchmarks as they were at one moment.
#[derive(Debug)]
pub struct Snapshot {
    revision: i64,
    /// For the first page.
    pub cards: Vec<Card>,
    benchmarks: Vec<Arc<Board>>,
}

/// A benchmark and its leaderboard.
#[derive(Debug)]
pub struct Board {
    /// The benchmark.
    pub benchmark: BenchmarkEntry,
    /// Its tables.
    pub tables: Leaderboard,
    drawn: Mutex<HashMap<Drawing, Drawn>>,
}

/// A leaderboard in a form that is sent.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
enum Drawing {
    /// The middle of a page.
    Middle(View),
    /// The whole page for someone who is not signed in.
    Page(View),
    Json(ViewQuery),
    Csv(ViewQuery),
}

impl Boards {
    /// The leaderboards, at most a tenth of a second old, or a second while they are being worked out.
    ///
    /// # Errors
    /// If the database fails.
    pub async fn current(&self, store: &Store) -> Result<Arc<Snapshot>, StoreError> {
        let known = self.known();
        if let Some((snapshot, at)) = &known
            && at.elapsed() < FRESH
        {
            return Ok(Arc::clone(snapshot));
        }
        let _refreshing = match (self.refreshing.try_lock(), known) {
            (Ok(refreshing), _) => refreshing,
            (Err(_), Some((snapshot, at))) if at.elapsed() < BEARABLE => return Ok(snapshot),
            (Err(_), _) => self.refreshing.lock().await,
        };
        // Another may just have done it.
        match self.known() {
            Some((snapshot, at)) if at.elapsed() < FRESH => Ok(snapshot),
            known => self.refresh(store, known.map(|(snapshot, _)| snapshot)).await,
        }
    }

    /// Makes the next reader see what has just been changed.
    pub fn changed(&self) {
        let mut current = self.current.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some((_, at)) = current.as_mut() {
            *at = Instant::now().checked_sub(BEARABLE).unwrap_or(*at);
        }
    }

    fn known(&self) -> Option<(Arc<Snapshot>, Instant)> {
        self.current.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }

    async fn refresh(
        &self,
        store: &Store,
        known: Option<Arc<Snapshot>>,
    ) -> Result<Arc<Snapshot>, StoreError> {
        let now = Instant::now();
        let revision = store.revision().await?;
        let snapshot = match known {
            Some(known) if known.revision == revision => known,
            known => Arc::new(self.read(store, revision, known.as_deref()).await?),
        };
        *self.current.lock().unwrap_or_else(PoisonError::into_inner) = Some((Arc::clone(&snapshot), now));
        Ok(snapshot)
    }

    /// Reads all from the database, after `revision`: what changes meanwhile changes the revision once more. Leaderboards that are as
    /// `known` keep their drawings.
    async fn read(
        &self,
        store: &Store,
        revision: i64,
        known: Option<&Snapshot>,
    ) -> Result<Snapshot, StoreError> {
        let (mut benchmarks, mut cards) = (Vec::new(), Vec::new());
        let mut listed = HashMap::new();
        for benchmark in store.benchmarks().await? {
            let mut entries = Vec::new();
            for submission in store.submissions(Listing::BoardWithoutScores(&benchmark)).await? {
                let known = self.known_scores(&submission.id);
                let scored = match known {
                    Some(scored) => scored,
                    None => match store.submission(&submission.id).await?.scores {
                        Some(scores) => work_out(scores).await?,
                        None => continue,
                    },
                };
                listed.insert(submission.id.clone(), scored.clone());
                entries.push(entry(submission, scored));
            }
            let scenes: Vec<(String, [usize; 3])> = benchmark
                .scenes
                .iter()
                .map(|scene| (scene.name.clone(), [scene.val, scene.easy, scene.hard]))
                .collect();
            let tables = Leaderboard::new(&benchmark.name, &scenes, &entries);
            cards.push(card(&benchmark, &tables));
            let same = known.and_then(|known| known.board(&benchmark.name).ok());
            let same = same.filter(|same| same.benchmark == benchmark && same.tables == tables);
            benchmarks
                .push(same.unwrap_or_else(|| Arc::new(Board { benchmark, tables, drawn: Mutex::default() })));
        }
        *self.scored.lock().unwrap_or_else(PoisonError::into_inner) = listed;
        Ok(Snapshot { revision, cards, benchmarks })
    }

    fn known_scores(&self, id: &str) -> Option<Scored> {
        self.scored.lock().unwrap_or_else(PoisonError::into_inner).get(id).cloned()
    }
}

/// Scores with their intervals. Takes some milliseconds, in which others are served.
async fn work_out(scores: Scores) -> Result<Scored, StoreError> {
    let worked = tokio::task::spawn_blocking(move || {
        let intervals = Intervals::of(&scores);
        (Arc::new(scores), intervals)
    });
    worked.await.map_err(|error| StoreError::Refused(error.to_string()))
}

/// A submission as an entry of a leaderboard: without what its user keeps to themselves.
fn entry(submission: SubmissionEntry, (scores, intervals): Scored) -> Entry {
    let is_public = submission.visibility == Visibility::Public;
    let unless_anonymous = |text: String| if is_public { text } else { String::new() };
    let about = About {
        id: submission.id,
        method: submission.method.name,
        authors: unless_anonymous(submission.method.authors),
        user: unless_anonymous(submission.user_name),
        baseline: submission.pinned,
        submitted_at: submission.submitted_at.to_string(),
        evaluator: scores.evaluator.clone(),
    };
    Entry { about: Arc::new(about), scores, intervals }
}

fn card(benchmark: &BenchmarkEntry, board: &Leaderboard) -> Card {
    let mut ids: Vec<&str> = board
        .tables
        .iter()
        .flat_map(|table| &table.rows)
        .filter(|row| !row.about.baseline)
        .map(|row| row.about.id.as_str())
        .collect();
    ids.sort_unstable();
    ids.dedup();
    let best = View::new(board, &ViewQuery::default()).ok().and_then(|view| {
        let table = board.table(view.split)?;
        let best = view.rows(table).into_iter().find(|row| !row.about.baseline)?;
        let psnr = Metric::Psnr.show(best.standing(Metric::Psnr).mean);
        Some((table.split, best.about.method.clone(), psnr))
    });
    let first = benchmark.scenes.first();
    Card {
        name: benchmark.name.clone(),
        scenes: benchmark.scenes.len(),
        images: benchmark.scenes.iter().map(|scene| scene.val + scene.easy + scene.hard).sum(),
        size: first.map_or((0, 0), |scene| (scene.width, scene.height)),
        open: benchmark.open,
        entries: ids.len(),
        best,
    }
}

impl Snapshot {
    /// The leaderboard of that benchmark.
    ///
    /// # Errors
    /// [`StoreError::Missing`].
    pub fn board(&self, name: &str) -> Result<Arc<Board>, StoreError> {
        let found = self.benchmarks.iter().find(|board| board.benchmark.name == name);
        found.cloned().ok_or_else(|| StoreError::Missing { what: "benchmark", name: name.to_owned() })
    }
}

/// A drawing, as it is sent to many.
#[derive(Clone, Debug)]
pub struct Drawn {
    plain: Bytes,
    /// The same, packed with gzip; only of what is drawn once for many and holds nobody's secret.
    packed: Option<Bytes>,
}

impl Drawn {
    fn plain(text: String) -> Drawn {
        Drawn { plain: Bytes::from(text), packed: None }
    }

    fn packed(self) -> Drawn {
        let mut encoder = GzEncoder::new(Vec::new(), Compression::default());
        // Writing to memory does not fail; if it did, the plain drawing would be sent.
        let packed = encoder.write_all(&self.plain).and_then(|()| encoder.finish());
        Drawn { packed: packed.ok().map(Bytes::from), ..self }
    }

    /// The answer that sends it to someone who asked with these headers.
    pub fn answer(self, kind: &'static str, asked: &HeaderMap) -> Response {
        let takes = asked.get(header::ACCEPT_ENCODING).and_then(|value| value.to_str().ok());
        let takes_gzip = takes.is_some_and(|list| {
            list.split(',').any(|one| {
                let (name, weight) = one.split_once(';').unwrap_or((one, ""));
                name.trim() == "gzip" && !["q=0", "q=0.0"].contains(&weight.trim())
            })
        });
        let headers = [(header::CONTENT_TYPE, kind), (header::VARY, "accept, accept-encoding, cookie")];
        match self.packed.filter(|_| takes_gzip) {
            Some(packed) => (headers, [(header::CONTENT_ENCODING, "gzip")], packed).into_response(),
            None => (headers, self.plain).into_response(),
        }
    }
}

impl Board {
    /// The page of a view.
    pub fn page(&self, view: &View, visitor: &Visitor) -> Drawn {
        let title = format!("{}, {}", self.benchmark.name, board::split_title(view.split).0);
        let whole = || {
            let middle =
                self.always(Drawing::Middle(view.clone()), || board::board(&self.tables, view).into_string());
            let middle = maud::PreEscaped(String::from_utf8_lossy(&middle.plain).into_owned());
            page(Some(visitor), &title, &middle).into_string()
        };
        match visitor.name {
            Some(_) => Drawn::plain(whole()),
            None => self.always(Drawing::Page(view.clone()), whole),
        }
    }

    /// The tables as JSON.
    ///
    /// # Errors
    /// [`ViewError`] for a query with a value that is not known.
    pub fn json(&self, query: &ViewQuery) -> Result<Drawn, ViewError> {
        self.kept(Drawing::Json(query.clone()), || {
            // Numbers, texts and lists: nothing that JSON cannot say.
            Ok(serde_json::to_string(&to_json(&self.tables, query)?).unwrap_or_default())
        })
    }

    /// The tables as CSV.
    ///
    /// # Errors
    /// [`ViewError`] for a query with a value that is not known.
    pub fn csv(&self, query: &ViewQuery) -> Result<Drawn, ViewError> {
        self.kept(Drawing::Csv(query.clone()), || to_csv(&self.tables, query))
    }

    /// As [`Board::kept`], for what can always be drawn.
    fn always(&self, drawing: Drawing, draw: impl FnOnce() -> String) -> Drawn {
        match self.kept(drawing, || Ok::<_, std::convert::Infallible>(draw())) {
            Ok(drawn) => drawn,
            Err(never) => match never {},
        }
    }

    /// What was drawn before, or what `draw` draws. Drawings that anyone can have in any number, by asking for ever other
    /// filters, are not kept.
    fn kept<E>(&self, drawing: Drawing, draw: impl FnOnce() -> Result<String, E>) -> Result<Drawn, E> {
        let lock = || self.drawn.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(drawn) = lock().get(&drawing) {
            return Ok(drawn.clone());
        }
        let drawn = Drawn::plain(draw()?);
        let is_filtered = match &drawing {
            Drawing::Middle(view) | Drawing::Page(view) => !view.filter.is_empty(),
            Drawing::Json(query) | Drawing::Csv(query) => query.q.is_some(),
        };
        if is_filtered || lock().len() >= KEPT {
            return Ok(drawn);
        }
        let drawn = match drawing {
            Drawing::Middle(_) => drawn,
            Drawing::Page(_) | Drawing::Json(_) | Drawing::Csv(_) => drawn.packed(),
        };
        lock().insert(drawing, drawn.clone());
        Ok(drawn)
    }
}
