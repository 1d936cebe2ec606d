//! From a camera's frame to light, and from light to an sRGB image.

use relight_scene::Image;
use serde::{Deserialize, Serialize};

use super::demosaic::demosaic;
use super::{BayerPattern, CameraError, Frame};

/// A level from which on a pixel counts as full, of 255.
pub(super) const FULL_LEVEL: u8 = 250;

/// How raw frames become images: the same for all of a session.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Development {
    /// Gains of red, green and blue that make grey grey.
    pub white_balance: [f32; 3],
    /// What the sensor reports without light, 0 to 255.
    pub black_level: f32,
}

impl Default for Development {
    fn default() -> Self {
        Self { white_balance: [1.0; 3], black_level: 0.0 }
    }
}

/// What a frame tells of light, pixel by pixel and before colours are filled in. Values are linear in light and in the
/// sensor's levels above black: a full pixel has 255 less the black level.
#[derive(Clone, Debug, PartialEq)]
pub struct Signals {
    /// Pixels a row.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// Which filters lie where; none if the camera developed the frame, which then has three values a pixel.
    pub pattern: Option<BayerPattern>,
    /// Row-major from the top left.
    pub data: Vec<f32>,
    /// Which of these were full: the light there is not known but for a lower limit.
    pub full: Vec<bool>,
}

/// A photograph linear in light: RGB, row-major, 1 for a full pixel and more for what was brighter than one exposure can tell.
#[derive(Clone, Debug, PartialEq)]
pub struct LinearImage {
    /// Pixels a row.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// Red, green and blue of one pixel after another.
    pub data: Vec<f32>,
}

impl Frame {
    /// The frame as an sRGB image; raw ones are developed once, here.
    ///
    /// # Errors
    /// [`CameraError::Incomplete`] if the data are not of the stated size.
    pub fn develop(self, development: &Development) -> Result<Image, CameraError> {
        self.whole()?;
        match self {
            Frame::Developed(image) => Ok(image),
            Frame::Raw { .. } => Ok(self.signals(development)?.colours(development).encode(1.0)),
        }
    }

    /// What the frame tells of light. A developed frame's sRGB is decoded.
    ///
    /// # Errors
    /// [`CameraError::Incomplete`] if the data are not of the stated size.
    pub fn signals(&self, development: &Development) -> Result<Signals, CameraError> {
        self.whole()?;
        let full = self.bytes().iter().map(|&level| level >= FULL_LEVEL).collect();
        Ok(match self {
            Frame::Developed(image) => Signals {
                width: image.width,
                height: image.height,
                pattern: None,
                data: image.data.iter().map(|&byte| development.full() * linear(byte)).collect(),
                full,
            },
            Frame::Raw { width, height, pattern, data } => Signals {
                width: *width,
                height: *height,
                pattern: Some(*pattern),
                data: data.iter().map(|&level| f32::from(level) - development.black_level).collect(),
                full,
            },
        })
    }

    /// The bytes as the camera gave them.
    fn bytes(&self) -> &[u8] {
        match self {
            Frame::Developed(image) => &image.data,
            Frame::Raw { data, .. } => data,
        }
    }

    /// Width and height, pixels.
    pub(crate) fn size(&self) -> (u32, u32) {
        match self {
            Frame::Developed(image) => (image.width, image.height),
            Frame::Raw { width, height, .. } => (*width, *height),
        }
    }

    /// Whether all bytes of the frame are there.
    pub(crate) fn whole(&self) -> Result<(), CameraError> {
        let stated = match self {
            Frame::Developed(image) => 3 * u64::from(image.width) * u64::from(image.height),
            Frame::Raw { width, height, .. } => u64::from(*width) * u64::from(*height),
        };
        let held = self.bytes().len();
        if stated == held as u64 {
            return Ok(());
        }
        Err(CameraError::Incomplete(format!("{held} of its {stated} bytes arrived")))
    }
}

impl Development {
    /// Levels of a full pixel above black.
    pub(crate) fn full(&self) -> f32 {
        255.0 - self.black_level
    }
}

impl Signals {
    /// Fills in the colours and balances them.
    pub fn colours(&self, development: &Development) -> LinearImage {
        let Signals { width, height, .. } = *self;
        let (mut data, balance) = match self.pattern {
            Some(pattern) => (demosaic(width, height, pattern, &self.data), development.white_balance),
            // The camera balanced it.
            None => (self.data.clone(), [1.0; 3]),
        };
        for pixel in data.as_chunks_mut::<3>().0 {
            *pixel = [0, 1, 2].map(|c| pixel[c] / development.full() * balance[c]);
        }
        LinearImage { width, height, data }
    }
}

impl LinearImage {
    /// 8-bit sRGB of `exposure` times the light; what is beyond full is clipped.
    pub fn encode(&self, exposure: f32) -> Image {
        let data = self.data.iter().map(|&value| srgb(exposure * value)).collect();
        Image { width: self.width, height: self.height, data }
    }
}

/// 8-bit sRGB of a linear value, clipped (IEC 61966-2-1).
fn srgb(linear: f32) -> u8 {
    let x = linear.clamp(0.0, 1.0);
    let encoded = if x <= 0.003_130_8 { 12.92 * x } else { 1.055 * x.powf(1.0 / 2.4) - 0.055 };
    (encoded * 255.0).round() as u8
}

/// The linear value of an 8-bit sRGB one (IEC 61966-2-1).
fn linear(byte: u8) -> f32 {
    let encoded = f32::from(byte) / 255.0;
    if encoded <= 0.04045 { encoded / 12.92 } else { ((encoded + 0.055) / 1.055).powf(2.4) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn black_is_taken_away_and_white_is_balanced() {
        let development = Development { white_balance: [2.0, 1.0, 0.5], black_level: 15.0 };
        let row = |a: u8, b: u8| [a, b].repeat(3);
        // Green red, blue green.
        let data = [row(135, 75), row(255, 135)].concat().repeat(3);
        let frame = Frame::Raw { width: 6, height: 6, pattern: BayerPattern::Grbg, data };
        let image = frame.develop(&development).unwrap();
        assert!(image.data.iter().all(|&c| c == srgb(0.5)), "{:?}", image.data);
    }

    #[test]
    fn light_is_decoded_and_encoded_alike() {
        assert!((0..=255).all(|byte| srgb(linear(byte)) == byte));
        let image = Image { width: 2, height: 1, data: vec![0, 50, 100, 150, 200, 255] };
        let development = Development { white_balance: [2.0, 1.0, 1.0], black_level: 9.0 };
        let signals = Frame::Developed(image.clone()).signals(&development).unwrap();
        assert_eq!(signals.data[5], 246.0);
        assert_eq!(signals.colours(&development).encode(1.0), image);
    }
}
