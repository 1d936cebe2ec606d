//! Colours of surfaces, in linear light.

use std::sync::Arc;

use glam::Vec3A;
use relight_scene::Image;

use super::error::RigError;
use super::solid::Solid;

/// A colour that may vary over a surface: linear-light reflectance, each channel from 0 to 1.
#[derive(Clone, Debug)]
pub enum Texture {
    /// One colour everywhere.
    Uniform([f32; 3]),
    /// A picture, laid over the mesh's texture coordinates.
    Raster(Arc<Raster>),
    /// A pattern in space: needs no texture coordinates, and has no seams.
    Solid(Solid),
}

impl Texture {
    /// The colour at a point: texture coordinates and world position, metres.
    pub(super) fn at(&self, uv: [f32; 2], position: Vec3A) -> Vec3A {
        match self {
            Texture::Uniform(colour) => Vec3A::from_array(*colour),
            Texture::Raster(raster) => raster.at(uv),
            Texture::Solid(solid) => solid.at(position),
        }
    }
}

impl From<[f32; 3]> for Texture {
    fn from(colour: [f32; 3]) -> Self {
        Texture::Uniform(colour)
    }
}

/// A picture in linear light. Texel (i, j) covers the square from (i, j) to (i + 1, j + 1) over the picture's size; the
/// picture repeats outside the unit square.
#[derive(Clone, Debug)]
pub struct Raster {
    width: usize,
    height: usize,
    texels: Vec<[f32; 3]>,
    blurred: bool,
}

impl Raster {
    /// A picture of linear-light colours, row-major from the top left, interpolated bilinearly between texel centres.
    ///
    /// # Errors
    /// If there are not `width * height` texels, or none.
    pub fn linear(width: usize, height: usize, texels: Vec<[f32; 3]>) -> Result<Self, RigError> {
        if texels.is_empty() || width.checked_mul(height) != Some(texels.len()) {
            return Err(RigError::Texture { width, height, channels: 3, held: 3 * texels.len() });
        }
        Ok(Self { width, height, texels, blurred: true })
    }

    /// A picture in sRGB.
    ///
    /// # Errors
    /// If the picture does not hold what its size says, or nothing.
    pub fn from_image(image: &Image) -> Result<Self, RigError> {
        let (width, height) = (image.width as usize, image.height as usize);
        if image.data.len() != 3 * width * height {
            return Err(RigError::Texture { width, height, channels: 3, held: image.data.len() });
        }
        let decode: [f32; 256] = std::array::from_fn(|value| decode_srgb(value as f32 / 255.0));
        let texels = image.data.chunks_exact(3).map(|c| [0, 1, 2].map(|k| decode[usize::from(c[k])]));
        Self::linear(width, height, texels.collect())
    }

    /// The same picture with texels as sharp squares instead of a smooth surface: for printed patterns, whose edges are
    /// to lie exactly between texels.
    pub fn sharp(self) -> Self {
        Self { blurred: false, ..self }
    }

    /// The same picture, each channel times a factor.
    pub(super) fn times(mut self, factor: [f32; 3]) -> Self {
        self.texels.iter_mut().for_each(|texel| (0..3).for_each(|k| texel[k] *= factor[k]));
        self
    }

    fn at(&self, [u, v]: [f32; 2]) -> Vec3A {
        let (x, y) = (wrap(u) * self.width as f32, wrap(v) * self.height as f32);
        let texel = |i: usize, j: usize| Vec3A::from_array(self.texels[j * self.width + i]);
        if !self.blurred {
            return texel((x as usize).min(self.width - 1), (y as usize).min(self.height - 1));
        }
        let (x, y) = (x - 0.5, y - 0.5);
        let (left, top) = (x.floor(), y.floor());
        let (fx, fy) = (x - left, y - top);
        // The place is within half a texel of the picture: one step wraps it.
        let column = |i: f32| if i < 0.0 { self.width - 1 } else { (i as usize) % self.width };
        let row = |j: f32| if j < 0.0 { self.height - 1 } else { (j as usize) % self.height };
        let (i0, i1, j0, j1) = (column(left), column(left + 1.0), row(top), row(top + 1.0));
        let upper = texel(i0, j0).lerp(texel(i1, j0), fx);
        upper.lerp(texel(i0, j1).lerp(texel(i1, j1), fx), fy)
    }
}

fn wrap(x: f32) -> f32 {
    let x = x - x.floor();
    if x < 1.0 { x } else { 0.0 }
}

/// sRGB (IEC 61966-2-1) to linear light, both from 0 to 1.
pub(super) fn decode_srgb(value: f32) -> f32 {
    if value <= 0.040_45 { value / 12.92 } else { ((value + 0.055) / 1.055).powf(2.4) }
}

/// Linear light to sRGB, both from 0 to 1.
pub(super) fn encode_srgb(value: f32) -> f32 {
    if value <= 0.003_130_8 { 12.92 * value } else { 1.055 * value.powf(1.0 / 2.4) - 0.055 }
}
