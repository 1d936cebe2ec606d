//! The weight gradient of a layer: sums over columns of products of two rows each.

use fearless_simd::{Level, Simd, dispatch, prelude::*};

use super::COLUMN_ALIGN;

/// Some columns of a small row-major matrix that is added to.
pub struct MatrixMut<'a> {
    /// The whole matrix.
    pub data: &'a mut [f32],
    /// Its columns.
    pub stride: usize,
    /// First column in use.
    pub first: usize,
}

/// `w[m][k] += sum_c dy[m][c] * x[k][c]`: the weight gradient of a layer with inputs `x` and output gradients `dy`.
///
/// `w` has `outputs` rows, of which `inputs` columns are added to; `x` and `dy` have rows of `columns` numbers, a multiple of [`COLUMN_ALIGN`].
pub fn accumulate_outer(
    level: Level,
    dy: &[f32],
    x: &[f32],
    w: MatrixMut<'_>,
    (inputs, outputs, columns): (usize, usize, usize),
) {
    debug_assert!(columns.is_multiple_of(COLUMN_ALIGN) && w.first + inputs <= w.stride);
    let (dy, x) = (&dy[..outputs * columns], &x[..inputs * columns]);
    let w = MatrixMut { data: &mut w.data[..outputs * w.stride], ..w };
    dispatch!(level, simd => outer_simd(simd, dy, x, w, inputs, columns));
}

#[inline(always)]
fn outer_simd<S: Simd>(simd: S, dy: &[f32], x: &[f32], w: MatrixMut<'_>, inputs: usize, columns: usize) {
    let tall = 4;
    let MatrixMut { data, stride, first } = w;
    let full = dy.len() / (tall * columns) * tall;
    let (dy_full, dy_rest) = dy.split_at(full * columns);
    let (w_full, w_rest) = data.split_at_mut(full * stride);
    for (dy, data) in dy_full.chunks_exact(tall * columns).zip(w_full.chunks_exact_mut(tall * stride)) {
        outer_rows::<S, 4>(simd, dy, x, MatrixMut { data, stride, first }, inputs, columns);
    }
    for (dy, data) in dy_rest.chunks_exact(columns).zip(w_rest.chunks_exact_mut(stride)) {
        outer_rows::<S, 1>(simd, dy, x, MatrixMut { data, stride, first }, inputs, columns);
    }
}

/// `M` rows of the gradient, some columns of it at a time.
#[inline(always)]
fn outer_rows<S: Simd, const M: usize>(
    simd: S,
    dy: &[f32],
    x: &[f32],
    mut w: MatrixMut<'_>,
    inputs: usize,
    columns: usize,
) {
    let mut k = 0;
    // 32 registers hold a block twice as wide as 16 do.
    if S::f32s::LEN >= 16 {
        while k + 4 <= inputs {
            outer_block::<S, M, 4>(simd, dy, &x[k * columns..(k + 4) * columns], &mut w, columns, k);
            k += 4;
        }
    }
    while k + 2 <= inputs {
        outer_block::<S, M, 2>(simd, dy, &x[k * columns..(k + 2) * columns], &mut w, columns, k);
        k += 2;
    }
    if k < inputs {
        outer_block::<S, M, 1>(simd, dy, &x[k * columns..(k + 1) * columns], &mut w, columns, k);
    }
}

/// An `M` by `K` block of the gradient: lane-wise sums in registers, added up at the end.
#[inline(always)]
fn outer_block<S: Simd, const M: usize, const K: usize>(
    simd: S,
    dy: &[f32],
    x: &[f32],
    w: &mut MatrixMut<'_>,
    columns: usize,
    k: usize,
) {
    let lanes = S::f32s::LEN;
    let mut sum = [[S::f32s::splat(simd, 0.0); K]; M];
    let dy: [&[f32]; M] = std::array::from_fn(|i| &dy[i * columns..(i + 1) * columns]);
    let x: [&[f32]; K] = std::array::from_fn(|j| &x[j * columns..(j + 1) * columns]);
    let mut c = 0;
    while c + lanes <= columns {
        let v: [S::f32s; K] = std::array::from_fn(|j| S::f32s::from_slice(simd, &x[j][c..c + lanes]));
        for i in 0..M {
            let d = S::f32s::from_slice(simd, &dy[i][c..c + lanes]);
            for j in 0..K {
                sum[i][j] = d.mul_add(v[j], sum[i][j]);
            }
        }
        c += lanes;
    }
    let mut totals = [[0f32; K]; M];
    lane_sums::<S>(sum.as_flattened_mut(), totals.as_flattened_mut());
    let first = w.first + k;
    for (row, totals) in w.data.chunks_exact_mut(w.stride).zip(&totals) {
        row[first..first + K].iter_mut().zip(totals).for_each(|(w, total)| *w += total);
    }
}

/// Sums over the lanes of each vector; where there are as many vectors as lanes, of all at once: a vector that takes
/// its lanes in turn from two others, added to its like of their other halves, holds half the sums of each.
#[inline(always)]
fn lane_sums<S: Simd>(vectors: &mut [S::f32s], totals: &mut [f32]) {
    if vectors.len() != S::f32s::LEN {
        vectors.iter().zip(totals).for_each(|(vector, total)| *total = vector.reduce_sum());
        return;
    }
    let mut left = vectors.len();
    let unused_bits = usize::BITS - left.trailing_zeros();
    while left > 1 {
        left /= 2;
        for i in 0..left {
            let (a, b) = (vectors[2 * i], vectors[2 * i + 1]);
            vectors[i] = a.zip_low(b) + a.zip_high(b);
        }
    }
    // The first choice between two vectors became the highest bit of the lane.
    for (lane, &total) in vectors[0].as_slice().iter().enumerate() {
        totals[lane.reverse_bits() >> unused_bits] = total;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dense::tests::{SHAPES, levels, numbers};

    #[test]
    fn outer_adds_plain_sums() {
        for ((inputs, outputs, columns), level) in
            SHAPES.into_iter().flat_map(|s| levels().into_iter().map(move |l| (s, l)))
        {
            let (dy, x) = (numbers(outputs * columns, 1), numbers(inputs * columns, 2));
            let (stride, first) = (inputs + 3, 2);
            let before = numbers(stride * outputs, 3);
            let mut w = before.clone();
            let target = MatrixMut { data: &mut w, stride, first };
            accumulate_outer(level, &dy, &x, target, (inputs, outputs, columns));
            for m in 0..outputs {
                for k in 0..stride {
                    let sum = |k: usize| (0..columns).map(|c| dy[m * columns + c] * x[k * columns + c]).sum();
                    let inside = (first..first + inputs).contains(&k);
                    let plain: f32 = if inside { sum(k - first) } else { 0.0 };
                    let got = w[m * stride + k] - before[m * stride + k];
                    assert!((got - plain).abs() < 1e-3, "{m} {k}: {got} is not {plain}");
                }
            }
        }
    }
}
