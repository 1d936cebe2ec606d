//! CSV: one row a run and split, so that every number stands beside what made it.

use relight_scene::Split;
use relight_train::evaluation::Scores;

use crate::record::Record;
use crate::report::Report;
use crate::results::Method;
use crate::scoring::SPLITS;

/// The columns. `method` is a model, `mean-image` or `nearest-light`; `source` tells a model trained here (`run`) from the
/// paper's figures (`published`) and from what learns nothing (`baseline`).
const COLUMNS: [&str; 17] = [
    "scene",
    "method",
    "source",
    "split",
    "psnr",
    "ssim",
    "images",
    "seed",
    "preset",
    "budget_steps",
    "budget_minutes",
    "steps",
    "seconds",
    "device",
    "version",
    "commit",
    "run",
];

/// All scores, a line each, fields quoted as RFC 4180 has it.
pub fn write(report: &Report<'_>) -> String {
    let results = report.results;
    let mut text = line(&COLUMNS.map(str::to_owned));
    for (scene, _) in &results.scenes {
        let records: Vec<&Record> = results.records.iter().filter(|r| r.job.scene_name == *scene).collect();
        for record in &records {
            for split in SPLITS {
                if let Some(evaluation) = record.evaluation(split) {
                    let of = Scored {
                        scene,
                        split,
                        scores: evaluation.mean,
                        images: Some(evaluation.images.len()),
                    };
                    text += &of.line(&record.job.model, "run", Some(record));
                }
            }
        }
        for split in SPLITS {
            for method in results.methods() {
                let Some(entry) = results.entry(scene, &method, split) else { continue };
                let scores = Scores { psnr: entry.psnr.mean, ssim: entry.ssim.mean };
                let evaluation = records.iter().find_map(|record| record.evaluation(split));
                let images = evaluation.map(|evaluation| evaluation.images.len());
                text += &match method {
                    Method::Model(_) => continue,
                    Method::Published(model) => {
                        Scored { scene, split, scores, images: None }.line(&model, "published", None)
                    }
                    Method::MeanImage => {
                        Scored { scene, split, scores, images }.line("mean-image", "baseline", None)
                    }
                    Method::NearestLight => {
                        Scored { scene, split, scores, images }.line("nearest-light", "baseline", None)
                    }
                };
            }
        }
    }
    text
}

struct Scored<'a> {
    scene: &'a str,
    split: Split,
    scores: Scores,
    images: Option<usize>,
}

impl Scored<'_> {
    fn line(&self, method: &str, source: &str, record: Option<&Record>) -> String {
        let of = |pick: &dyn Fn(&Record) -> String| record.map(pick).unwrap_or_default();
        let number = |value: Option<f64>| value.map(|v| v.to_string()).unwrap_or_default();
        line(&[
            self.scene.to_owned(),
            method.to_owned(),
            source.to_owned(),
            self.split.to_string(),
            self.scores.psnr.to_string(),
            self.scores.ssim.to_string(),
            self.images.map(|n| n.to_string()).unwrap_or_default(),
            of(&|r| r.job.seed.to_string()),
            of(&|r| r.config.preset.clone()),
            of(&|r| r.config.budget.steps.map(|n| n.to_string()).unwrap_or_default()),
            of(&|r| number(r.config.budget.minutes)),
            of(&|r| r.made.steps.to_string()),
            of(&|r| number(Some(r.made.seconds))),
            of(&|r| r.made.device.clone()),
            of(&|r| r.made.version.clone()),
            of(&|r| r.made.commit.clone()),
            of(&|r| r.job.id.clone()),
        ])
    }
}

fn line(fields: &[String; COLUMNS.len()]) -> String {
    format!("{}\r\n", fields.iter().map(|field| quoted(field)).collect::<Vec<_>>().join(","))
}

fn quoted(field: &str) -> String {
    if field.contains([',', '"', '\n', '\r']) {
        format!("\"{}\"", field.replace('"', "\"\""))
    } else {
        field.to_owned()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn fields_are_quoted_where_they_must_be() {
        assert_eq!(quoted("cube 2"), "cube 2");
        assert_eq!(quoted("a,\"b\"\n"), "\"a,\"\"b\"\"\n\"");
    }
}
