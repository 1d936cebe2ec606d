//! Dense layers on tiles of samples.
//!
//! Activations are stored feature by feature, `[feature][column]`, so that a vector register holds one feature of
//! neighbouring samples: rectifiers, masks and encodings need no shuffles, and a layer is a product of a small
//! matrix with a wide one. Two products are all that a network needs: [`multiply`] (forward and input gradient) and
//! [`accumulate_outer`] (weight gradient). Both keep a block of results in registers while they run over the sum.

use fearless_simd::{Level, Simd, dispatch, prelude::*};

/// Columns of a tile are padded to a multiple of this, the widest vector register in use.
pub const COLUMN_ALIGN: usize = 16;

/// Vectors of columns that one register block of [`multiply`] spans.
const BLOCK_VECTORS: usize = 3;

/// Rounds a number of columns up to [`COLUMN_ALIGN`].
pub const fn padded(columns: usize) -> usize {
    columns.next_multiple_of(COLUMN_ALIGN)
}

/// What happens to a product on its way to memory.
#[derive(Clone, Copy)]
pub enum Store<'a> {
    /// It replaces what was there.
    Set,
    /// It replaces what was there, negative values as zero.
    Rectified,
    /// It replaces what was there, as zero wherever this array (laid out like the result) is not positive: the
    /// derivative of a rectifier with these outputs.
    WherePositive(&'a [f32]),
}

/// What a product is added to: rows that its columns go through again and again.
#[derive(Clone, Copy)]
pub struct Base<'a> {
    /// `[outputs][stride(period)]`, as [`repeat_rows`] makes it.
    pub data: &'a [f32],
    /// Numbers of a row before it begins again, above 0.
    pub period: usize,
}

impl Base<'_> {
    /// Numbers that a row takes: a vector that begins anywhere in the first period is read in one piece.
    pub const fn stride(period: usize) -> usize {
        padded(period) + COLUMN_ALIGN
    }
}

/// Some columns of a small row-major matrix.
#[derive(Clone, Copy)]
pub struct Matrix<'a> {
    /// The whole matrix.
    pub data: &'a [f32],
    /// Its columns.
    pub stride: usize,
    /// First column in use.
    pub first: usize,
}

/// Some columns of a small row-major matrix that is added to.
pub struct MatrixMut<'a> {
    /// The whole matrix.
    pub data: &'a mut [f32],
    /// Its columns.
    pub stride: usize,
    /// First column in use.
    pub first: usize,
}

/// `y[m][c] = base[m][c % period] + sum_k a[k][m] * x[k][c]` for `outputs` rows `m` and `columns` columns `c`; without a base,
/// the sum alone.
///
/// `a` has `inputs` rows and at least `outputs` columns; `x` and `y` have rows of `columns` numbers, a multiple of
/// [`COLUMN_ALIGN`]. With the transposed weights as `a` this is a layer; with the weights as they are stored, its
/// input gradient, or that of some of its inputs.
pub fn multiply(
    level: Level,
    a: Matrix<'_>,
    x: &[f32],
    y: &mut [f32],
    (inputs, outputs, columns): (usize, usize, usize),
    base: Option<Base<'_>>,
    store: Store<'_>,
) {
    debug_assert!(columns.is_multiple_of(COLUMN_ALIGN) && a.first + outputs <= a.stride);
    let a = Matrix { data: &a.data[..inputs * a.stride], ..a };
    let (x, y) = (&x[..inputs * columns], &mut y[..outputs * columns]);
    dispatch!(level, simd => multiply_simd(simd, a, x, y, outputs, columns, base, store));
}

#[inline(always)]
#[allow(clippy::too_many_arguments)]
fn multiply_simd<S: Simd>(
    simd: S,
    a: Matrix<'_>,
    x: &[f32],
    y: &mut [f32],
    outputs: usize,
    columns: usize,
    base: Option<Base<'_>>,
    store: Store<'_>,
) {
    let wide = BLOCK_VECTORS * S::f32s::LEN;
    let mut c = 0;
    while c + wide <= columns {
        multiply_columns::<S, BLOCK_VECTORS>(simd, a, x, y, outputs, columns, c, base, store);
        c += wide;
    }
    while c < columns {
        multiply_columns::<S, 1>(simd, a, x, y, outputs, columns, c, base, store);
        c += S::f32s::LEN;
    }
}

/// All rows of the columns from `c` on that `V` vectors hold.
#[inline(always)]
#[allow(clippy::too_many_arguments)]
fn multiply_columns<S: Simd, const V: usize>(
    simd: S,
    a: Matrix<'_>,
    x: &[f32],
    y: &mut [f32],
    outputs: usize,
    columns: usize,
    c: usize,
    base: Option<Base<'_>>,
    store: Store<'_>,
) {
    let mut m = 0;
    // 32 registers hold a block twice as high as 16 do.
    if S::f32s::LEN >= 16 {
        while m + 8 <= outputs {
            multiply_block::<S, 8, V>(simd, a, x, y, columns, (m, c), base, store);
            m += 8;
        }
    }
    while m + 4 <= outputs {
        multiply_block::<S, 4, V>(simd, a, x, y, columns, (m, c), base, store);
        m += 4;
    }
    while m < outputs {
        multiply_block::<S, 1, V>(simd, a, x, y, columns, (m, c), base, store);
        m += 1;
    }
}

/// An `M` by `V` block of vectors of the product, held in registers over the whole sum.
#[inline(always)]
#[allow(clippy::too_many_arguments)]
fn multiply_block<S: Simd, const M: usize, const V: usize>(
    simd: S,
    a: Matrix<'_>,
    x: &[f32],
    y: &mut [f32],
    columns: usize,
    (m, c): (usize, usize),
    base: Option<Base<'_>>,
    store: Store<'_>,
) {
    let lanes = S::f32s::LEN;
    let first = a.first + m;
    let mut sum = [[S::f32s::splat(simd, 0.0); V]; M];
    for (a, x) in a.data.chunks_exact(a.stride).zip(x.chunks_exact(columns)) {
        let a = &a[first..first + M];
        let x = &x[c..c + V * lanes];
        let mut v = [S::f32s::splat(simd, 0.0); V];
        for (v, x) in v.iter_mut().zip(x.chunks_exact(lanes)) {
            *v = S::f32s::from_slice(simd, x);
        }
        for i in 0..M {
            let a = S::f32s::splat(simd, a[i]);
            for j in 0..V {
                sum[i][j] = a.mul_add(v[j], sum[i][j]);
            }
        }
    }
    let start = m * columns + c;
    let y = &mut y[start..];
    // Nothing else here, so that the compiler writes all stores out and keeps the sums in registers from first to last.
    for i in 0..M {
        for j in 0..V {
            sum[i][j].store_slice(&mut y[i * columns + j * lanes..][..lanes]);
        }
    }
    if base.is_none() && matches!(store, Store::Set) {
        return;
    }
    let zero = S::f32s::splat(simd, 0.0);
    let turned: [usize; V] = std::array::from_fn(|j| base.map_or(0, |base| (c + j * lanes) % base.period));
    for i in 0..M {
        for (j, &turned) in turned.iter().enumerate() {
            let at = i * columns + j * lanes;
            let y = &mut y[at..at + lanes];
            let mut value = S::f32s::from_slice(simd, y);
            if let Some(base) = base {
                let first = (m + i) * Base::stride(base.period) + turned;
                value += S::f32s::from_slice(simd, &base.data[first..first + lanes]);
            }
            let value = match store {
                Store::Set => value,
                Store::Rectified => value.max(zero),
                Store::WherePositive(activation) => {
                    let activation = &activation[start + at..start + at + lanes];
                    S::f32s::from_slice(simd, activation).simd_gt(zero).select(value, zero)
                }
            };
            value.store_slice(y);
        }
    }
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

/// Rows of `period` numbers (above 0), `[n][padded(period)]`, as a [`Base`] has them, `[n][stride(period)]`: each goes on with its
/// beginning.
pub fn repeat_rows(rows: &[f32], period: usize, base: &mut [f32]) {
    debug_assert!(period > 0);
    let sources = rows.chunks_exact(padded(period));
    for (source, target) in sources.zip(base.chunks_exact_mut(Base::stride(period))) {
        target[..period].copy_from_slice(&source[..period]);
        for i in period..target.len() {
            target[i] = target[i - period];
        }
    }
}

/// `sums[m][c] = sum_i y[m][i * period + c]` of `y`, `[n][columns]`: all parts of `period` (above 0) of each row added up. What
/// fills `y` up behind its last part must be zero. `sums` is `[n][padded(period)]`, filled up with zeros.
pub fn add_turns(level: Level, y: &[f32], columns: usize, period: usize, sums: &mut [f32]) {
    debug_assert!(period > 0);
    dispatch!(level, simd => simd.vectorize(
        #[inline(always)]
        || {
            for (row, sums) in y.chunks_exact(columns).zip(sums.chunks_exact_mut(padded(period))) {
                sums.fill(0.0);
                for part in row.chunks_exact(period) {
                    sums.iter_mut().zip(part).for_each(|(sum, value)| *sum += value);
                }
            }
        },
    ));
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;

    /// Every instruction set that this machine has.
    pub(crate) fn levels() -> Vec<Level> {
        let best = Level::new();
        #[cfg(any(target_arch = "x86", target_arch = "x86_64"))]
        let lower = [
            best.as_avx2().map(|s| s.level()),
            best.as_sse4_2().map(|s| s.level()),
            best.as_sse2().map(|s| s.level()),
        ];
        #[cfg(not(any(target_arch = "x86", target_arch = "x86_64")))]
        let lower = [None];
        lower.into_iter().flatten().chain([best]).collect()
    }

    fn numbers(n: usize, seed: u32) -> Vec<f32> {
        (0..n as u32)
            .map(|i| ((i.wrapping_mul(2654435761).wrapping_add(seed)) >> 8) as f32 / 1.7e7 - 0.5)
            .collect()
    }

    const SHAPES: [(usize, usize, usize); 5] =
        [(64, 64, 192), (32, 64, 16), (64, 3, 48), (79, 64, 208), (5, 1, 32)];

    #[test]
    fn multiply_equals_plain_sums() {
        for (inputs, outputs, columns) in SHAPES {
            let (stride, first) = (outputs + 3, 2);
            let (a, x) = (numbers(inputs * stride, 1), numbers(inputs * columns, 2));
            let mask = numbers(outputs * columns, 3);
            let periods = [16, 32, 17, 5, 1];
            let rows = periods.map(|period| numbers(outputs * padded(period), 4));
            let repeated = [0, 1, 2, 3, 4].map(|i| {
                let mut base = vec![f32::NAN; outputs * Base::stride(periods[i])];
                repeat_rows(&rows[i], periods[i], &mut base);
                base
            });
            let bases = [None, Some(0), Some(1), Some(2), Some(3), Some(4)];
            let mut y = vec![f32::NAN; outputs * columns];
            let stores = [Store::Set, Store::Rectified, Store::WherePositive(&mask)];
            let cases = stores.into_iter().flat_map(|s| bases.map(|b| (s, b)));
            for ((store, base), level) in cases.flat_map(|c| levels().into_iter().map(move |l| (c, l))) {
                let matrix = Matrix { data: &a, stride, first };
                let shape = (inputs, outputs, columns);
                let repeated = base.map(|i| Base { data: &repeated[i], period: periods[i] });
                multiply(level, matrix, &x, &mut y, shape, repeated, store);
                for m in 0..outputs {
                    for c in 0..columns {
                        let plain: f32 =
                            (0..inputs).map(|k| a[k * stride + first + m] * x[k * columns + c]).sum();
                        let base = base.map_or(0.0, |i| rows[i][m * padded(periods[i]) + c % periods[i]]);
                        let plain = plain + base;
                        let plain = match store {
                            Store::Set => plain,
                            Store::Rectified => plain.max(0.0),
                            Store::WherePositive(_) if mask[m * columns + c] > 0.0 => plain,
                            Store::WherePositive(_) => 0.0,
                        };
                        let got = y[m * columns + c];
                        assert!((got - plain).abs() < 1e-4, "{m} {c}: {got} is not {plain}");
                    }
                }
            }
        }
    }

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

    #[test]
    fn turns_add_up() {
        let y = numbers(2 * 96, 1);
        for (level, period) in levels().into_iter().flat_map(|l| [32, 17, 12].map(|p| (l, p))) {
            let wide = padded(period);
            let mut sums = vec![f32::NAN; 2 * wide];
            add_turns(level, &y, 96, period, &mut sums);
            for (i, sum) in sums.iter().enumerate() {
                let (row, column) = (i / wide, i % wide);
                let turns = if column < period { 96 / period } else { 0 };
                let plain: f32 = (0..turns).map(|turn| y[row * 96 + turn * period + column]).sum();
                assert!((sum - plain).abs() < 1e-6, "{period} {i}: {sum} is not {plain}");
            }
        }
    }
}
