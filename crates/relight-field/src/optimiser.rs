//! How networks follow their gradients. The hash table always has Adam, for each entry by itself.

use serde::{Deserialize, Serialize};

/// Optimiser of the three networks.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Optimiser {
    /// Adam (Kingma and Ba 2015): the paper's, and what recipes without a word of it have.
    #[default]
    Adam,
    /// SOAP (Vyas et al. 2024, arXiv:2409.11321, algorithm 3): Adam in a basis of its own for every layer. With `G` the
    /// gradient of a layer's weights `W`, both `[outputs, inputs]`, an update is
    ///
    /// ```text
    /// A <- MEMORY A + G G^T         B <- MEMORY B + G^T G
    /// G' = U G V^T                  M <- beta1 M + (1 - beta1) G'      S <- beta2 S + (1 - beta2) G'^2
    /// W <- W - rate U^T (m M / (sqrt(s S) + EPSILON rms(sqrt(s S)))) V
    /// ```
    ///
    /// where `m` and `s` are Adam's corrections, and the rows of `U` and `V` come near the eigenvectors of `A` and `B`: from time to
    /// time `U` becomes `U (A / mean(diag A) + FLOOR I)`, its rows made orthonormal one after another, and `V`
    /// likewise; `M` is taken from the old bases to the new, and `S` is left as it is. Both begin as the identity. When that is,
    /// [`renews`] tells.
    Soap,
}

/// What an update leaves of the covariances of before.
pub const MEMORY: f64 = 0.95;

/// Updates of a layer from one renewal of its bases to the next.
pub const PERIOD: u32 = 40;

/// First updates, after each of which bases are renewed.
pub const EARLY: u32 = 9;

/// Whether the bases of layer `layer`, from 0, of a network are renewed after update `count`, from 1. Later on, layers of a network take turns.
pub fn renews(layer: u32, count: u32) -> bool {
    count <= EARLY || count.wrapping_add(layer).is_multiple_of(PERIOD)
}

/// Keeps rows apart whose covariance is nought, so that they can be made orthonormal.
pub const FLOOR: f64 = 1e-4;

/// Least that a gradient's root mean square counts beside that of the whole layer: below it there are the roundings of single
/// precision, which must not be followed as if they were gradients.
pub const EPSILON: f64 = 1e-5;
