//! From radiance to 8 bits.

use super::error::{RigError, within};
use super::random::{hash, normals};
use super::texture::encode_srgb;

/// A sensor of fixed exposure and white balance. A pixel's signal is `exposure` times radiance, full at 1; noise is that of
/// counted electrons and of reading them; then sRGB and rounding to 8 bits.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sensor {
    /// Signal for unit radiance.
    pub exposure: f64,
    /// Electrons of a full pixel, for shot noise; infinite: none.
    pub full_well: f64,
    /// Standard deviation of reading, electrons.
    pub read_noise: f64,
}

impl Default for Sensor {
    /// A small machine-vision sensor (10,500 electrons, 3 of read noise), exposed for the default lamp and stage.
    fn default() -> Self {
        Self { exposure: 0.45, full_well: 10_500.0, read_noise: 3.0 }
    }
}

/// What names the noise of a picture.
#[derive(Clone, Copy, Debug)]
pub(super) struct Shot {
    pub seed: u64,
    pub camera: usize,
    pub light: usize,
}

impl Sensor {
    /// A sensor without noise.
    pub fn noiseless(exposure: f64) -> Self {
        Self { exposure, full_well: f64::INFINITY, read_noise: 0.0 }
    }

    pub(super) fn check(&self) -> Result<(), RigError> {
        within("the sensor's exposure", self.exposure, [0.0, 1e9], "0 to 1e9")?;
        within("the sensor's full well", self.full_well, [1.0, f64::INFINITY], "1 electron to infinity")?;
        within("the sensor's read noise", self.read_noise, [0.0, 1e6], "0 to 1e6 electrons")
    }

    /// The signal that a pixel reports for a radiance, noise included; neither clipped nor rounded. `pixel` is its number
    /// in the picture, row-major.
    pub(super) fn signal(&self, radiance: [f32; 3], pixel: usize, shot: Shot) -> [f64; 3] {
        let clean = radiance.map(|l| self.exposure * f64::from(l));
        if self.full_well.is_infinite() {
            return clean;
        }
        let read = self.read_noise / self.full_well;
        let draw =
            |k: u64| normals(hash(&[shot.seed, shot.camera as u64, shot.light as u64, pixel as u64, k]));
        let ([a, b], [c, _]) = (draw(0), draw(1));
        let deviation = |signal: f64| (signal.max(0.0) / self.full_well + read * read).sqrt();
        let [red, green, blue] = clean;
        [red + a * deviation(red), green + b * deviation(green), blue + c * deviation(blue)]
    }
}

/// A signal as 8-bit sRGB.
pub(super) fn to_bytes(signal: [f64; 3]) -> [u8; 3] {
    // A float becomes an integer by truncation; what is no number becomes 0.
    signal.map(|s| (encode_srgb(s.clamp(0.0, 1.0) as f32) * 255.0 + 0.5) as u8)
}
