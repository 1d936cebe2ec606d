//! The paper's two tables, on any scenes: which trainings they need, what came of each, and the tables as files.
//!
//! A [`JobList`] holds the trainings, scene by model by seed, each with an id that never changes. A [`Record`] is what a
//! finished one leaves: its scores, and all that tells how they came about. [`Results`] gathers the records that a
//! table is made of, [`Report`] makes the tables of them and writes each as Markdown, LaTeX, CSV, JSON and HTML.
//! [`side_by_side`](side_by_side()) does jobs together, within the machine's memory.

mod ablation;
mod benchmark;
mod error;
mod formats;
mod job;
mod memory;
mod numbers;
mod pictures;
mod published;
mod record;
mod report;
pub mod report_page;
mod results;
mod scoring;
mod side_by_side;
mod table;
#[cfg(test)]
mod tests;
mod versioned;

pub use error::BenchError;
pub use job::{Job, JobList, Settings};
pub use memory::{Need, available_memory};
pub use record::{Made, Outcome, Record, Shown, SplitRecord};
pub use report::{Kind, Report};
pub use results::{Failure, Results, SceneFacts};
pub use scoring::{Scored, score};
pub use side_by_side::{Ended, side_by_side};
