//! `relight serve` and its admin commands: the real program on a real port.

// Helpers outside of test functions unwrap too.
#![allow(clippy::unwrap_used)]

mod admin;
mod board;
mod fairness;
mod kills;
mod uploads;
mod visibility;
