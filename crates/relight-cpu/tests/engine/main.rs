//! The fast engine against the plain one, and against itself.
// Helpers outside test functions unwrap too.
#![allow(clippy::unwrap_used)]

mod common;
mod errors;
mod gradients;
mod pictures;
mod precision;
mod repeatability;
mod samples;
mod shadows;
mod steps;
mod surveys;
mod unseen;
