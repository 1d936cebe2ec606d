//! The benchmark server, and the rules of the benchmark that hold offline too.
//!
//! [`Benchmark`](benchmark::Benchmark) is a folder of scenes, [`submission::inspect`] and [`submission::check`] hold a zip
//! against it, and [`scoring::score`] compares its images with the ground truth. All three are plain functions of files: the
//! command line runs the same rules offline.
//!
//! [`server::serve`] takes submissions in over HTTP ([`api`]), keeps them in a [`data_folder`] and a [`store`], and has them
//! scored, one after another, by child processes ([`worker`]).

pub mod accounts;
pub mod admin;
pub mod api;
pub mod app;
pub mod backup;
pub mod benchmark;
pub mod data_folder;
pub mod digest;
pub mod disclosure;
pub mod leaderboard;
pub mod limits;
pub mod method;
pub mod metrics;
pub mod pages;
mod parallel;
pub mod receipt;
pub mod retention;
pub mod scoring;
pub mod server;
pub mod store;
pub mod submission;
mod text;
pub mod time;
pub mod upload;
pub mod worker;

pub use parallel::Progress;
