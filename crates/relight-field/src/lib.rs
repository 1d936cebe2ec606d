//! The relightable radiance field, as the paper says it.

pub mod architecture;
pub mod engine;
pub mod parameters;
