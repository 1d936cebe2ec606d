//! The tables with all that must stand below them, and the files that hold them.

use std::collections::{BTreeMap, BTreeSet};
use std::io::Write;
use std::path::{Path, PathBuf};

use relight_scene::Split;
use relight_train::run::write_whole;
use serde::Serialize;

use crate::error::BenchError;
use crate::formats::{csv, html, json, latex, markdown};
use crate::record::Outcome;
use crate::results::Results;
use crate::table::Table;
use crate::{ablation, benchmark, published};

/// One of the paper's two tables.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Kind {
    /// What each change of the architecture brings.
    Ablation,
    /// Every scene, on easy and hard.
    Benchmark,
}

impl Kind {
    /// Its name, of which those of its files are made.
    pub fn name(self) -> &'static str {
        match self {
            Self::Ablation => "ablation",
            Self::Benchmark => "benchmark",
        }
    }

    pub(crate) fn title(self) -> &'static str {
        match self {
            Self::Ablation => "Ablation",
            Self::Benchmark => "Benchmark",
        }
    }
}

/// Tables of what there is so far.
#[derive(Debug)]
pub struct Report<'a> {
    pub(crate) kind: Kind,
    pub(crate) results: &'a Results,
    pub(crate) tables: Vec<Table>,
    /// Whole sentences that belong below every table.
    pub(crate) notes: Vec<String>,
}

impl<'a> Report<'a> {
    /// Makes the tables.
    pub fn new(kind: Kind, results: &'a Results) -> Self {
        let tables = match kind {
            Kind::Ablation => ablation::tables(results),
            Kind::Benchmark => benchmark::tables(results),
        };
        Self { kind, results, tables, notes: notes(results) }
    }

    /// The tables as Markdown, whose columns stand below each other.
    pub fn markdown(&self) -> String {
        markdown::write(self)
    }

    /// Writes the tables into the folder `out` as `.md`, `.tex`, `.csv`, `.json` and `.html`, each whole or not at all, and
    /// tells their paths.
    ///
    /// # Errors
    /// [`BenchError::Train`] if a file cannot be written.
    pub fn write(&self, out: &Path) -> Result<Vec<PathBuf>, BenchError> {
        let files = [
            ("md", self.markdown()),
            ("tex", latex::write(self)),
            ("csv", csv::write(self)),
            ("json", json::write(self)?),
            ("html", html::write(self)),
        ];
        let name = self.kind.name();
        files
            .into_iter()
            .map(|(extension, text)| {
                let path = out.join(format!("{name}.{extension}"));
                write_whole(&path, |file| file.write_all(text.as_bytes()))?;
                Ok(path)
            })
            .collect()
    }

    /// How many of the jobs are done, if not all are.
    pub(crate) fn unfinished(&self) -> Option<String> {
        let (done, all) = (self.results.records.len(), self.results.jobs);
        (done < all).then(|| format!("{done} of {all} runs are done; what is missing is marked –."))
    }
}

fn notes(results: &Results) -> Vec<String> {
    let mut notes = vec![how(results)];
    notes.push(
        "PSNR in dB and SSIM (11x11 Gaussian window of sigma 1.5) of 8-bit pictures, averaged over the images of a split. \
         Validation: held-out images of cameras that choose the weights. Easy: unseen cameras under training lights. Hard: \
         unseen cameras under unseen lights."
            .to_owned(),
    );
    notes.push(
        "Mean image: the mean of all training images. Nearest light: the image of the nearest training camera under the \
         nearest training light. Neither learns anything."
            .to_owned(),
    );
    if results.seeds.len() > 1 {
        notes.push("±: standard deviation over seeds.".to_owned());
    }
    notes.extend(sizes(results));
    if results.scenes.len() > 1 {
        notes.extend([Split::Val, Split::Easy, Split::Hard].iter().filter_map(|&split| {
            let (common, all) = (results.common(split), results.scenes.len());
            (!common.is_empty() && common.len() < all).then(|| {
                let title = ablation::title(split).to_lowercase();
                format!(
                    "Mean on {title}: over {} of {all} scenes, those that every model was scored on.",
                    common.len()
                )
            })
        }));
    }
    notes.extend(skipped(results));
    notes.extend(
        results.failures.iter().map(|f| format!("{} failed: {}.", f.job, f.reason.trim_end_matches('.'))),
    );
    notes
}

/// How the runs were trained, and by what.
fn how(results: &Results) -> String {
    let seeds = list(results.seeds.iter().map(u32::to_string));
    let plural = if results.seeds.len() > 1 { "seeds" } else { "seed" };
    let made: BTreeSet<String> = results
        .records
        .iter()
        .map(|r| format!("relight {} ({}), {}", r.made.version, r.made.commit, r.made.device))
        .collect();
    let by = if made.is_empty() { String::new() } else { format!(", by {}", list(made)) };
    format!("Trained with {}, {plural} {seeds}{by}.", results.settings.told())
}

/// Why published figures are there, or are not.
fn sizes(results: &Results) -> Vec<String> {
    let mut notes = Vec::new();
    if results.scenes.iter().any(|(scene, _)| results.is_official(scene)) {
        notes.push(format!("Published: {}.", published::SOURCE));
    }
    let mut by_size = BTreeMap::<Option<[u32; 2]>, Vec<&str>>::new();
    for (scene, facts) in &results.scenes {
        if let Some(facts) = facts
            && facts.size != Some(published::SIZE)
        {
            by_size.entry(facts.size).or_default().push(scene);
        }
    }
    for (size, scenes) in by_size {
        let scenes = list(scenes.into_iter().map(str::to_owned));
        let size = size.map_or("images of several sizes".to_owned(), |[w, h]| format!("{w}x{h} pixels"));
        let [w, h] = published::SIZE;
        notes.push(format!(
            "{scenes}: {size}. Scores at reduced resolution are higher: they cannot be compared with published ones, which are \
             of {w}x{h}."
        ));
    }
    notes
}

/// Why splits were not scored: one note a reason.
fn skipped(results: &Results) -> Vec<String> {
    let mut reasons = BTreeMap::<&str, BTreeMap<&str, Vec<&str>>>::new();
    for record in &results.records {
        for split in &record.splits {
            if let Outcome::Skipped(reason) = &split.outcome {
                let scenes = reasons.entry(reason).or_default();
                let splits = scenes.entry(&record.job.scene_name).or_default();
                let title = ablation::title(split.split);
                if !splits.contains(&title) {
                    splits.push(title);
                }
            }
        }
    }
    let told = |(reason, scenes): (&str, BTreeMap<&str, Vec<&str>>)| {
        let of_scene = scenes.iter().map(|(scene, splits)| {
            format!("{scene} ({})", list(splits.iter().map(|split| split.to_lowercase())))
        });
        format!("Not scored: {}: {reason}.", list(of_scene))
    };
    reasons.into_iter().map(told).collect()
}

/// `a`, `a and b`, `a, b and c`.
fn list(words: impl IntoIterator<Item = String>) -> String {
    let words: Vec<String> = words.into_iter().collect();
    match words.split_last() {
        None => String::new(),
        Some((last, [])) => last.clone(),
        Some((last, others)) => format!("{} and {last}", others.join(", ")),
    }
}
