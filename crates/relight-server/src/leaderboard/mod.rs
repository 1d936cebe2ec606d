//! Leaderboards: the scores of many entries beside each other, for each split of a benchmark.
//!
//! A table holds nothing but what may be told: every number is rounded to the digits of [`Metric::digits`] when it enters, so no
//! page, file or answer made of it can hold more. Ranks are ranks of the rounded scores: whoever has the table has all that they
//! are made of.

mod bootstrap;
mod export;
mod ranks;
mod view;

use std::sync::Arc;

use rayon::prelude::*;
use relight_scene::Split;

use crate::benchmark::SCORED;
use crate::scoring::{Mean, Scores};
use bootstrap::deviations;
use ranks::ranks;

pub use bootstrap::{CONFIDENCE, RESAMPLES};
pub use export::{JsonBoard, to_csv, to_json};
pub(crate) use view::percent_encoded;
pub use view::{Column, View, ViewError, ViewQuery};

/// What images are compared by.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Metric {
    /// Peak signal-to-noise ratio, decibels.
    Psnr,
    /// Structural similarity with a Gaussian window.
    Ssim,
}

impl Metric {
    /// All of them, in the order of the tables.
    pub const ALL: [Metric; 2] = [Metric::Psnr, Metric::Ssim];

    /// Its name in addresses and files.
    pub fn as_str(self) -> &'static str {
        match self {
            Metric::Psnr => "psnr",
            Metric::Ssim => "ssim",
        }
    }

    /// Its name on pages.
    pub fn title(self) -> &'static str {
        match self {
            Metric::Psnr => "PSNR",
            Metric::Ssim => "SSIM",
        }
    }

    /// Digits behind the point in tables.
    pub fn digits(self) -> usize {
        match self {
            Metric::Psnr => 2,
            Metric::Ssim => 3,
        }
    }

    /// To the digits of tables; `None` if not finite.
    pub fn told(self, value: f64) -> Option<f64> {
        let scale = 10f64.powi(self.digits() as i32);
        value.is_finite().then(|| (value * scale).round() / scale)
    }

    /// As tables show a number; the infinite PSNR of equal images as ∞.
    pub fn show(self, value: Option<f64>) -> String {
        value.map_or_else(|| "∞".to_owned(), |value| format!("{value:.*}", self.digits()))
    }

    fn of(self, mean: &Mean) -> f64 {
        match self {
            Metric::Psnr => mean.psnr,
            Metric::Ssim => mean.ssim,
        }
    }
}

/// What is told of an entry besides its scores. What its user keeps to themselves is empty.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct About {
    /// The submission's name.
    pub id: String,
    /// The method's name.
    pub method: String,
    /// Who made it.
    pub authors: String,
    /// Whose entry it is.
    pub user: String,
    /// Whether it is pinned: it stands at the end of every table, whatever the order.
    pub baseline: bool,
    /// When it was submitted, RFC 3339.
    pub submitted_at: String,
    /// The version of what scored it.
    pub evaluator: String,
}

/// An entry whose scores are final.
#[derive(Clone, Debug)]
pub struct Entry {
    /// What is told of it.
    pub about: Arc<About>,
    /// Its scores, with all digits.
    pub scores: Arc<Scores>,
    /// The intervals of its means: [`Intervals::of`] its scores. Apart, for they take long and never change.
    pub intervals: Intervals,
}

/// How far below and above a mean its interval ends; `None` if not all scores are finite.
type Ends = Option<(f64, f64)>;

/// By how much the true mean may differ, by split and metric.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Intervals(Vec<(Split, [Ends; 2])>);

impl Intervals {
    /// Works them out: some 15 ms for a whole ReNe submission.
    pub fn of(scores: &Scores) -> Intervals {
        let of_split = |mean: &Mean| (mean.split, deviations(&scores.images, mean.split));
        Intervals(scores.means.par_iter().map(of_split).collect())
    }

    fn get(&self, split: Split, metric: Metric) -> Option<(f64, f64)> {
        self.0.iter().find(|(of, _)| *of == split).and_then(|(_, intervals)| intervals[metric as usize])
    }
}

/// A score, and where it stands.
#[derive(Clone, Debug, PartialEq)]
pub struct Standing {
    /// Mean over images, then scenes; `None` if infinite.
    pub mean: Option<f64>,
    /// Bootstrap interval of the mean; `None` if that is infinite.
    pub interval: Option<(f64, f64)>,
    /// Mean of each of the table's scenes; `None` if infinite.
    pub scenes: Vec<Option<f64>>,
    /// Mean over scenes of the entry's rank in the scene; 1 is best.
    pub rank: f64,
}

/// An entry in a table.
#[derive(Clone, Debug, PartialEq)]
pub struct Row {
    /// Whose scores they are.
    pub about: Arc<About>,
    standings: [Standing; 2],
}

impl Row {
    /// What it scores by a metric.
    pub fn standing(&self, metric: Metric) -> &Standing {
        &self.standings[metric as usize]
    }
}

/// All entries that have scores of a split.
#[derive(Clone, Debug, PartialEq)]
pub struct Table {
    /// The split.
    pub split: Split,
    /// Its scenes.
    pub scenes: Vec<String>,
    /// Images of it that every entry shows.
    pub images: usize,
    /// Its entries, by submission's name.
    pub rows: Vec<Row>,
}

/// The tables of a benchmark.
#[derive(Clone, Debug, PartialEq)]
pub struct Leaderboard {
    /// The benchmark's name.
    pub benchmark: String,
    /// One of each split that the benchmark has, whether or not there are entries.
    pub tables: Vec<Table>,
}

impl Table {
    /// The place of a row among those that compete, by its mean, whatever is shown of the table and in which order; those that are
    /// equal share the better one.
    pub fn place(&self, row: &Row, metric: Metric) -> usize {
        // Without errors PSNR has no finite value, and is above all others.
        let height = |row: &Row| row.standing(metric).mean.unwrap_or(f64::INFINITY);
        1 + self.rows.iter().filter(|other| !other.about.baseline && height(other) > height(row)).count()
    }
}

impl Leaderboard {
    /// Sets entries beside each other. `scenes` are the benchmark's, each with its number of validation, easy and hard images (the
    /// order of [`SCORED`]). The order of the entries does not matter; one that lacks a scene of a split is not in its table.
    pub fn new(benchmark: &str, scenes: &[(String, [usize; 3])], entries: &[Entry]) -> Leaderboard {
        let tables = SCORED.iter().enumerate().filter_map(|(index, &split)| {
            let scenes = scenes.iter().filter(|(_, images)| images[index] > 0);
            let (scenes, images): (Vec<String>, Vec<usize>) =
                scenes.map(|(name, images)| (name.clone(), images[index])).unzip();
            (!scenes.is_empty()).then(|| Table::new(split, scenes, images.iter().sum(), entries))
        });
        Leaderboard { benchmark: benchmark.to_owned(), tables: tables.collect() }
    }

    /// The table of a split.
    pub fn table(&self, split: Split) -> Option<&Table> {
        self.tables.iter().find(|table| table.split == split)
    }
}

impl Table {
    fn new(split: Split, scenes: Vec<String>, images: usize, entries: &[Entry]) -> Table {
        let mut rows: Vec<Row> = entries.iter().filter_map(|entry| row(split, &scenes, entry)).collect();
        rows.sort_by(|a, b| a.about.id.cmp(&b.about.id));
        for metric in Metric::ALL {
            for scene in 0..scenes.len() {
                let scores: Vec<Option<f64>> =
                    rows.iter().map(|row| row.standing(metric).scenes[scene]).collect();
                for (row, rank) in rows.iter_mut().zip(ranks(&scores)) {
                    row.standings[metric as usize].rank += rank / scenes.len() as f64;
                }
            }
        }
        Table { split, scenes, images, rows }
    }
}

/// The row of an entry, without ranks; `None` if it does not show the whole split.
fn row(split: Split, scenes: &[String], entry: &Entry) -> Option<Row> {
    let of_split = |means: &[Mean]| means.iter().find(|mean| mean.split == split).copied();
    let mean = of_split(&entry.scores.means)?;
    let of_scenes: Vec<Mean> = scenes
        .iter()
        .map(|name| {
            let scene = entry.scores.scenes.iter().find(|scene| scene.scene == *name)?;
            of_split(&scene.means)
        })
        .collect::<Option<_>>()?;
    let standing = |metric: Metric| {
        let interval = entry.intervals.get(split, metric).and_then(|(low, high)| {
            let exact = metric.of(&mean);
            Some((metric.told(exact + low)?, metric.told(exact + high)?))
        });
        Standing {
            mean: metric.told(metric.of(&mean)),
            interval,
            scenes: of_scenes.iter().map(|mean| metric.told(metric.of(mean))).collect(),
            rank: 0.0,
        }
    };
    Some(Row { about: entry.about.clone(), standings: Metric::ALL.map(standing) })
}

#[cfg(test)]
mod tests;
