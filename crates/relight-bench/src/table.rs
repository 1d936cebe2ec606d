//! A table, before it is written in any format.

use serde::Serialize;

use crate::numbers::Figure;

/// Scores of several methods: a row a method, a pair of columns (PSNR and SSIM) a group.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub(crate) struct Table {
    /// What it shows.
    pub title: String,
    /// Heads of the leading columns, which hold words.
    pub stubs: Vec<String>,
    /// What each pair of columns is about.
    pub groups: Vec<String>,
    /// The rows.
    pub rows: Vec<Row>,
}

/// A row.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub(crate) struct Row {
    /// The leading columns.
    pub stubs: Vec<String>,
    /// Whose scores they are.
    pub kind: RowKind,
    /// Whether a new block begins with it.
    pub begins: bool,
    /// One a group; `None` where there are no scores.
    pub entries: Vec<Option<Entry>>,
}

/// Whose scores a row holds.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub(crate) enum RowKind {
    /// Of models trained here.
    Model,
    /// Of the paper.
    Published,
    /// Of what can be had without learning.
    Baseline,
}

/// Scores.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub(crate) struct Entry {
    /// PSNR, dB.
    pub psnr: Figure,
    /// SSIM.
    pub ssim: Figure,
    /// Whether PSNR and SSIM are the best of the models in their block.
    pub best: [bool; 2],
    /// Ids of the jobs that they come from; none for published ones.
    pub runs: Vec<String>,
}

impl Row {
    /// PSNR and SSIM of a group, as they are printed: published ones with the paper's digits.
    pub fn told(&self, group: usize) -> Option<[String; 2]> {
        let entry = self.entries.get(group)?.as_ref()?;
        let digits = if self.kind == RowKind::Published { 2 } else { 3 };
        Some([entry.psnr.told(2), entry.ssim.told(digits)])
    }
}

impl Table {
    /// Marks the best of the models in each block, as far as the printed digits tell, where a block has several.
    pub fn mark_best(&mut self) {
        for group in 0..self.groups.len() {
            let mut start = 0;
            while start < self.rows.len() {
                let length = self.rows[start + 1..].iter().take_while(|row| !row.begins).count() + 1;
                mark(&mut self.rows[start..start + length], group);
                start += length;
            }
        }
    }
}

/// Marks the best of one block in one group.
fn mark(block: &mut [Row], group: usize) {
    let models = block.iter_mut().filter(|row| row.kind == RowKind::Model);
    let mut entries: Vec<&mut Entry> =
        models.filter_map(|row| row.entries.get_mut(group)?.as_mut()).collect();
    if entries.len() < 2 {
        return;
    }
    for metric in 0..2 {
        let printed = |entry: &Entry| {
            let figure = [entry.psnr, entry.ssim][metric];
            Figure { deviation: None, ..figure }.told(2 + metric)
        };
        let mean = |entry: &Entry| [entry.psnr, entry.ssim][metric].mean;
        let best = entries.iter().max_by(|a, b| mean(a).total_cmp(&mean(b))).map(|entry| printed(entry));
        for entry in &mut entries {
            entry.best[metric] = Some(printed(entry)) == best;
        }
    }
}
