//! Dense layers on tiles of samples.
//!
//! Activations are stored feature by feature, `[feature][column]`, so that a vector register holds one feature of
//! neighbouring samples: rectifiers, masks and encodings need no shuffles, and a layer is a product of a small
//! matrix with a wide one. Two products are all that a network needs: [`multiply`] (forward and input gradient) and
//! [`accumulate_outer`] (weight gradient). Both keep a block of results in registers while they run over the sum.

mod fixed_point;
mod outer;
mod turns;

use fearless_simd::{Level, Simd, dispatch, prelude::*};

pub use fixed_point::{FixedPoint, has_fixed_point};
pub use outer::{MatrixMut, accumulate_outer};
pub use turns::{Base, add_turns, repeat_rows};

/// Columns of a tile are padded to a multiple of this, the widest vector register in use.
pub const COLUMN_ALIGN: usize = 16;

/// Vectors of columns that one register block of [`multiply`] spans.
const BLOCK_VECTORS: usize = 3;

/// Inputs and outputs from which on a layer is faster in fixed point: columns have to be packed for it.
#[cfg(target_arch = "x86_64")]
const WORTH_PACKING: usize = 16;

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

/// Some columns of a small row-major matrix.
#[derive(Clone, Copy)]
pub struct Matrix<'a> {
    /// The whole matrix.
    pub data: &'a [f32],
    /// Its columns.
    pub stride: usize,
    /// First column in use.
    pub first: usize,
    /// The same in fixed point, to be multiplied so where the processor can.
    pub fixed: Option<&'a FixedPoint>,
}

impl<'a> Matrix<'a> {
    /// The columns from `first` on of a matrix of `stride` columns, to be multiplied in single precision.
    pub fn new(data: &'a [f32], stride: usize, first: usize) -> Self {
        Self { data, stride, first, fixed: None }
    }
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
    #[cfg(target_arch = "x86_64")]
    if let (Some(fixed), Some(simd)) = (a.fixed, level.as_avx512())
        && outputs.min(inputs) >= WORTH_PACKING
    {
        let shape = (inputs, outputs, columns);
        return fixed_point::multiply(simd, (fixed, a.first), x, y, shape, base, store);
    }
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
    // Nothing else here, so that the compiler writes all stores out and keeps the sums in registers from first to last.
    let block = &mut y[m * columns + c..];
    for i in 0..M {
        for j in 0..V {
            sum[i][j].store_slice(&mut block[i * columns + j * lanes..][..lanes]);
        }
    }
    finish::<S, M, V>(simd, y, columns, (m, c), base, store);
}

/// Does to an `M` by `V` block of vectors of a product what is to be done before it is stored for good.
#[inline(always)]
fn finish<S: Simd, const M: usize, const V: usize>(
    simd: S,
    y: &mut [f32],
    columns: usize,
    (m, c): (usize, usize),
    base: Option<Base<'_>>,
    store: Store<'_>,
) {
    let lanes = S::f32s::LEN;
    if base.is_none() && matches!(store, Store::Set) {
        return;
    }
    let turned: [usize; V] = std::array::from_fn(|j| base.map_or(0, |base| base.turned(c + j * lanes)));
    for i in 0..M {
        for (j, &turned) in turned.iter().enumerate() {
            let at = (m + i) * columns + c + j * lanes;
            let product = S::f32s::from_slice(simd, &y[at..at + lanes]);
            let base = base.map(|base| base.vector(simd, m + i, turned));
            finished(simd, product, base, store, at).store_slice(&mut y[at..at + lanes]);
        }
    }
}

/// A vector of the product as it is to be stored from number `at` of the result on.
#[inline(always)]
fn finished<S: Simd>(
    simd: S,
    product: S::f32s,
    base: Option<S::f32s>,
    store: Store<'_>,
    at: usize,
) -> S::f32s {
    let zero = S::f32s::splat(simd, 0.0);
    let value = base.map_or(product, |base| product + base);
    match store {
        Store::Set => value,
        Store::Rectified => value.max(zero),
        Store::WherePositive(activation) => {
            let activation = S::f32s::from_slice(simd, &activation[at..at + S::f32s::LEN]);
            activation.simd_gt(zero).select(value, zero)
        }
    }
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

    pub(crate) fn numbers(n: usize, seed: u32) -> Vec<f32> {
        (0..n as u32)
            .map(|i| ((i.wrapping_mul(2654435761).wrapping_add(seed)) >> 8) as f32 / 1.7e7 - 0.5)
            .collect()
    }

    pub(crate) const SHAPES: [(usize, usize, usize); 5] =
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
                let matrix = Matrix::new(&a, stride, first);
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
}
