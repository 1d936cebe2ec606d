//! Where surfaces are, from the training photographs alone: a start for the geometry of the field.
//!
//! A radiance field that starts from nothing first fills its box with fog, and fine texture does not lead it out:
//! cloth correlates across cameras only within a few millimetres of its true depth. But in a one-light-at-a-time
//! capture every pixel comes with a vector of brightnesses, one a light, that is nearly the same from every camera
//! for a point of a surface and different for most other points. Matching those vectors by a plane sweep (Collins
//! 1996), keeping what several cameras agree on, gives depths good to a pixel of a small picture in seconds. They
//! only say where to look first; the field may overrule them.

mod cache;
mod consistency;
mod descriptor;
mod prior;
mod sweep;

pub use cache::Source;
pub use prior::{DepthPrior, GoOn, StereoSettings};
