//! Optimise: SOAP, see [`Optimiser::Soap`](crate::optimiser::Optimiser::Soap).

use super::optimise::BETA1;
use crate::optimiser::{EPSILON, FLOOR, MEMORY, renews};
use crate::real::Real;

/// One side of a layer: its outputs, or its inputs. Matrices are row-major `[n, n]`.
#[derive(Clone, Debug)]
struct Side<R> {
    /// Outputs or inputs.
    n: usize,
    /// `A` or `B`.
    covariance: Vec<R>,
    /// `U` or `V`: a basis vector a row.
    basis: Vec<R>,
}

impl<R: Real> Side<R> {
    fn new(n: usize) -> Self {
        let identity = (0..n * n).map(|i| if i % (n + 1) == 0 { R::ONE } else { R::ZERO });
        Self { n, covariance: vec![R::ZERO; n * n], basis: identity.collect() }
    }

    /// Takes in a gradient: `entry(i, j)` is that of its product with itself over the other side.
    fn observe(&mut self, entry: impl Fn(usize, usize) -> R) {
        for (i, c) in self.covariance.iter_mut().enumerate() {
            *c = R::from_f64(MEMORY) * *c + entry(i / self.n, i % self.n);
        }
    }

    /// Brings the basis nearer to the eigenvectors of the covariance.
    fn renew(&mut self) {
        let n = self.n;
        let mean = (0..n).map(|i| self.covariance[i * n + i]).sum::<R>() / R::from_f64(n as f64);
        // Where there never was a gradient, or none for long.
        if !(mean.is_finite() && mean >= R::from_f32(f32::MIN_POSITIVE)) {
            return;
        }
        let product = multiply(&self.basis, &self.covariance, n, n);
        let floor = R::from_f64(FLOOR);
        let mut rows: Vec<R> =
            product.into_iter().zip(&self.basis).map(|(p, &b)| p / mean + floor * b).collect();
        for i in 0..n {
            let (before, row) = rows.split_at_mut(i * n);
            let row = &mut row[..n];
            // Once more, for what rounding leaves.
            for earlier in before.chunks_exact(n).chain(before.chunks_exact(n)) {
                let along = dot(earlier, row);
                row.iter_mut().zip(earlier).for_each(|(r, &e)| *r = *r - along * e);
            }
            let length = dot(row, row).sqrt();
            row.iter_mut().for_each(|r| *r = *r / length);
        }
        self.basis = rows;
    }
}

/// Names of [`Soap::arrays`].
pub(super) const ARRAYS: [&str; 4] =
    ["outputs.covariance", "outputs.basis", "inputs.covariance", "inputs.basis"];

/// The bases of one layer's weights, `[outputs, inputs]`.
#[derive(Clone, Debug)]
pub struct Soap<R> {
    outputs: Side<R>,
    inputs: Side<R>,
}

impl<R: Real> Soap<R> {
    /// The identity, for a layer of this shape.
    pub fn new([outputs, inputs]: [usize; 2]) -> Self {
        Self { outputs: Side::new(outputs), inputs: Side::new(inputs) }
    }

    /// What is to be kept.
    pub fn arrays(&self) -> [&[R]; 4] {
        let (outputs, inputs) = (&self.outputs, &self.inputs);
        [&outputs.covariance, &outputs.basis, &inputs.covariance, &inputs.basis]
    }

    /// The same, to be replaced.
    pub fn arrays_mut(&mut self) -> [&mut [R]; 4] {
        let (outputs, inputs) = (&mut self.outputs, &mut self.inputs);
        [&mut outputs.covariance, &mut outputs.basis, &mut inputs.covariance, &mut inputs.basis]
    }

    /// Update number `count`, from 1, of layer `layer`, from 0, of its network; `first` and `second` are its moments, in its bases.
    pub fn step(
        &mut self,
        weight: &mut [R],
        gradient: &[R],
        [first, second]: [&mut [R]; 2],
        (layer, count): (u32, u32),
        learning_rate: R,
        beta2: f64,
    ) {
        let (o, i) = (self.outputs.n, self.inputs.n);
        let turned = transposed(gradient, o, i);
        self.outputs.observe(|a, b| dot(&gradient[a * i..][..i], &gradient[b * i..][..i]));
        self.inputs.observe(|a, b| dot(&turned[a * o..][..o], &turned[b * o..][..o]));

        let (b1, b2) = (R::from_f64(BETA1), R::from_f64(beta2));
        for ((m, s), g) in first.iter_mut().zip(&mut *second).zip(self.in_bases(gradient)) {
            *m = b1 * *m + (R::ONE - b1) * g;
            *s = b2 * *s + (R::ONE - b2) * g * g;
        }
        let correction = |beta: f64| R::from_f64(1.0 / (1.0 - beta.powf(f64::from(count))));
        let (c1, c2) = (correction(BETA1), correction(beta2));
        let mean = second.iter().copied().sum::<R>() / R::from_f64((o * i) as f64);
        let epsilon = R::from_f64(EPSILON) * (mean * c2).sqrt();
        // Else there never was a gradient other than nought.
        if epsilon > R::ZERO {
            let moments = first.iter().zip(&*second);
            let step: Vec<R> = moments.map(|(&m, &s)| m * c1 / ((s * c2).sqrt() + epsilon)).collect();
            let step = self.out_of_bases(&step);
            weight.iter_mut().zip(step).for_each(|(w, d)| *w = *w - learning_rate * d);
        }
        if renews(layer, count) {
            let world = self.out_of_bases(first);
            self.outputs.renew();
            self.inputs.renew();
            first.copy_from_slice(&self.in_bases(&world));
        }
    }

    /// `U x V^T` of a matrix `[outputs, inputs]`.
    fn in_bases(&self, x: &[R]) -> Vec<R> {
        let (o, i) = (self.outputs.n, self.inputs.n);
        let half = multiply(&self.outputs.basis, x, o, i);
        multiply(&half, &transposed(&self.inputs.basis, i, i), i, i)
    }

    /// `U^T x V`.
    fn out_of_bases(&self, x: &[R]) -> Vec<R> {
        let (o, i) = (self.outputs.n, self.inputs.n);
        let half = multiply(&transposed(&self.outputs.basis, o, o), x, o, i);
        multiply(&half, &self.inputs.basis, i, i)
    }
}

fn dot<R: Real>(a: &[R], b: &[R]) -> R {
    a.iter().zip(b).map(|(&a, &b)| a * b).sum()
}

/// `a b` of matrices `[.., inner]` and `[inner, columns]`.
fn multiply<R: Real>(a: &[R], b: &[R], inner: usize, columns: usize) -> Vec<R> {
    let b = transposed(b, inner, columns);
    a.chunks_exact(inner).flat_map(|row| b.chunks_exact(inner).map(move |column| dot(row, column))).collect()
}

fn transposed<R: Real>(x: &[R], rows: usize, columns: usize) -> Vec<R> {
    (0..rows * columns).map(|at| x[at % rows * columns + at / rows]).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::Random;
    use serde::Deserialize;

    /// Made by `tools/golden_field.py`, with PyTorch's QR.
    #[derive(Deserialize)]
    struct Golden {
        seed: u64,
        layer: u32,
        updates: u32,
        start: Vec<Vec<f64>>,
        end: Vec<Vec<f64>>,
    }

    /// The script's gradients: three directions, one stronger than the other, and a little of everything.
    fn gradient(seed: u64, count: u32, outputs: usize, inputs: usize) -> Vec<f64> {
        let random = Random::new(seed, 1000 + u64::from(count));
        let uniform = |i: usize| f64::from(random.uniform_at(i as u64));
        let wave = |frequency: f64, phase: f64, at: usize| (frequency * (at as f64 + phase)).sin();
        let number = |at: usize| {
            let directions = (0..3).map(|d| {
                let (row, column) = (1.3 + d as f64, 2.1 + d as f64);
                let strength = 0.1f64.powi(d as i32) * (uniform(d) - 0.4);
                strength * wave(row, 0.7, at / inputs) * wave(column, 0.4, at % inputs)
            });
            0.01 * (uniform(3 + at) - 0.5) + directions.sum::<f64>()
        };
        (0..outputs * inputs).map(number).collect()
    }

    #[test]
    fn updates_are_those_of_the_published_algorithm() {
        let golden: Golden = serde_json::from_str(include_str!("../../tests/golden/soap.json")).unwrap();
        let (outputs, inputs) = (golden.start.len(), golden.start[0].len());
        let mut soap = Soap::new([outputs, inputs]);
        let mut weight = golden.start.concat();
        let (mut first, mut second) = (vec![0.0; weight.len()], vec![0.0; weight.len()]);
        for count in 1..=golden.updates {
            let gradient = gradient(golden.seed, count, outputs, inputs);
            let moments = [&mut first[..], &mut second[..]];
            soap.step(&mut weight, &gradient, moments, (golden.layer, count), 0.01, 0.999);
        }
        for (ours, theirs) in weight.iter().zip(golden.end.concat()) {
            assert!((ours - theirs).abs() < 1e-9, "{ours} {theirs}");
        }
    }
}
