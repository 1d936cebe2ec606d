//! A network on one tile: forward with its activations kept, then backward.

use fearless_simd::Level;
use relight_field::parameters::{Layer, Network};

use crate::dense::{Matrix, Store, accumulate_outer, multiply};

/// Weights in the two layouts that the products want.
pub struct Mlp {
    layers: Vec<Layer>,
    /// `[inputs][outputs]` of every layer.
    transposed: Vec<Vec<f32>>,
}

/// Activations and gradients of one tile, reused from tile to tile.
#[derive(Default)]
pub struct Tape {
    /// The input of every layer, then the outputs of the last; `[rows][columns]`.
    pub values: Vec<Vec<f32>>,
    /// Gradients with respect to `values`.
    gradients: Vec<Vec<f32>>,
    columns: usize,
}

impl Tape {
    /// The network's outputs, and the gradients with respect to them, which are to be filled before
    /// [`Mlp::backward`]; both `[outputs][columns]`.
    pub fn output_and_gradient(&mut self) -> (&[f32], &mut [f32]) {
        (self.values.last().map_or(&[], |v| v), self.gradients.last_mut().map_or(&mut [], |g| g))
    }

    /// The network's outputs, `[outputs][columns]`.
    pub fn output(&self) -> &[f32] {
        self.values.last().map_or(&[], |v| v)
    }

    /// Gradient with respect to row `row` of the input of layer `layer`, after [`Mlp::backward`].
    pub fn input_gradient(&self, layer: usize, row: usize) -> &[f32] {
        &self.gradients[layer][row * self.columns..(row + 1) * self.columns]
    }
}

impl Mlp {
    /// Takes the weights of a network.
    pub fn new(network: &Network) -> Self {
        let mut mlp = Self { layers: network.layers.clone(), transposed: Vec::new() };
        mlp.refresh();
        mlp
    }

    /// The weights.
    pub fn network(&self) -> Network {
        Network { layers: self.layers.clone() }
    }

    /// Weights of one layer after another, for the optimiser; call [`Mlp::refresh`] when they have changed.
    pub fn weights_mut(&mut self) -> impl Iterator<Item = &mut [f32]> {
        self.layers.iter_mut().map(|l| &mut l.weight[..])
    }

    /// Inputs of the first layer.
    pub fn inputs(&self) -> usize {
        self.layers.first().map_or(0, |l| l.inputs)
    }

    /// Operations of one column, forward.
    pub fn forward_operations(&self) -> usize {
        2 * self.weights()
    }

    /// Operations of one column, backward, with gradients of `wanted` inputs of the first layer.
    pub fn backward_operations(&self, wanted: usize) -> usize {
        let first = self.layers.first().map_or(0, |l| 2 * l.outputs * (l.inputs - wanted));
        4 * self.weights() - first
    }

    /// Number of weights.
    pub fn weights(&self) -> usize {
        self.layers.iter().map(|l| l.weight.len()).sum()
    }

    /// Brings the transposed weights up to date.
    pub fn refresh(&mut self) {
        self.transposed = self
            .layers
            .iter()
            .map(|l| {
                let mut t = vec![0.0; l.weight.len()];
                for (o, row) in l.weight.chunks_exact(l.inputs).enumerate() {
                    for (i, &w) in row.iter().enumerate() {
                        t[i * l.outputs + o] = w;
                    }
                }
                t
            })
            .collect();
    }

    /// Makes room for `columns` columns; the rows of `values` that the caller fills are then as
    /// `values[layer][row * columns..]`.
    pub fn prepare(&self, tape: &mut Tape, columns: usize) {
        let rows = self.layers.iter().map(|l| l.inputs).chain(self.layers.last().map(|l| l.outputs));
        tape.values.resize_with(self.layers.len() + 1, Vec::new);
        tape.gradients.resize_with(self.layers.len() + 1, Vec::new);
        for ((v, g), rows) in tape.values.iter_mut().zip(&mut tape.gradients).zip(rows) {
            v.resize(rows * columns, 0.0);
            g.resize(rows * columns, 0.0);
        }
        tape.columns = columns;
    }

    /// Runs the network on `values[0]`. A layer with more inputs than its predecessor has outputs takes the rest
    /// from rows of `values` that the caller has filled.
    pub fn forward(&self, level: Level, tape: &mut Tape) {
        for (i, (layer, a)) in self.layers.iter().zip(&self.transposed).enumerate() {
            let (before, after) = tape.values.split_at_mut(i + 1);
            let store = if i + 1 < self.layers.len() { Store::Rectified } else { Store::Set };
            let a = Matrix { data: a, stride: layer.outputs, first: 0 };
            let shape = (layer.inputs, layer.outputs, tape.columns);
            multiply(level, a, &before[i], &mut after[0], shape, store);
        }
    }

    /// Adds the weight gradients to `gradient` (laid out like [`Mlp::weights_mut`]) and leaves input gradients on
    /// the tape: of the rows `wanted` of the first layer, and of all rows of the others.
    pub fn backward(
        &self,
        level: Level,
        tape: &mut Tape,
        gradient: &mut [f32],
        wanted: std::ops::Range<usize>,
    ) {
        let columns = tape.columns;
        let mut end = gradient.len();
        for (i, layer) in self.layers.iter().enumerate().rev() {
            let start = end - layer.weight.len();
            let (before, after) = tape.gradients.split_at_mut(i + 1);
            let (dx, dy, x) = (&mut before[i], &after[0], &tape.values[i]);
            let shape = (layer.inputs, layer.outputs, columns);
            accumulate_outer(level, dy, x, &mut gradient[start..end], shape);
            end = start;
            let mut input_gradient = |rows: std::ops::Range<usize>, rectified: bool| {
                let a = Matrix { data: &layer.weight, stride: layer.inputs, first: rows.start };
                let span = rows.start * columns..rows.end * columns;
                let store = if rectified { Store::WherePositive(&x[span.clone()]) } else { Store::Set };
                multiply(level, a, dy, &mut dx[span], (layer.outputs, rows.len(), columns), store);
            };
            if i == 0 {
                input_gradient(wanted.clone(), false);
            } else {
                // Rows beyond the predecessor's outputs came from the caller: no rectifier stands before them.
                let own = self.layers[i - 1].outputs;
                input_gradient(0..own, true);
                input_gradient(own..layer.inputs, false);
            }
        }
    }
}
