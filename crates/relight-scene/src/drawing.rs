//! Lines, discs and letters on a picture, and the poses of a rig seen in 3D.

mod canvas;
mod view;

pub use canvas::{BACKGROUND, Canvas, Colour};
pub use view::View;
