//! A network on one tile: forward with its activations kept, then backward.
//!
//! A column is a pair of a point and a light, and much of what the networks take is the same for all lights of a point.
//! Such shared inputs are kept, multiplied and differentiated once a point: their part of a layer is what the layer's
//! product over the other inputs is added to, and its gradient is that of the sum over the lights.

use std::ops::Range;

use fearless_simd::Level;
use relight_field::parameters::{Layer, Network};

use crate::aligned::Aligned;
use crate::dense::{
    Base, FixedPoint, Matrix, MatrixMut, Store, accumulate_outer, add_turns, multiply, padded, repeat_rows,
};

/// Weights in the two layouts that the products want.
pub struct Mlp {
    layers: Vec<Layer>,
    /// For every layer, those of its inputs that each column has for itself; the others, before and behind, are shared.
    own: Vec<Range<usize>>,
    /// `[inputs][outputs]` of every layer, first of its own inputs, then of the shared ones.
    transposed: Vec<Vec<f32>>,
    /// `transposed` of own inputs and of shared ones once more in fixed point, to go forward by; `None` where it goes by single
    /// precision.
    fixed: Vec<[Option<FixedPoint>; 2]>,
}

/// Activations and gradients of one tile, reused from tile to tile. Column `c` belongs to point `c % points`.
#[derive(Default)]
pub struct Tape {
    /// The outputs of every layer, `[outputs][columns]`: the own inputs of the next.
    values: Vec<Aligned>,
    /// The shared inputs of every layer, `[rows][padded points]`.
    pub shared: Vec<Aligned>,
    /// Gradients with respect to the own inputs of every layer, then to the outputs of the last.
    gradients: Vec<Aligned>,
    /// Gradients with respect to `shared`.
    shared_gradients: Vec<Aligned>,
    /// `[outputs][padded points]`: forward, the shared part of a layer; backward, its gradients summed over lights.
    of_points: Aligned,
    /// The shared part of a layer as a [`Base`].
    repeated: Aligned,
    columns: usize,
    points: usize,
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

    /// The own inputs of the last layer of several, `[inputs][columns]`.
    pub fn hidden_activations(&self) -> &[f32] {
        self.values.len().checked_sub(2).map_or(&[], |i| &self.values[i])
    }

    /// Gradients with respect to the own inputs of the first layer, `[rows][columns]`, after [`Mlp::backward`].
    pub fn input_gradient(&self) -> &[f32] {
        &self.gradients[0]
    }

    /// Gradients with respect to the shared inputs of layer `layer`, `[rows][padded points]`, after [`Mlp::backward`].
    pub fn shared_gradient(&self, layer: usize) -> &[f32] {
        &self.shared_gradients[layer]
    }
}

impl Mlp {
    /// Takes the weights of a network. Inputs of the first layer outside `own` are shared, and so are inputs of later
    /// layers beyond their predecessor's outputs.
    pub fn new(network: &Network, own: Range<usize>) -> Self {
        let layers = network.layers.clone();
        let own: Vec<_> =
            std::iter::once(own).chain(layers.iter().map(|l| 0..l.outputs)).take(layers.len()).collect();
        let fixed = layers.iter().map(|_| [None, None]).collect();
        let mut mlp = Self { layers, own, transposed: Vec::new(), fixed };
        mlp.refresh();
        mlp
    }

    /// The same network, to go forward in fixed point.
    pub fn in_fixed_point(&self) -> Self {
        let layers = self.layers.iter().zip(&self.own).zip(&self.transposed);
        let fixed = layers.map(|((layer, own), weights)| {
            let (own, shared) = weights.split_at(own.len() * layer.outputs);
            [own, shared].map(|weights| FixedPoint::new(weights, layer.outputs))
        });
        let (layers, own, transposed) = (self.layers.clone(), self.own.clone(), self.transposed.clone());
        Self { fixed: fixed.collect(), layers, own, transposed }
    }

    /// The weights.
    pub fn network(&self) -> Network {
        Network { layers: self.layers.clone() }
    }

    /// Weights of one layer after another, for the optimiser; call [`Mlp::refresh`] when they have changed.
    pub fn weights_mut(&mut self) -> impl Iterator<Item = &mut [f32]> {
        self.layers.iter_mut().map(|l| &mut l.weight[..])
    }

    /// Outputs and inputs of every layer.
    pub fn shapes(&self) -> impl Iterator<Item = (usize, usize)> {
        self.layers.iter().map(|l| (l.outputs, l.inputs))
    }

    /// Inputs of the first layer.
    pub fn inputs(&self) -> usize {
        self.layers.first().map_or(0, |l| l.inputs)
    }

    /// Inputs of the last layer.
    pub fn hidden_width(&self) -> usize {
        self.layers.last().map_or(0, |l| l.inputs)
    }

    /// Operations forward.
    pub fn forward_operations(&self, columns: usize, points: usize) -> usize {
        let layers = self.layers.iter().zip(&self.own);
        let one = |(l, own): (&Layer, &Range<usize>)| {
            l.outputs * (own.len() * columns + (l.inputs - own.len()) * points)
        };
        2 * layers.map(one).sum::<usize>()
    }

    /// Operations of [`Mlp::forward_to_hidden`] without shared inputs, and of one of the last layer's outputs.
    pub fn density_operations(&self, columns: usize) -> usize {
        let unwanted = self.layers.last().map_or(0, |l| 2 * (l.outputs - 1) * l.inputs * columns);
        self.forward_operations(columns, 0) - unwanted
    }

    /// Operations backward, with gradients of the inputs `wanted` of the first layer.
    pub fn backward_operations(&self, columns: usize, points: usize, wanted: Range<usize>) -> usize {
        let unwanted = self.layers.first().zip(self.own.first()).map_or(0, |(l, own)| {
            let of_columns = own.len() - common(own, &wanted).len();
            l.outputs * (of_columns * columns + (l.inputs - wanted.len() - of_columns) * points)
        });
        2 * (self.forward_operations(columns, points) - unwanted)
    }

    /// Number of weights.
    pub fn weights(&self) -> usize {
        self.layers.iter().map(|l| l.weight.len()).sum()
    }

    /// Brings the transposed weights up to date.
    pub fn refresh(&mut self) {
        self.transposed.resize_with(self.layers.len(), Vec::new);
        for ((l, own), t) in self.layers.iter().zip(&self.own).zip(&mut self.transposed) {
            t.resize(l.weight.len(), 0.0);
            let order = own.clone().chain(0..own.start).chain(own.end..l.inputs);
            for (t, i) in t.chunks_exact_mut(l.outputs).zip(order) {
                t.iter_mut().zip(l.weight[i..].iter().step_by(l.inputs)).for_each(|(t, &w)| *t = w);
            }
        }
    }

    /// Makes room for `columns` columns, a multiple of [`COLUMN_ALIGN`](crate::dense::COLUMN_ALIGN), of `points` points; the
    /// caller then fills all of `shared`.
    pub fn prepare(&self, tape: &mut Tape, columns: usize, points: usize) {
        let resize = |arrays: &mut Vec<Aligned>, layer: usize, length: usize| {
            arrays.resize_with(arrays.len().max(layer + 1), Aligned::default);
            arrays[layer].resize(length);
        };
        let wide = padded(points);
        for (i, (layer, own)) in self.layers.iter().zip(&self.own).enumerate() {
            resize(&mut tape.values, i, layer.outputs * columns);
            resize(&mut tape.gradients, i, own.len() * columns);
            resize(&mut tape.shared, i, (layer.inputs - own.len()) * wide);
            resize(&mut tape.shared_gradients, i, (layer.inputs - own.len()) * wide);
        }
        let outputs = self.layers.last().map_or(0, |l| l.outputs);
        resize(&mut tape.gradients, self.layers.len(), outputs * columns);
        let widest = self.layers.iter().map(|l| l.outputs).max().unwrap_or(0);
        tape.of_points.resize(widest * wide);
        tape.repeated.resize(widest * Base::stride(points));
        (tape.columns, tape.points) = (columns, points);
    }

    /// Runs the network on its own inputs, `[rows][columns]`, and `shared`.
    pub fn forward(&self, level: Level, inputs: &[f32], tape: &mut Tape) {
        self.forward_layers(level, inputs, tape, self.layers.len());
    }

    /// The same for the layers before the last, to [`Tape::hidden_activations`].
    pub fn forward_to_hidden(&self, level: Level, inputs: &[f32], tape: &mut Tape) {
        self.forward_layers(level, inputs, tape, self.layers.len().saturating_sub(1));
    }

    /// The outputs `rows` of the last layer, `[rows][columns]`, of what the layer before gives, `[inputs][columns]`, if it has no
    /// shared inputs.
    pub fn output_rows(
        &self,
        level: Level,
        hidden: &[f32],
        columns: usize,
        rows: Range<usize>,
        outputs: &mut [f32],
    ) {
        if let (Some(layer), Some(data)) = (self.layers.last(), self.transposed.last()) {
            let a = Matrix::new(data, layer.outputs, rows.start);
            let shape = (layer.inputs, rows.len(), columns);
            multiply(level, a, hidden, outputs, shape, None, Store::Set);
        }
    }

    /// Runs the first `layers` layers.
    fn forward_layers(&self, level: Level, inputs: &[f32], tape: &mut Tape, layers: usize) {
        let (columns, points) = (tape.columns, tape.points);
        let weights = self.own.iter().zip(&self.transposed);
        for (i, (layer, (own, a))) in self.layers.iter().zip(weights).enumerate().take(layers) {
            let (before, after) = tape.values.split_at_mut(i);
            let x = before.last().map_or(inputs, |outputs| outputs);
            let (own_a, shared_a) = a.split_at(own.len() * layer.outputs);
            let [own_fixed, shared_fixed] = self.fixed[i].each_ref().map(Option::as_ref);
            let own_a = Matrix { fixed: own_fixed, ..Matrix::new(own_a, layer.outputs, 0) };
            let shared_a = Matrix { fixed: shared_fixed, ..Matrix::new(shared_a, layer.outputs, 0) };
            let shared = layer.inputs - own.len();
            let base = if shared > 0 {
                let (shared_x, y) = (&tape.shared[i], &mut tape.of_points);
                let shape = (shared, layer.outputs, padded(points));
                multiply(level, shared_a, shared_x, y, shape, None, Store::Set);
                repeat_rows(&y[..shape.1 * shape.2], points, &mut tape.repeated);
                Some(Base { data: &tape.repeated, period: points })
            } else {
                None
            };
            let store = if i + 1 < self.layers.len() { Store::Rectified } else { Store::Set };
            let shape = (own.len(), layer.outputs, columns);
            multiply(level, own_a, x, &mut after[0], shape, base, store);
        }
    }

    /// Adds the weight gradients to `gradient` (laid out like [`Mlp::weights_mut`]) and leaves input gradients on
    /// the tape: of the inputs `wanted` of the first layer, and of all inputs of the others. `inputs` are those of
    /// [`Mlp::forward`].
    pub fn backward(
        &self,
        level: Level,
        inputs: &[f32],
        tape: &mut Tape,
        gradient: &mut [f32],
        wanted: Range<usize>,
    ) {
        let (columns, points) = (tape.columns, tape.points);
        let mut end = gradient.len();
        for (i, (layer, own)) in self.layers.iter().zip(&self.own).enumerate().rev() {
            let start = end - layer.weight.len();
            let gradient = &mut gradient[start..end];
            end = start;
            let (before, after) = tape.gradients.split_at_mut(i + 1);
            let (dy, wanted) = (&after[0][..], if i == 0 { wanted.clone() } else { 0..layer.inputs });
            let store = |x| if i == 0 { Store::Set } else { Store::WherePositive(x) };
            let part = Part { layer, level, columns, inputs: own.clone(), wanted: &wanted };
            let x = i.checked_sub(1).map_or(inputs, |before| &tape.values[before]);
            part.backward(dy, x, &mut before[i], gradient, store);
            if own.len() == layer.inputs {
                continue;
            }
            let wide = padded(points);
            let sums = &mut tape.of_points[..layer.outputs * wide];
            add_turns(level, dy, columns, points, sums);
            let (x, dx) = (&tape.shared[i], &mut tape.shared_gradients[i]);
            let (x_before, x_behind) = x.split_at(own.start * wide);
            let (dx_before, dx_behind) = dx.split_at_mut(own.start * wide);
            let sides = [(0..own.start, x_before, dx_before), (own.end..layer.inputs, x_behind, dx_behind)];
            for (inputs, x, dx) in sides {
                let part = Part { layer, level, columns: wide, inputs, wanted: &wanted };
                part.backward(sums, x, dx, gradient, |_| Store::Set);
            }
        }
    }
}

/// Numbers that are in both ranges.
fn common(a: &Range<usize>, b: &Range<usize>) -> Range<usize> {
    let start = a.start.max(b.start);
    start..a.end.min(b.end).max(start)
}

/// Some neighbouring inputs of a layer.
struct Part<'a> {
    layer: &'a Layer,
    level: Level,
    columns: usize,
    inputs: Range<usize>,
    /// Inputs of the layer whose gradients are wanted.
    wanted: &'a Range<usize>,
}

impl Part<'_> {
    /// From the gradients `dy` of the outputs to those of the weights, which are added to, and of the inputs `x`. What
    /// those go through before they are stored, `store` tells by `x`.
    fn backward<'a>(
        &self,
        dy: &[f32],
        x: &'a [f32],
        dx: &mut [f32],
        gradient: &mut [f32],
        store: impl Fn(&'a [f32]) -> Store<'a>,
    ) {
        let Self { layer, level, columns, inputs, wanted } = self;
        let w = MatrixMut { data: gradient, stride: layer.inputs, first: inputs.start };
        accumulate_outer(*level, dy, x, w, (inputs.len(), layer.outputs, *columns));
        let wanted = common(inputs, wanted);
        if wanted.is_empty() {
            return;
        }
        let span = (wanted.start - inputs.start) * columns..(wanted.end - inputs.start) * columns;
        let a = Matrix::new(&layer.weight, layer.inputs, wanted.start);
        let shape = (layer.outputs, wanted.len(), *columns);
        multiply(*level, a, dy, &mut dx[span.clone()], shape, None, store(&x[span]));
    }
}
