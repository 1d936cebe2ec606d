//! SOAP for the layers of networks, see [`Optimiser::Soap`](relight_field::optimiser::Optimiser::Soap).
//!
//! A layer's matrices have rows padded with zeros to whole vectors, so that their products are those of [`dense`](crate::dense).

use fearless_simd::{Level, Simd, dispatch};
use relight_field::optimiser::{EPSILON, FLOOR, MEMORY, renews};

use crate::adam::Adam;
use crate::aligned::Aligned;
use crate::dense::{Matrix, MatrixMut, Store, accumulate_outer, multiply, padded};

/// One side of a layer: its outputs, or its inputs.
struct Side {
    /// Outputs or inputs.
    n: usize,
    /// `[n][padded n]`: sums of products of the gradient with itself, fading.
    covariance: Aligned,
    /// `[n][padded n]`: a basis vector a row.
    basis: Aligned,
    /// The basis, a vector a column.
    transposed: Aligned,
    /// `[n][padded n]`, for what is under way.
    product: Aligned,
}

impl Side {
    fn new(n: usize) -> Self {
        let [covariance, basis, transposed, product] = std::array::from_fn(|_| Aligned::zeros(n * padded(n)));
        let mut side = Self { n, covariance, basis, transposed, product };
        side.basis.iter_mut().step_by(padded(n) + 1).for_each(|d| *d = 1.0);
        side.transposed.copy_from_slice(&side.basis);
        side
    }

    /// Brings the basis nearer to the eigenvectors of the covariance.
    fn renew(&mut self, simd: Level) {
        let (n, stride) = (self.n, padded(self.n));
        let mean = self.covariance.iter().step_by(stride + 1).sum::<f32>() / n as f32;
        // Where there never was a gradient, or none for long.
        if !mean.is_normal() {
            return;
        }
        let matrix = Matrix::new(&self.transposed, stride, 0);
        multiply(simd, matrix, &self.covariance, &mut self.product, (n, n, stride), None, Store::Set);
        // By the mean, so that lengths of rows are within single precision however small gradients are.
        let rows = self.product.iter_mut().zip(&*self.basis);
        rows.for_each(|(p, b)| *p = *p / mean + FLOOR as f32 * b);
        dispatch!(simd, simd => simd.vectorize(
            #[inline(always)]
            || orthonormalise(&mut self.product, stride),
        ));
        std::mem::swap(&mut self.basis, &mut self.product);
        self.transpose();
    }

    /// Makes `transposed` that of the basis.
    fn transpose(&mut self) {
        let stride = padded(self.n);
        for (i, row) in self.basis.chunks_exact(stride).enumerate() {
            let column = self.transposed[i..].iter_mut().step_by(stride);
            column.zip(&row[..self.n]).for_each(|(t, &b)| *t = b);
        }
    }

    /// Takes others, `[n, n]`, in place of covariance and basis.
    fn set(&mut self, [covariance, basis]: [&[f32]; 2]) {
        let stride = padded(self.n);
        for (mine, saved) in [(&mut self.covariance, covariance), (&mut self.basis, basis)] {
            let rows = mine.chunks_exact_mut(stride).zip(saved.chunks_exact(self.n));
            rows.for_each(|(row, saved)| row[..saved.len()].copy_from_slice(saved));
        }
        self.transpose();
    }

    /// `[n, n]` of a matrix with padded rows.
    fn unpadded(&self, matrix: &[f32]) -> Vec<f32> {
        matrix.chunks_exact(padded(self.n)).flat_map(|row| &row[..self.n]).copied().collect()
    }
}

/// Makes rows orthonormal, one after another.
#[inline(always)]
fn orthonormalise(rows: &mut [f32], stride: usize) {
    for i in 0..rows.len() / stride {
        let (before, row) = rows.split_at_mut(i * stride);
        let row = &mut row[..stride];
        // Once more, for what rounding leaves.
        for earlier in before.chunks_exact(stride).chain(before.chunks_exact(stride)) {
            let along = dot(earlier, row);
            row.iter_mut().zip(earlier).for_each(|(r, e)| *r -= along * e);
        }
        let length = dot(row, row).sqrt();
        row.iter_mut().for_each(|r| *r /= length);
    }
}

/// Sum of products of two rows of a multiple of 16 numbers, in an order that vectors like.
#[inline(always)]
fn dot(a: &[f32], b: &[f32]) -> f32 {
    let mut sums = [0.0; 16];
    for (a, b) in a.as_chunks::<16>().0.iter().zip(b.as_chunks::<16>().0) {
        for (sum, (a, b)) in sums.iter_mut().zip(a.iter().zip(b)) {
            *sum += a * b;
        }
    }
    sums.iter().sum()
}

/// The bases of one layer, and memory to work in.
pub struct Soap {
    outputs: Side,
    inputs: Side,
    /// `[outputs][padded inputs]`: the gradient, then what becomes of it.
    matrix: Aligned,
    /// `[outputs][padded inputs]`: half way between.
    half: Aligned,
    /// `[outputs][padded inputs]`: in the other bases.
    turned: Aligned,
}

/// Names of [`Soap::arrays`].
pub const ARRAYS: [&str; 4] = ["outputs.covariance", "outputs.basis", "inputs.covariance", "inputs.basis"];

impl Soap {
    /// The identity, for a layer of these outputs and inputs.
    pub fn new(outputs: usize, inputs: usize) -> Self {
        let [matrix, half, turned] = std::array::from_fn(|_| Aligned::zeros(outputs * padded(inputs)));
        Self { outputs: Side::new(outputs), inputs: Side::new(inputs), matrix, half, turned }
    }

    /// What is to be kept, square matrices row by row.
    pub fn arrays(&self) -> [Vec<f32>; 4] {
        let (outputs, inputs) = (&self.outputs, &self.inputs);
        [
            outputs.unpadded(&outputs.covariance),
            outputs.unpadded(&outputs.basis),
            inputs.unpadded(&inputs.covariance),
            inputs.unpadded(&inputs.basis),
        ]
    }

    /// Takes what [`Soap::arrays`] gave; false if it does not fit.
    pub fn set_arrays(&mut self, arrays: [&[f32]; 4]) -> bool {
        let (o, i) = (self.outputs.n.pow(2), self.inputs.n.pow(2));
        if arrays.map(<[f32]>::len) != [o, o, i, i] {
            return false;
        }
        let [outputs_covariance, outputs_basis, inputs_covariance, inputs_basis] = arrays;
        self.outputs.set([outputs_covariance, outputs_basis]);
        self.inputs.set([inputs_covariance, inputs_basis]);
        true
    }

    /// Additions and multiplications of an update's products; new bases, which are rare, not counted.
    pub fn operations(&self) -> usize {
        let (o, i) = (self.outputs.n, self.inputs.n);
        // The gradient with itself, into the bases and out of them, on both sides each.
        2 * 3 * (o * o * i + i * i * o)
    }

    /// Update number `count`, from 1, of layer `layer` of its network. `weights`, `gradient` and the moments are `[outputs, inputs]`,
    /// and the moments those of the gradient in the layer's bases.
    #[allow(clippy::too_many_arguments)]
    pub fn step(
        &mut self,
        simd: Level,
        weights: &mut [f32],
        gradient: &[f32],
        [m, v]: [&mut [f32]; 2],
        (layer, count): (u32, u32),
        rate: f32,
        adam: &Adam,
    ) {
        self.take(gradient);
        self.observe(simd);
        self.in_bases(simd);
        let (width, stride) = (self.inputs.n, padded(self.inputs.n));
        let (c1, c2) = adam.corrections(count);
        let rows = self.turned.chunks_exact(stride).zip(m.chunks_exact_mut(width));
        for ((g, m), v) in rows.zip(v.chunks_exact_mut(width)) {
            for ((g, m), v) in g.iter().zip(m).zip(v) {
                adam.gather([m, v], *g);
            }
        }
        let mut sums = [0.0; 16];
        for v in v.chunks(16) {
            sums.iter_mut().zip(v).for_each(|(sum, v)| *sum += v);
        }
        let mean = sums.iter().sum::<f32>() / v.len() as f32;
        let epsilon = EPSILON as f32 * (mean * c2).sqrt();
        // Else there never was a gradient other than nought.
        if epsilon > 0.0 {
            let rows = self.matrix.chunks_exact_mut(stride).zip(m.chunks_exact(width));
            for ((step, m), v) in rows.zip(v.chunks_exact(width)) {
                for ((step, m), v) in step.iter_mut().zip(m).zip(v) {
                    *step = *m * c1 / ((*v * c2).sqrt() + epsilon);
                }
            }
            self.out_of_bases(simd);
            for (weights, step) in weights.chunks_exact_mut(width).zip(self.turned.chunks_exact(stride)) {
                weights.iter_mut().zip(step).for_each(|(w, d)| *w -= rate * d);
            }
        }
        if renews(layer, count) {
            self.renew(simd, m);
        }
    }

    /// New bases, to which the first moments `m` are taken.
    fn renew(&mut self, simd: Level, m: &mut [f32]) {
        self.take(m);
        self.out_of_bases(simd);
        self.outputs.renew(simd);
        self.inputs.renew(simd);
        std::mem::swap(&mut self.matrix, &mut self.turned);
        self.in_bases(simd);
        let (width, stride) = (self.inputs.n, padded(self.inputs.n));
        for (m, turned) in m.chunks_exact_mut(width).zip(self.turned.chunks_exact(stride)) {
            m.copy_from_slice(&turned[..width]);
        }
    }

    /// Makes `matrix` this one, `[outputs, inputs]`.
    fn take(&mut self, numbers: &[f32]) {
        let (width, stride) = (self.inputs.n, padded(self.inputs.n));
        for (row, numbers) in self.matrix.chunks_exact_mut(stride).zip(numbers.chunks_exact(width)) {
            row[..width].copy_from_slice(numbers);
        }
    }

    /// Adds products of `matrix` with itself to the covariances.
    fn observe(&mut self, simd: Level) {
        let Self { outputs, inputs, matrix, .. } = self;
        let (o, stride) = (outputs.n, padded(inputs.n));
        outputs.covariance.iter_mut().for_each(|c| *c *= MEMORY as f32);
        let sums = MatrixMut { data: &mut outputs.covariance, stride: padded(o), first: 0 };
        accumulate_outer(simd, matrix, matrix, sums, (o, o, stride));
        let left = Matrix::new(matrix, stride, 0);
        multiply(simd, left, matrix, &mut inputs.product, (o, inputs.n, stride), None, Store::Set);
        let products = inputs.covariance.iter_mut().zip(&*inputs.product);
        products.for_each(|(c, p)| *c = MEMORY as f32 * *c + p);
    }

    /// `turned` becomes `matrix` in the bases.
    fn in_bases(&mut self, simd: Level) {
        let Self { outputs, inputs, matrix, half, turned } = self;
        turn(simd, (outputs, &outputs.transposed), (inputs, &inputs.basis), [matrix, half, turned]);
    }

    /// `turned` becomes what `matrix` is in the bases.
    fn out_of_bases(&mut self, simd: Level) {
        let Self { outputs, inputs, matrix, half, turned } = self;
        turn(simd, (outputs, &outputs.basis), (inputs, &inputs.transposed), [matrix, half, turned]);
    }
}

/// `turned = a^T matrix b^T`, by way of `half`.
fn turn(
    simd: Level,
    (outputs, a): (&Side, &[f32]),
    (inputs, b): (&Side, &[f32]),
    [matrix, half, turned]: [&mut [f32]; 3],
) {
    let (o, i, stride) = (outputs.n, inputs.n, padded(inputs.n));
    let a = Matrix::new(a, padded(o), 0);
    multiply(simd, a, matrix, half, (o, o, stride), None, Store::Set);
    turned.fill(0.0);
    accumulate_outer(simd, half, b, MatrixMut { data: turned, stride, first: 0 }, (i, o, stride));
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dense::tests::levels;
    use relight_field::optimiser::PERIOD;
    use relight_field::random::Random;
    use relight_field::reference;

    const UPDATES: u32 = 3 * PERIOD + 5;
    const RATE: f32 = 0.01;
    const BETA2: f64 = 0.999;

    /// The gradient of update `count`: some directions far stronger than others, none of them an axis, and a little of everything.
    fn gradient(outputs: usize, inputs: usize, count: u32) -> Vec<f32> {
        let random = Random::new(7, u64::from(count));
        let mut gradient: Vec<f32> =
            (0..(outputs * inputs) as u64).map(|at| 0.01 * (random.uniform_at(100 + at) - 0.5)).collect();
        for direction in 0..6u64 {
            let strength = 10f32.powf(-0.8 * direction as f32) * (random.uniform_at(direction) - 0.4);
            for (at, g) in gradient.iter_mut().enumerate() {
                let phase = |k: usize| ((direction as f32 + 1.3) * (k as f32 + 0.7)).sin();
                *g += strength * phase(at / inputs) * phase(at % inputs);
            }
        }
        gradient
    }

    fn weights(n: usize) -> Vec<f32> {
        let random = Random::new(7, 0);
        (0..n as u64).map(|i| random.uniform_at(i) - 0.5).collect()
    }

    #[test]
    fn updates_equal_the_references() {
        // Directions without much gradient are told apart by rounding as much as by anything else, and large layers have many.
        let shapes = [((64, 79), 3e-3), ((16, 64), 3e-3), ((3, 7), 1e-4), ((1, 33), 3e-3)];
        for (layer, ((outputs, inputs), tolerance)) in (0..).zip(shapes) {
            let n = outputs * inputs;
            let mut plain = reference::Soap::<f64>::new([outputs, inputs]);
            let mut expected: Vec<f64> = weights(n).into_iter().map(f64::from).collect();
            let (mut first, mut second) = (vec![0.0; n], vec![0.0; n]);
            for count in 1..=UPDATES {
                let gradient: Vec<f64> =
                    gradient(outputs, inputs, count).into_iter().map(f64::from).collect();
                let moments = [&mut first[..], &mut second[..]];
                plain.step(&mut expected, &gradient, moments, (layer, count), f64::from(RATE), BETA2);
            }
            for simd in levels() {
                let (mut soap, adam) = (Soap::new(outputs, inputs), Adam::new(BETA2));
                let (mut weights, mut m, mut v) = (weights(n), vec![0.0; n], vec![0.0; n]);
                for count in 1..=UPDATES {
                    // Another takes over where this one was left.
                    if count == UPDATES / 2 {
                        let arrays = soap.arrays();
                        soap = Soap::new(outputs, inputs);
                        assert!(soap.set_arrays(arrays.each_ref().map(|a| &a[..])));
                    }
                    let gradient = gradient(outputs, inputs, count);
                    soap.step(simd, &mut weights, &gradient, [&mut m, &mut v], (layer, count), RATE, &adam);
                }
                let differences = weights.iter().zip(&expected).map(|(ours, plain)| f64::from(*ours) - plain);
                let apart = (differences.map(|d| d * d).sum::<f64>() / n as f64).sqrt();
                assert!(apart < tolerance, "{simd:?}, {outputs} by {inputs}: {apart}");
            }
        }
    }

    #[test]
    fn bases_stay_orthonormal_and_find_the_strong_directions() {
        let (outputs, inputs) = (20, 48);
        let n = outputs * inputs;
        let (mut soap, adam) = (Soap::new(outputs, inputs), Adam::new(BETA2));
        let (mut weights, mut m, mut v) = (weights(n), vec![0.0; n], vec![0.0; n]);
        for count in 1..=20 * PERIOD {
            let gradient = gradient(outputs, inputs, count);
            soap.step(Level::new(), &mut weights, &gradient, [&mut m, &mut v], (0, count), RATE, &adam);
        }
        let [covariance, basis, ..] = soap.arrays();
        let rows: Vec<&[f32]> = basis.chunks_exact(outputs).collect();
        let product = |a: &[f32], b: &[f32]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f32>();
        for (i, a) in rows.iter().enumerate() {
            for (j, b) in rows.iter().enumerate() {
                let expected = f32::from(i == j);
                assert!((product(a, b) - expected).abs() < 1e-5, "{i} {j}: {}", product(a, b));
            }
        }
        let turned =
            |row: &[f32]| covariance.chunks_exact(outputs).map(|c| product(c, row)).collect::<Vec<_>>();
        let strongest = turned(rows[0]);
        let value = product(rows[0], &strongest);
        let apart: f32 = strongest.iter().zip(rows[0]).map(|(s, r)| (s - value * r).powi(2)).sum();
        assert!(apart.sqrt() < 0.05 * value, "{apart} {value}");
    }

    #[test]
    fn layers_without_gradient_stay_as_they_are() {
        let (mut soap, adam) = (Soap::new(5, 9), Adam::new(BETA2));
        let (mut weights, mut m, mut v) = (weights(45), vec![0.0; 45], vec![0.0; 45]);
        for count in 1..=2 * PERIOD {
            soap.step(Level::new(), &mut weights, &[0.0; 45], [&mut m, &mut v], (0, count), RATE, &adam);
        }
        assert_eq!(weights, self::weights(45));
        let [covariance, basis, ..] = soap.arrays();
        assert!(covariance.iter().all(|&c| c == 0.0));
        assert!(basis.iter().enumerate().all(|(i, &b)| b == f32::from(i % 6 == 0)));
    }

    /// Rectifiers that all have died give no gradient any more.
    #[test]
    fn a_gradient_that_ends_leaves_finite_weights() {
        let (mut soap, adam) = (Soap::new(64, 48), Adam::new(BETA2));
        let n = 64 * 48;
        let (mut weights, mut m, mut v) = (weights(n), vec![0.0; n], vec![0.0; n]);
        for count in 1..=100 * PERIOD {
            let mut gradient = gradient(64, 48, count.min(2 * PERIOD));
            if count > 2 * PERIOD {
                gradient.fill(0.0);
            }
            soap.step(Level::new(), &mut weights, &gradient, [&mut m, &mut v], (0, count), RATE, &adam);
        }
        assert!(weights.iter().chain(&m).chain(&v).all(|w| w.is_finite()));
        let [_, basis, ..] = soap.arrays();
        let lengths = basis.chunks_exact(64).map(|row| row.iter().map(|b| b * b).sum::<f32>());
        assert!(lengths.into_iter().all(|length| (length - 1.0).abs() < 1e-4));
    }

    #[test]
    fn updates_depend_on_no_gradients_magnitude() {
        let n = 20 * 48;
        let [plain, small, large] = [1.0, 2f32.powi(-26), 2f32.powi(20)].map(|scale| {
            let (mut soap, adam) = (Soap::new(20, 48), Adam::new(BETA2));
            let (mut weights, mut m, mut v) = (weights(n), vec![0.0; n], vec![0.0; n]);
            for count in 1..=2 * PERIOD {
                let gradient: Vec<f32> = gradient(20, 48, count).iter().map(|g| scale * g).collect();
                soap.step(Level::new(), &mut weights, &gradient, [&mut m, &mut v], (0, count), RATE, &adam);
            }
            weights
        });
        // Powers of two change no digit.
        assert_eq!(plain, small);
        assert_eq!(plain, large);
    }

    #[test]
    fn arrays_of_another_shape_are_refused() {
        let arrays = Soap::new(5, 9).arrays();
        assert!(!Soap::new(9, 5).set_arrays(arrays.each_ref().map(|a| &a[..])));
    }
}
