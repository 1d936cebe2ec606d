//! JSON: the tables, and every record that they were made of.

use serde::Serialize;

use crate::error::BenchError;
use crate::job::Settings;
use crate::record::Record;
use crate::report::{Kind, Report};
use crate::results::{Failure, SceneFacts};
use crate::table::Table;

/// Format and version of the file.
const FORMAT: &str = "relight-bench-tables-1";

#[derive(Serialize)]
#[serde(rename_all = "kebab-case")]
struct File<'a> {
    format: &'static str,
    kind: Kind,
    jobs: usize,
    settings: &'a Settings,
    scenes: Vec<SceneOf<'a>>,
    tables: &'a [Table],
    notes: &'a [String],
    failures: &'a [Failure],
    records: &'a [Record],
}

#[derive(Serialize)]
#[serde(rename_all = "kebab-case")]
struct SceneOf<'a> {
    name: &'a str,
    #[serde(flatten)]
    facts: Option<SceneFacts>,
}

/// The whole file.
pub fn write(report: &Report<'_>) -> Result<String, BenchError> {
    let results = report.results;
    let file = File {
        format: FORMAT,
        kind: report.kind,
        jobs: results.jobs,
        settings: &results.settings,
        scenes: results.scenes.iter().map(|(name, facts)| SceneOf { name, facts: *facts }).collect(),
        tables: &report.tables,
        notes: &report.notes,
        failures: &results.failures,
        records: &results.records,
    };
    serde_json::to_string_pretty(&file).map_err(|e| BenchError::Jobs(e.to_string()))
}
