//! The field as a whole: weights, gradients, golden values, files, training.

#![allow(clippy::unwrap_used)]

mod golden;
mod gradients;
mod parameters;
mod tiny;
mod training;
mod weights_file;
