//! A table as someone asks to see it: which split and metric, in which order, which entries.

use relight_scene::Split;
use serde::Deserialize;

use super::{Leaderboard, Metric, Row, Table};

/// What an address asks for. All may be left out.
#[derive(Clone, Debug, Default, PartialEq, Eq, Hash, Deserialize)]
pub struct ViewQuery {
    /// `val`, `easy` or `hard`.
    pub split: Option<String>,
    /// `psnr` or `ssim`.
    pub metric: Option<String>,
    /// A column: see [`Column`].
    pub sort: Option<String>,
    /// `asc` or `desc`.
    pub order: Option<String>,
    /// What methods, authors or users must contain.
    pub q: Option<String>,
}

/// Why a table cannot be shown as asked.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{parameter}={value:?} is not known here. Use one of: {known}")]
pub struct ViewError {
    /// The parameter of the address.
    pub parameter: &'static str,
    /// Its value.
    pub value: String,
    /// What is known.
    pub known: String,
}

/// A column to sort by.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Column {
    /// `method`: its name.
    Method,
    /// `psnr` and `ssim`: the mean.
    Mean(Metric),
    /// `rank`: the average rank by the view's metric.
    Rank,
    /// `submitted`: when.
    Submitted,
    /// `scene:NAME`: the mean of that scene by the view's metric; its index in the table.
    Scene(usize),
}

impl Column {
    /// Its name in addresses.
    pub fn name(self, table: &Table) -> String {
        match self {
            Column::Method => "method".to_owned(),
            Column::Mean(metric) => metric.as_str().to_owned(),
            Column::Rank => "rank".to_owned(),
            Column::Submitted => "submitted".to_owned(),
            Column::Scene(index) => {
                format!("scene:{}", table.scenes.get(index).map_or("", String::as_str))
            }
        }
    }

    /// Whether the best, or the newest, comes first if it falls.
    pub fn falls_by_default(self) -> bool {
        !matches!(self, Column::Method | Column::Rank)
    }

    fn find(name: &str, table: &Table) -> Option<Column> {
        let plain = [
            Column::Method,
            Column::Mean(Metric::Psnr),
            Column::Mean(Metric::Ssim),
            Column::Rank,
            Column::Submitted,
        ];
        let scenes = (0..table.scenes.len()).map(Column::Scene);
        plain.into_iter().chain(scenes).find(|column| column.name(table) == name)
    }
}

/// A table as it is to be shown.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub struct View {
    /// The table's split.
    pub split: Split,
    /// What ranks and scenes are told by.
    pub metric: Metric,
    /// What rows are sorted by.
    pub column: Column,
    /// Whether values fall from row to row.
    pub falls: bool,
    /// What methods, authors or users must contain; empty for all.
    pub filter: String,
}

impl View {
    /// What an address asks for, and otherwise the easy split by PSNR, the best first.
    ///
    /// # Errors
    /// [`ViewError`] for a value that is not known.
    pub fn new(board: &Leaderboard, query: &ViewQuery) -> Result<View, ViewError> {
        let unknown = |parameter, value: &str, known: String| {
            Err(ViewError { parameter, value: value.chars().take(100).collect(), known })
        };
        let splits = || {
            let names: Vec<String> = board.tables.iter().map(|table| table.split.to_string()).collect();
            names.join(", ")
        };
        let table = match query.split.as_deref() {
            Some(name) => board.tables.iter().find(|table| table.split.to_string() == name),
            None => board.table(Split::Easy).or(board.tables.first()),
        };
        let Some(table) = table else {
            return unknown("split", query.split.as_deref().unwrap_or(""), splits());
        };
        let metric = match query.metric.as_deref() {
            None => Metric::Psnr,
            Some(name) => match Metric::ALL.into_iter().find(|metric| metric.as_str() == name) {
                Some(metric) => metric,
                None => return unknown("metric", name, "psnr, ssim".to_owned()),
            },
        };
        let column = match query.sort.as_deref() {
            None => Column::Mean(metric),
            Some(name) => match Column::find(name, table) {
                Some(column) => column,
                None => {
                    let known = "method, psnr, ssim, rank, submitted, scene:NAME";
                    return unknown("sort", name, known.to_owned());
                }
            },
        };
        let falls = match query.order.as_deref() {
            None => column.falls_by_default(),
            Some("asc") => false,
            Some("desc") => true,
            Some(other) => return unknown("order", other, "asc, desc".to_owned()),
        };
        let filter = query.q.as_deref().unwrap_or("").trim().chars().take(200).collect();
        Ok(View { split: table.split, metric, column, falls, filter })
    }

    /// Rows in order: those that compete, then the baselines. Those that are equal: the best mean first, then the oldest.
    pub fn rows<'a>(&self, table: &'a Table) -> Vec<&'a Row> {
        let wanted = self.filter.to_lowercase();
        let has = |text: &str| text.to_lowercase().contains(&wanted);
        let mut rows: Vec<&Row> = table
            .rows
            .iter()
            .filter(|row| {
                let about = &row.about;
                about.baseline || has(&about.method) || has(&about.authors) || has(&about.user)
            })
            .collect();
        let height = |score: Option<f64>| score.unwrap_or(f64::INFINITY);
        let mean = |row: &Row| height(row.standing(self.metric).mean);
        rows.sort_by(|a, b| {
            let (one, other) = (a.standing(self.metric), b.standing(self.metric));
            let rising = match self.column {
                Column::Method => a.about.method.to_lowercase().cmp(&b.about.method.to_lowercase()),
                Column::Mean(metric) => {
                    height(a.standing(metric).mean).total_cmp(&height(b.standing(metric).mean))
                }
                Column::Rank => one.rank.total_cmp(&other.rank),
                Column::Submitted => a.about.submitted_at.cmp(&b.about.submitted_at),
                Column::Scene(scene) => height(one.scenes[scene]).total_cmp(&height(other.scenes[scene])),
            };
            let chosen = if self.falls { rising.reverse() } else { rising };
            a.about
                .baseline
                .cmp(&b.about.baseline)
                .then(chosen)
                .then(mean(b).total_cmp(&mean(a)))
                .then(a.about.submitted_at.cmp(&b.about.submitted_at))
                .then(a.about.id.cmp(&b.about.id))
        });
        rows
    }

    /// The address's query that asks for this view.
    pub fn to_query(&self, table: &Table) -> String {
        let mut query = format!("?split={}&metric={}", self.split, self.metric.as_str());
        if self.column != Column::Mean(self.metric) || self.falls != self.column.falls_by_default() {
            let order = if self.falls { "desc" } else { "asc" };
            query += &format!("&sort={}&order={order}", percent_encoded(&self.column.name(table)));
        }
        if !self.filter.is_empty() {
            query += &format!("&q={}", percent_encoded(&self.filter));
        }
        query
    }
}

/// For a part of an address (RFC 3986): all but unreserved characters as %XX of their UTF-8.
pub(crate) fn percent_encoded(text: &str) -> String {
    let mut encoded = String::with_capacity(text.len());
    for byte in text.bytes() {
        match byte {
            b'A'..=b'Z' | b'a'..=b'z' | b'0'..=b'9' | b'-' | b'.' | b'_' | b'~' => {
                encoded.push(char::from(byte));
            }
            _ => encoded += &format!("%{byte:02X}"),
        }
    }
    encoded
}
