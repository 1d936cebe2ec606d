//! Benchmarks of scenes: what is asked of a submission, whether a zip is one, and how well it does.
//!
//! [`Benchmark`](benchmark::Benchmark) is a folder of scenes, [`submission::inspect`] and [`submission::check`] hold a zip
//! against it, and [`scoring::score`] compares its images with the ground truth. All three are plain functions of files: the
//! command line runs the same rules offline.

pub mod benchmark;
pub mod leaderboard;
mod parallel;
pub mod scoring;
pub mod submission;

pub use parallel::Progress;
