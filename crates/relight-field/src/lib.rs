//! The relightable radiance field, as the paper says it.

pub mod architecture;
pub mod compositing;
pub mod encoding;
pub mod engine;
pub mod network;
pub mod optimiser;
pub mod parameters;
pub mod real;
pub mod reference;
pub mod sampling;
pub mod tensor_file;
pub mod weights_file;

/// Random numbers by counter.
pub use relight_scene::random;
