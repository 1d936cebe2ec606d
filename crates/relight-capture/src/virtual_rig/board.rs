//! Printed boards: a plane with a picture of known size.

use std::sync::Arc;

use glam::DVec3;
use relight_scene::Pose;

use super::error::{RigError, within};
use super::material::Material;
use super::shapes::quad;
use super::texture::{Raster, Texture};
use super::{Model, Part};

/// A picture printed on a flat board. Texels are sharp squares: an edge between two of them lies exactly where the print
/// has it, at any resolution of the picture.
#[derive(Clone, Debug)]
pub struct PrintedBoard<'a> {
    /// Columns of the picture.
    pub columns: usize,
    /// Rows of the picture.
    pub rows: usize,
    /// Brightness of each texel, row-major from the top left, 0 for ink and 255 for paper; linear between.
    pub picture: &'a [u8],
    /// Size of a texel, metres.
    pub texel: f64,
    /// Board-to-world. The board's origin is the picture's top left corner, +X goes along its rows, +Y down its columns.
    pub pose: Pose,
    /// Reflectance of ink and of paper.
    pub reflectance: [f64; 2],
}

impl PrintedBoard<'_> {
    /// The board as a model: a matt sheet.
    ///
    /// # Errors
    /// If the picture does not hold what its size says, or a number is out of range.
    pub fn model(&self) -> Result<Model, RigError> {
        within("the size of a board's texel", self.texel, [1e-6, 1.0], "1e-6 to 1 m")?;
        let [ink, paper] = self.reflectance;
        within("the reflectance of ink", ink, [0.0, 1.0], "0 to 1")?;
        within("the reflectance of paper", paper, [0.0, 1.0], "0 to 1")?;
        if self.columns.checked_mul(self.rows) != Some(self.picture.len()) {
            let (width, height, held) = (self.columns, self.rows, self.picture.len());
            return Err(RigError::Texture { width, height, channels: 1, held });
        }
        let grey = |value: u8| [(ink + (paper - ink) * f64::from(value) / 255.0) as f32; 3];
        let texels = self.picture.iter().map(|&value| grey(value)).collect();
        let raster = Raster::linear(self.columns, self.rows, texels)?.sharp();
        let axis = |v: [f64; 3]| DVec3::from_array(self.pose.rotate(v));
        let (across, down) = (self.texel * self.columns as f64, self.texel * self.rows as f64);
        let mesh = quad(
            DVec3::from_array(self.pose.position()),
            across * axis([1.0, 0.0, 0.0]),
            down * axis([0.0, 1.0, 0.0]),
        );
        let reflectance = Texture::Raster(Arc::new(raster));
        Ok(Model { parts: vec![Part { mesh, material: Material::Lambert { reflectance } }] })
    }
}
