//! Training a relightable field on a scene, and scoring it.
//!
//! A [`Recipe`](recipe::Recipe) says how to train, a [`RunFolder`](run::RunFolder) holds what comes of it, and a
//! [`Trainer`](trainer::Trainer) drives any engine from the one to the other:
//! rays are drawn ([`batch`]), a step is taken with the weights that its [`schedule`] gives, every epoch the
//! validation split is scored ([`validation`]), and a [`checkpoint`] lets the very same run go on after a kill.
//! [`evaluation`] scores the result, with the trivial [`baselines`] beside.

pub mod baselines;
pub mod batch;
pub mod checkpoint;
mod directions;
mod error;
pub mod evaluation;
pub mod fineness;
pub mod guide_file;
mod metrics_log;
mod picture;
pub mod recipe;
pub mod run;
pub mod schedule;
pub mod trainer;
pub mod validation;

pub use error::TrainError;
pub use metrics_log::Report;
