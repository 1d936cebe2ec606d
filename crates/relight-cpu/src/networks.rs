//! The three networks of an architecture, and where each of their inputs lies.

use fearless_simd::Level;
use rayon::prelude::*;
use relight_field::architecture::{Architecture, EMBEDDING, EmbeddingEntry, HARMONICS, HIDDEN};
use relight_field::parameters::Parameters;

use crate::adam::{Adam, Moments};
use crate::mlp::Mlp;

/// Weights whose gradients one thread sums.
const SUMMED_TOGETHER: usize = 2048;

/// `geo`, `rgb` and, where the architecture has it, `vis`.
pub struct Networks {
    /// What they are networks of.
    pub architecture: Architecture,
    /// Numbers in `h(x)`.
    pub features: usize,
    /// Density at logit zero, per metre.
    pub density_scale: f32,
    /// Geometry network.
    pub geo: Mlp,
    /// Colour network.
    pub rgb: Mlp,
    /// Visibility network.
    pub vis: Option<Mlp>,
}

/// Gradients of the three networks, each laid out like [`Mlp::weights_mut`].
#[derive(Clone, Default)]
pub struct Gradients {
    /// Of `geo`.
    pub geo: Vec<f32>,
    /// Of `rgb`.
    pub rgb: Vec<f32>,
    /// Of `vis`; empty without one.
    pub vis: Vec<f32>,
}

impl Gradients {
    /// The three arrays.
    pub fn parts(&self) -> [&[f32]; 3] {
        [&self.geo, &self.rgb, &self.vis]
    }

    /// Adds others to these, one after another.
    pub fn add(&mut self, others: &[&Self]) {
        for (part, mine) in [&mut self.geo, &mut self.rgb, &mut self.vis].into_iter().enumerate() {
            mine.par_chunks_mut(SUMMED_TOGETHER).enumerate().for_each(|(chunk, mine)| {
                let span = chunk * SUMMED_TOGETHER..chunk * SUMMED_TOGETHER + mine.len();
                for other in others {
                    mine.iter_mut().zip(&other.parts()[part][span.clone()]).for_each(|(a, b)| *a += b);
                }
            });
        }
    }

    /// Sets all to zero.
    pub fn clear(&mut self) {
        [&mut self.geo, &mut self.rgb, &mut self.vis].into_iter().for_each(|g| g.fill(0.0));
    }
}

impl Networks {
    /// Takes the networks of a field.
    pub fn new(parameters: &Parameters) -> Self {
        Self {
            architecture: parameters.config.architecture,
            features: parameters.config.grid.outputs(),
            density_scale: parameters.config.density_scale,
            geo: Mlp::new(&parameters.geo),
            rgb: Mlp::new(&parameters.rgb),
            vis: parameters.vis.as_ref().map(Mlp::new),
        }
    }

    /// Zero gradients.
    pub fn gradients(&self) -> Gradients {
        Gradients {
            geo: vec![0.0; self.geo.weights()],
            rgb: vec![0.0; self.rgb.weights()],
            vis: vec![0.0; self.vis.as_ref().map_or(0, Mlp::weights)],
        }
    }

    /// One optimiser step of all three.
    pub fn step(
        &mut self,
        simd: Level,
        gradients: &Gradients,
        moments: &mut [Moments; 3],
        rate: f32,
        adam: &Adam,
    ) {
        let networks = [Some(&mut self.geo), Some(&mut self.rgb), self.vis.as_mut()];
        for ((network, gradient), moments) in networks.into_iter().zip(gradients.parts()).zip(moments) {
            if let Some(network) = network {
                moments.step(simd, network.weights_mut(), gradient, rate, adam);
                network.refresh();
            }
        }
    }

    /// Row of the colour network's input at which the light's numbers begin; `zeta(d)` stands before them.
    pub fn light_row(&self) -> usize {
        HARMONICS
    }

    /// Row of the colour network's input at which `h(x)` begins, where it has it.
    pub fn position_row(&self) -> usize {
        HARMONICS + self.architecture.light_inputs()
    }

    /// Layer of the colour network that takes `e`, and the row at which it begins there.
    pub fn embedding_place(&self) -> (usize, usize) {
        match self.architecture.embedding {
            EmbeddingEntry::Layer1 => {
                let skip = if self.architecture.position_skip { self.features } else { 0 };
                (0, self.position_row() + skip)
            }
            EmbeddingEntry::Layer2 => (1, HIDDEN),
        }
    }

    /// Operations of a pair in `rgb` and `vis`, forward and backward.
    pub fn shading_operations(&self) -> (usize, usize) {
        let rows = self.rgb.inputs() - self.position_row();
        let vis = self.vis.as_ref();
        let forward = self.rgb.forward_operations() + vis.map_or(0, Mlp::forward_operations);
        let backward =
            self.rgb.backward_operations(rows) + vis.map_or(0, |vis| vis.backward_operations(self.features));
        (forward, backward)
    }

    /// Numbers that the shading networks take of a point: `h(x)`, then `e`.
    pub fn point_features(&self) -> usize {
        self.features + EMBEDDING
    }
}
