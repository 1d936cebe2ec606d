//! Pictures from any engine: rays of a camera, maps, files, camera and light paths, video.
//!
//! [`render`] draws a [`Picture`] of a field from a camera under a light; a [`Map`] of it becomes an 8-bit image or a
//! file. [`paths`] moves the camera or the light, and a [`Film`] takes the frames.

mod dome;
mod error;
mod files;
mod film;
mod frames;
mod interpolation;
mod maps;
mod path_file;
pub mod paths;
mod picture;
mod pixel_order;
mod placement;
mod rays;
mod video;

pub use error::RenderError;
pub use files::{check_picture_name, write_exr, write_picture};
pub use film::Film;
pub use maps::Map;
pub use picture::{Picture, check_size, render};
pub use placement::{LightName, named_camera};
pub use rays::camera_rays;
