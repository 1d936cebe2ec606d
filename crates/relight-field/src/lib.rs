//! The relightable radiance field, as the paper says it.

pub mod architecture;
pub mod engine;
pub mod parameters;
pub mod random;
pub mod sampling;
