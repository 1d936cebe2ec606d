//! The three networks of an architecture, and where each of their inputs lies.

use std::ops::Range;

use fearless_simd::Level;
use rayon::prelude::*;
use relight_field::architecture::{Architecture, EMBEDDING, EmbeddingEntry, GEO_OUTPUTS, HARMONICS};
use relight_field::optimiser::Optimiser;
use relight_field::parameters::Parameters;

use crate::adam::Adam;
use crate::mlp::Mlp;
use crate::moments::Moments;
use crate::soap::Soap;
use crate::stages::{Clock, Costs, Stage};

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
        let chunks = [&mut self.geo, &mut self.rgb, &mut self.vis].into_par_iter().enumerate().flat_map(
            |(part, mine)| {
                let chunks = mine.par_chunks_mut(SUMMED_TOGETHER).enumerate();
                chunks.map(move |(chunk, mine)| (part, chunk * SUMMED_TOGETHER, mine))
            },
        );
        chunks.for_each(|(part, start, mine)| {
            for other in others {
                let other = &other.parts()[part][start..start + mine.len()];
                mine.iter_mut().zip(other).for_each(|(a, b)| *a += b);
            }
        });
    }

    /// Sets all to zero.
    pub fn clear(&mut self) {
        [&mut self.geo, &mut self.rgb, &mut self.vis].into_iter().for_each(|g| g.fill(0.0));
    }
}

impl Networks {
    /// Takes the networks of a field.
    pub fn new(parameters: &Parameters) -> Self {
        let (architecture, features) = (parameters.config.architecture, parameters.config.grid.outputs());
        // Of what the shading networks take, only the light differs between the pairs of a point.
        Self {
            architecture,
            features,
            density_scale: parameters.config.density_scale,
            geo: Mlp::new(&parameters.geo, 0..features),
            rgb: Mlp::new(&parameters.rgb, HARMONICS..HARMONICS + architecture.light_inputs()),
            vis: parameters.vis.as_ref().map(|vis| Mlp::new(vis, features..features + HARMONICS)),
        }
    }

    /// The same for pictures, multiplied in fixed point.
    pub fn in_fixed_point(&self) -> Self {
        Self {
            geo: self.geo.in_fixed_point(),
            rgb: self.rgb.in_fixed_point(),
            vis: self.vis.as_ref().map(Mlp::in_fixed_point),
            ..*self
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

    /// The moments of all three before the first step.
    pub fn moments(&self, optimiser: Optimiser) -> [Moments; 3] {
        [Some(&self.geo), Some(&self.rgb), self.vis.as_ref()].map(|network| {
            let layers = network.into_iter().flat_map(Mlp::shapes);
            let bases = match optimiser {
                Optimiser::Adam => Vec::new(),
                Optimiser::Soap => layers.map(|(outputs, inputs)| Soap::new(outputs, inputs)).collect(),
            };
            Moments::new(network.map_or(0, Mlp::weights), bases)
        })
    }

    /// Numbers that `geo`'s last layer takes.
    pub fn hidden_width(&self) -> usize {
        self.geo.hidden_width()
    }

    /// The embeddings `e` from `geo`'s last hidden activations, `[hidden_width][columns]`: `[15][columns]`. They are linear in those, so a
    /// sum of embeddings is that of the sum.
    pub fn embeddings(&self, simd: Level, hidden: &[f32], columns: usize, embeddings: &mut [f32]) {
        self.geo.output_rows(simd, hidden, columns, 1..GEO_OUTPUTS, embeddings);
    }

    /// One optimiser step of all three. Returns what it cost the threads together.
    pub fn step(
        &mut self,
        simd: Level,
        gradients: &Gradients,
        moments: &mut [Moments; 3],
        rate: f32,
        adam: &Adam,
    ) -> Costs {
        let networks = [Some(&mut self.geo), Some(&mut self.rgb), self.vis.as_mut()];
        let parts = networks.into_par_iter().zip(gradients.parts()).zip(moments).with_max_len(1);
        let one = |((network, gradient), moments): ((Option<&mut Mlp>, &[f32]), &mut Moments)| {
            let mut clock = Clock::default();
            if let Some(network) = network {
                moments.step(simd, network.weights_mut(), gradient, rate, adam);
                network.refresh();
                clock.lap(Stage::OptimiseNetworks, moments.operations());
            }
            *clock.costs()
        };
        parts.map(one).reduce(Costs::default, Costs::plus)
    }

    /// Shared inputs of the colour network's first layer: those of `zeta(d)`, then those of `h(x)` where it has them; any
    /// others are `e`.
    pub fn shared_rows(&self) -> (usize, usize) {
        (HARMONICS, if self.architecture.position_skip { self.features } else { 0 })
    }

    /// Layer of the colour network that takes `e`, and the shared input at which it begins there.
    pub fn embedding_place(&self) -> (usize, usize) {
        match self.architecture.embedding {
            EmbeddingEntry::Layer1 => {
                let (directions, positions) = self.shared_rows();
                (0, directions + positions)
            }
            EmbeddingEntry::Layer2 => (1, 0),
        }
    }

    /// Inputs of the colour network's first layer whose gradients go on: `h(x)` and `e`.
    pub fn rgb_wanted(&self) -> Range<usize> {
        HARMONICS + self.architecture.light_inputs()..self.rgb.inputs()
    }

    /// Operations of `rgb` and `vis`, forward and backward, at `columns` pairs of `points` points.
    pub fn shading_operations(&self, columns: usize, points: usize) -> (usize, usize) {
        let vis = self.vis.as_ref();
        let forward = self.rgb.forward_operations(columns, points)
            + vis.map_or(0, |vis| vis.forward_operations(columns, points));
        let backward = self.rgb.backward_operations(columns, points, self.rgb_wanted())
            + vis.map_or(0, |vis| vis.backward_operations(columns, points, 0..self.features));
        (forward, backward)
    }

    /// Numbers that the shading networks take of a point: `h(x)`, then `e`.
    pub fn point_features(&self) -> usize {
        self.features + EMBEDDING
    }
}
