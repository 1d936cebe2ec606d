//! What an engine is told when it is made: how samples are placed along a ray, and where colour is decoded.

use serde::{Deserialize, Serialize};

use crate::engine::EngineError;
use crate::optimiser::Optimiser;

/// How samples are placed along a ray.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Sampling {
    /// The paper's way (section 4.3): `coarse` samples, one in each of as many equal stretches of the ray inside the
    /// box; then `fine` more, drawn from the weights of the first. All of them are evaluated.
    Stratified {
        /// Samples of the first pass.
        coarse: usize,
        /// Samples drawn from the weights of the first pass.
        fine: usize,
    },
    /// `samples` a ray, placed where the engine's own occupancy says that something is.
    Guided {
        /// Samples a ray.
        samples: usize,
    },
}

impl Sampling {
    /// Samples a ray, in all passes together.
    pub fn samples(self) -> usize {
        match self {
            Self::Stratified { coarse, fine } => coarse + fine,
            Self::Guided { samples } => samples,
        }
    }
}

/// Where along a ray colour and visibility are decoded.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Shading {
    /// At every sample, as published: `C = sum_i w_i o_i c_i`.
    PerSample,
    /// Once a ray and light for what is met inside the box, and once for what lies beyond, from features averaged under
    /// the ray's weights. Inside, over all samples but the last: `h = sum_i w_i h(x_i) / W` with `W = sum_i w_i`,
    /// likewise `e`, and the light's direction at `x = sum_i w_i x_i / W`, through which no gradient flows. Beyond, at the
    /// last sample. The one counts `W`, the other `1 - W`; where either is at most [`NEGLIGIBLE`], the other is all. In pictures an
    /// engine may leave out up to a hundredth of what lies beyond.
    ///
    /// Averaging both would give features that belong to neither, whose gradient says nothing true of density: holes in
    /// surfaces would grow. (So it is still between two surfaces inside the box.) No colour's gradient reaches what is left
    /// out.
    Deferred,
}

/// Largest share of a ray's weights, 0..1, that deferred shading leaves out.
pub const NEGLIGIBLE: f64 = 1e-3;

/// Largest `beta2` of Adam: beyond it, moments would still be gathering when engines stop to correct them.
pub const LARGEST_BETA2: f64 = 0.999;

/// Everything fixed about an engine beside its field.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct EngineConfig {
    /// How samples are placed.
    pub sampling: Sampling,
    /// Where colour is decoded.
    pub shading: Shading,
    /// How networks follow their gradients.
    pub optimiser: Optimiser,
    /// Adam's `beta2`, the decay of its second moments (Kingma and Ba 2015): above 0, at most [`LARGEST_BETA2`].
    pub beta2: f64,
    /// With the step's number, decides every random draw.
    pub seed: u64,
}

impl EngineConfig {
    /// Checks what engines rely on.
    ///
    /// # Errors
    /// [`EngineError::Shape`] if `beta2` is out of range.
    pub fn validate(&self) -> Result<(), EngineError> {
        if self.beta2 > 0.0 && self.beta2 <= LARGEST_BETA2 {
            return Ok(());
        }
        Err(EngineError::Shape(format!(
            "beta2 is {}; it must be above 0, and at most {LARGEST_BETA2}",
            self.beta2
        )))
    }
}
