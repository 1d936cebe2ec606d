//! The paper's architectures V0 to V5, written as data (section 4.2, figure 5, table 3).
//!
//! All variants share the hash grid `h(x)` and the geometry network `geo: h(x) -> (log sigma, e)`. They differ in
//! what the colour network `rgb` is told about the light, and each differs from the one before it in one field.

use serde::{Deserialize, Serialize};

/// Width of every hidden layer.
pub const HIDDEN: usize = 64;
/// Length of the geometry embedding `e`: outputs 1..16 of `geo`.
pub const EMBEDDING: usize = 15;
/// Outputs of `geo`: the density logit, then `e`.
pub const GEO_OUTPUTS: usize = 1 + EMBEDDING;
/// Coefficients of the spherical harmonics `zeta` (bands 0 to 3).
pub const HARMONICS: usize = 16;
/// Numbers in the Fourier code of a light pose, `gamma(R, t)`: 12 numbers, each with 6 sines and 6 cosines.
pub const POSE_CODE: usize = 12 + 12 * 2 * POSE_OCTAVES;
/// Octaves of `gamma`.
pub const POSE_OCTAVES: usize = 6;

/// What the colour network is told about the light.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum LightInput {
    /// Nothing: V0, plain Instant-NGP.
    None,
    /// `gamma(R, t)`, the Fourier code of the light's pose; the same for every point.
    Pose,
    /// `zeta(l)`, the harmonics of the unit vector from the point to the light.
    Direction,
}

/// Where the embedding `e` enters the colour network.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum EmbeddingEntry {
    /// Beside the other inputs of layer 1.
    Layer1,
    /// Beside the outputs of layer 1, as input of layer 2.
    Layer2,
}

/// One row of the paper's ablation table.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Architecture {
    /// What the colour network is told about the light.
    pub light: LightInput,
    /// Whether `h(x)` is also an input of the colour network ("skip" in table 3).
    pub position_skip: bool,
    /// Where `e` enters the colour network ("inputs" in table 3).
    pub embedding: EmbeddingEntry,
    /// Whether a visibility network `o = vis(h(x), zeta(l))` multiplies the colour.
    pub visibility: bool,
}

/// Instant-NGP, which knows nothing of the light.
pub const V0: Architecture = Architecture {
    light: LightInput::None,
    position_skip: false,
    embedding: EmbeddingEntry::Layer1,
    visibility: false,
};
/// V0 told the pose of the light.
pub const V1: Architecture = Architecture { light: LightInput::Pose, ..V0 };
/// V1 with the direction to the light instead of its pose.
pub const V2: Architecture = Architecture { light: LightInput::Direction, ..V1 };
/// V2 with `h(x)` given to the colour network.
pub const V3: Architecture = Architecture { position_skip: true, ..V2 };
/// V3 with `e` entering at the second layer.
pub const V4: Architecture = Architecture { embedding: EmbeddingEntry::Layer2, ..V3 };
/// V4 with a visibility network: the paper's own model.
pub const V5: Architecture = Architecture { visibility: true, ..V4 };

/// Names and architectures, in the order of the paper's table.
pub const VARIANTS: [(&str, Architecture); 6] =
    [("v0", V0), ("v1", V1), ("v2", V2), ("v3", V3), ("v4", V4), ("v5", V5)];

impl Architecture {
    /// The architecture called `name` (`v0` to `v5`), or `None`.
    pub fn named(name: &str) -> Option<Self> {
        VARIANTS.iter().find(|(n, _)| n.eq_ignore_ascii_case(name)).map(|&(_, a)| a)
    }

    /// The name of this architecture, or `custom` if it is none of the paper's.
    pub fn name(&self) -> &'static str {
        VARIANTS.iter().find(|(_, a)| a == self).map_or("custom", |&(n, _)| n)
    }

    /// Numbers that describe the light to layer 1 of the colour network.
    pub fn light_inputs(&self) -> usize {
        match self.light {
            LightInput::None => 0,
            LightInput::Pose => POSE_CODE,
            LightInput::Direction => HARMONICS,
        }
    }

    /// `(inputs, outputs)` of the layers of `geo`, for `features` numbers of `h(x)`.
    pub fn geo_shape(&self, features: usize) -> Vec<(usize, usize)> {
        vec![(features, HIDDEN), (HIDDEN, GEO_OUTPUTS)]
    }

    /// `(inputs, outputs)` of the layers of `rgb`. Layer 1 takes `zeta(d)`, then the light, then `h(x)`, then `e`,
    /// each where the variant has it; layer 2 takes layer 1's outputs, then `e` where it enters there.
    pub fn rgb_shape(&self, features: usize) -> Vec<(usize, usize)> {
        let skip = if self.position_skip { features } else { 0 };
        let (e1, e2) = match self.embedding {
            EmbeddingEntry::Layer1 => (EMBEDDING, 0),
            EmbeddingEntry::Layer2 => (0, EMBEDDING),
        };
        vec![
            (HARMONICS + self.light_inputs() + skip + e1, HIDDEN),
            (HIDDEN + e2, HIDDEN),
            (HIDDEN, HIDDEN),
            (HIDDEN, 3),
        ]
    }

    /// `(inputs, outputs)` of the layers of `vis`, which takes `h(x)`, then `zeta(l)`; `None` without visibility.
    pub fn vis_shape(&self, features: usize) -> Option<Vec<(usize, usize)>> {
        self.visibility
            .then(|| vec![(features + HARMONICS, HIDDEN), (HIDDEN, HIDDEN), (HIDDEN, HIDDEN), (HIDDEN, 1)])
    }
}
