//! One file a command.

pub mod bench;
pub mod capture;
pub mod compare;
pub mod demo;
pub mod eval;
pub mod export;
pub mod profile;
pub mod query;
pub mod render;
pub mod scene;
pub mod serve;
pub mod submit;
pub mod train;
