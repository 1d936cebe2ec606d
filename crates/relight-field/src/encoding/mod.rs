//! What the networks are told instead of bare coordinates.

pub mod fourier;
pub mod hash_grid;
pub mod spherical_harmonics;
