//! Multilayer perceptrons, one sample at a time: rectifiers between layers, nothing after the last, no biases.
//!
//! The second layer may take more inputs than the first has outputs: `late` numbers that join there, as the embedding
//! does in V4 and V5.

use crate::parameters::{Layer, Network};
use crate::real::Real;

/// What a forward pass leaves for the backward pass.
#[derive(Clone, Debug)]
pub struct Trace<R> {
    /// The input of every layer.
    inputs: Vec<Vec<R>>,
    /// The output of the last.
    pub output: Vec<R>,
}

/// Derivatives of a loss by what a network was given.
#[derive(Clone, Debug)]
pub struct InputGradient<R> {
    /// By the inputs of the first layer.
    pub input: Vec<R>,
    /// By the numbers that joined at the second.
    pub late: Vec<R>,
}

impl<R: Real> Layer<R> {
    /// `W x`.
    fn forward(&self, x: &[R]) -> Vec<R> {
        let row = |w: &[R]| w.iter().zip(x).map(|(&w, &x)| w * x).sum();
        self.weight.chunks_exact(self.inputs).map(row).collect()
    }

    /// Adds `d_y x^T` to the gradient and returns `W^T d_y`.
    fn backward(&self, x: &[R], d_y: &[R], gradient: &mut Self) -> Vec<R> {
        let mut d_x = vec![R::ZERO; self.inputs];
        let rows = self.weight.chunks_exact(self.inputs).zip(gradient.weight.chunks_exact_mut(self.inputs));
        for ((w, g), &d) in rows.zip(d_y) {
            for i in 0..self.inputs {
                g[i] += d * x[i];
                d_x[i] += d * w[i];
            }
        }
        d_x
    }
}

impl<R: Real> Network<R> {
    /// Evaluates the network; `late` joins the outputs of layer 1 and is empty where nothing does.
    pub fn forward(&self, input: Vec<R>, late: &[R]) -> Trace<R> {
        let mut inputs = vec![input];
        let mut output = Vec::new();
        for (i, layer) in self.layers.iter().enumerate() {
            output = layer.forward(&inputs[i]);
            if i + 1 < self.layers.len() {
                let joined = if i == 0 { late } else { &[] };
                inputs.push(output.iter().map(|v| v.max(R::ZERO)).chain(joined.iter().copied()).collect());
            }
        }
        Trace { inputs, output }
    }

    /// Adds to `gradient` the derivative of a loss by the weights, and returns that by the inputs; `d_output` is that
    /// by the output.
    pub fn backward(&self, trace: &Trace<R>, d_output: &[R], gradient: &mut Self) -> InputGradient<R> {
        let mut d = d_output.to_vec();
        let mut late = Vec::new();
        for i in (0..self.layers.len()).rev() {
            let x = &trace.inputs[i];
            d = self.layers[i].backward(x, &d, &mut gradient.layers[i]);
            if i > 0 {
                let joined = d.split_off(self.layers[i - 1].outputs);
                if i == 1 {
                    late = joined;
                }
                for (d, &x) in d.iter_mut().zip(x) {
                    if x <= R::ZERO {
                        *d = R::ZERO;
                    }
                }
            }
        }
        InputGradient { input: d, late }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::Random;

    fn network(shape: &[(usize, usize)]) -> Network<f64> {
        let random = Random::new(11, 0);
        let layers = shape.iter().enumerate().map(|(l, &(inputs, outputs))| Layer {
            inputs,
            outputs,
            weight: (0..inputs * outputs)
                .map(|i| f64::from(random.uniform_at((l * 1000 + i) as u64)) - 0.5)
                .collect(),
        });
        Network { layers: layers.collect() }
    }

    #[test]
    fn a_small_network_by_hand() {
        let layer = |outputs, weight: &[f64]| Layer {
            inputs: weight.len() / outputs,
            outputs,
            weight: weight.to_vec(),
        };
        let network = Network { layers: vec![layer(2, &[1.0, -1.0]), layer(1, &[2.0, 3.0, 5.0])] };
        // Layer 1 gives (4, -4), rectified (4, 0); -7 joins: 2 * 4 + 3 * 0 + 5 * -7.
        assert_eq!(network.forward(vec![4.0], &[-7.0]).output, [-27.0]);
    }

    #[test]
    fn gradients_agree_with_finite_differences() {
        // 5 outputs and 3 late numbers enter the second layer.
        let mut network = network(&[(4, 5), (8, 6), (6, 2)]);
        let (input, late) = (vec![0.3, -0.8, 0.5, 0.9], vec![0.7, -0.2, 0.4]);
        let d_output = [0.6, -1.1];
        let loss = |n: &Network<f64>, input: &[f64], late: &[f64]| -> f64 {
            n.forward(input.to_vec(), late).output.iter().zip(d_output).map(|(o, d)| o * d).sum()
        };
        let trace = network.forward(input.clone(), &late);
        let mut gradient = network.clone();
        gradient.layers.iter_mut().for_each(|l| l.weight.fill(0.0));
        let by_input = network.backward(&trace, &d_output, &mut gradient);

        let h = 1e-6;
        let close =
            |numeric: f64, analytic: f64| assert!((numeric - analytic).abs() < 1e-8, "{numeric} {analytic}");
        for l in 0..3 {
            for i in 0..network.layers[l].weight.len() {
                let w = network.layers[l].weight[i];
                let mut at = |v| {
                    network.layers[l].weight[i] = v;
                    loss(&network, &input, &late)
                };
                let numeric = (at(w + h) - at(w - h)) / (2.0 * h);
                at(w);
                close(numeric, gradient.layers[l].weight[i]);
            }
        }
        let shifted = |values: &[f64], i: usize, by: f64| {
            let mut values = values.to_vec();
            values[i] += by;
            values
        };
        for i in 0..4 {
            let at = |by| loss(&network, &shifted(&input, i, by), &late);
            close((at(h) - at(-h)) / (2.0 * h), by_input.input[i]);
        }
        for i in 0..3 {
            let at = |by| loss(&network, &input, &shifted(&late, i, by));
            close((at(h) - at(-h)) / (2.0 * h), by_input.late[i]);
        }
    }
}
