//! `relight serve` and its admin commands: the real program on a real port.

// Helpers outside of test functions unwrap too.
#![allow(clippy::unwrap_used)]

mod admin;
mod board;
#[path = "../common/mod.rs"]
mod common;
#[path = "../../../../crates/relight-server/tests/fair/mod.rs"]
mod fair;
mod fairness;
#[cfg(target_os = "linux")]
mod hostile;
mod kills;
mod readers;
mod round_trip;
mod uploads;
mod visibility;
