//! One-light-at-a-time captures: cameras, lights, frames, and the folders that hold them.
//!
//! [`Scene::open`] reads a folder in any of the known formats, [`check()`] lists all that is wrong with it,
//! [`Splits`] says which frames train and which score, and [`PixelStore`] holds the training pixels.
//!
//! World: metres, right-handed, +Z up. Poses are to-world. Camera axes as OpenCV's (+X right, +Y down, +Z forward),
//! pixel centres at integers, distortion as OpenCV's. Pictures are sRGB, 8 bits, row-major, origin at the top left.

mod bounds;
mod cache_file;
mod camera;
mod check;
mod conventions;
mod distortion;
pub mod drawing;
mod error;
mod files;
mod focus;
mod formats;
mod frame;
mod frustum;
mod image_file;
mod info;
mod light;
mod pixel_store;
mod pose;
pub mod random;
mod reading;
mod scene;
mod sheet;
mod splits;
mod vector;

pub use bounds::{Bounds, BoundsFault, check_bounds, scene_bounds};
pub use cache_file::{CacheEntry, CacheKind, fnv1a};
pub use camera::{Camera, Intrinsics};
pub use check::{Report, check};
pub use error::{Fault, FaultKind, SceneError, Severity};
pub use files::{UNFINISHED, read_bytes, read_text, write_whole};
pub use focus::focus;
pub use formats::ReneWriter;
pub use frame::Frame;
pub use frustum::Frustum;
pub use image_file::{Image, decode_image, read_image};
pub use info::{SceneInfo, SplitCounts};
pub use light::Light;
pub use pixel_store::PixelStore;
pub use pose::{Pose, PoseFault};
pub use scene::{Layout, Scene};
pub use sheet::contact_sheet;
pub use splits::{Split, Splits};

#[cfg(test)]
mod tests;
