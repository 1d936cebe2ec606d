//! One image: a camera under a light.

use std::path::PathBuf;

/// An image of a scene.
#[derive(Clone, Debug, PartialEq)]
pub struct Frame {
    /// Index into the scene's cameras.
    pub camera: usize,
    /// Index into the scene's lights.
    pub light: usize,
    /// The image file.
    pub path: PathBuf,
}
