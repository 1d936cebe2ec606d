//! One-light-at-a-time captures: cameras, lights, frames, and the folders that hold them.

mod bounds;

pub use bounds::Bounds;
