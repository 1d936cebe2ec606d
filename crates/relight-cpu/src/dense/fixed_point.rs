//! Layers in fixed point of 16 bits: processors with AVX-512 VNNI multiply and add twice as many of those at a time.
//!
//! All numbers of a column share a scale, and so do all weights of an output, that makes the largest of either [`TOP`]: 12 bits
//! and a sign, four more than bfloat16 keeps of a number as large, and so few that products are summed exactly. Of a column of small
//! numbers as much is kept as of any other. A column with something that is not a number has nothing but such for a product (which
//! rectifiers, as in single precision, make zero).

use fearless_simd::Level;

#[cfg(target_arch = "x86_64")]
pub use kernel::multiply;

/// Inputs of a layer, at most: sums over more could overflow.
const MOST_INPUTS: usize = 64;
/// What the largest number of a column or of an output's weights becomes.
const TOP: f32 = 5792.0;
const _: () = assert!(MOST_INPUTS as i64 * (TOP * TOP) as i64 <= i32::MAX as i64);
/// Columns whose largest number is below count as if it were this, whose inverse is finite still.
const LEAST: f32 = 1.0 / (1u128 << 100) as f32;
/// Added to a small number, leaves the nearest integer in the low bits of the sum.
const MAGIC: f32 = (3u32 << 22) as f32;

/// Whether processors with these instructions multiply in fixed point.
pub fn has_fixed_point(level: Level) -> bool {
    #[cfg(target_arch = "x86_64")]
    return level.as_avx512().is_some();
    #[cfg(not(target_arch = "x86_64"))]
    {
        let _ = level;
        false
    }
}

/// The weights of a layer: `[inputs][outputs]`, pairs of inputs together.
#[cfg_attr(not(target_arch = "x86_64"), expect(dead_code))]
pub struct FixedPoint {
    /// `[pairs of inputs][outputs]`: the first in the low half.
    pairs: Vec<u32>,
    /// `[outputs]`: what an integer of 1 is.
    scales: Vec<f32>,
}

impl FixedPoint {
    /// Takes weights, `[inputs][outputs]`; `None` if inputs are so many that sums could overflow, more than 64.
    pub fn new(weights: &[f32], outputs: usize) -> Option<Self> {
        if weights.len() > MOST_INPUTS * outputs {
            return None;
        }
        let mut scales = vec![LEAST; outputs];
        for row in weights.chunks_exact(outputs) {
            // By bits, for which what is not a number is larger than all that are.
            let larger = |s: &mut f32, w: &f32| *s = f32::from_bits(s.to_bits().max(w.abs().to_bits()));
            scales.iter_mut().zip(row).for_each(|(s, w)| larger(s, w));
        }
        let mut pairs = Vec::new();
        for two in weights.chunks(2 * outputs) {
            let (low, high) = two.split_at(outputs);
            pairs.extend(low.iter().zip(&scales).map(|(&w, s)| integer(w, TOP / s) & 0xffff));
            let row = pairs.len() - outputs;
            let both = pairs[row..].iter_mut().zip(high).zip(&scales);
            both.for_each(|((pair, &w), s)| *pair |= integer(w, TOP / s) << 16);
        }
        scales.iter_mut().for_each(|s| *s *= 1.0 / TOP);
        Some(Self { pairs, scales })
    }
}

/// The integer nearest to `number * factor`, in the low 16 bits.
fn integer(number: f32, factor: f32) -> u32 {
    number.mul_add(factor, MAGIC).to_bits()
}

#[cfg(target_arch = "x86_64")]
mod kernel {
    use std::arch::x86_64::{__m512i, _mm512_dpwssd_epi32};

    use fearless_simd::{Avx512, f32x16, i32x16, prelude::*, u32x16};

    use super::super::{BLOCK_VECTORS, Base, COLUMN_ALIGN, Store, finish};
    use super::{FixedPoint, LEAST, MAGIC, MOST_INPUTS, TOP};

    type F = f32x16<Avx512>;
    type I = i32x16<Avx512>;
    type U = u32x16<Avx512>;

    /// Some columns, pairs of inputs together, and what an integer of 1 is in each.
    struct Packed<const V: usize> {
        pairs: [[[i32; COLUMN_ALIGN]; V]; MOST_INPUTS / 2],
        scales: [F; V],
    }

    /// [`multiply`](super::super::multiply) by the columns of `a` from `first` on.
    pub fn multiply(
        simd: Avx512,
        (a, first): (&FixedPoint, usize),
        x: &[f32],
        y: &mut [f32],
        shape: (usize, usize, usize),
        base: Option<Base<'_>>,
        store: Store<'_>,
    ) {
        debug_assert_eq!(a.pairs.len(), shape.0.div_ceil(2) * a.scales.len());
        simd.vectorize(
            #[inline(always)]
            || {
                let columns = shape.2;
                let full = columns - columns % (BLOCK_VECTORS * COLUMN_ALIGN);
                let starts = (0..full).step_by(BLOCK_VECTORS * COLUMN_ALIGN);
                all_rows::<BLOCK_VECTORS>(simd, (a, first), x, y, shape, starts, base, store);
                if full < columns {
                    let starts = (full..columns).step_by(COLUMN_ALIGN);
                    all_rows::<1>(simd, (a, first), x, y, shape, starts, base, store);
                }
            },
        );
    }

    /// All rows of the product, at the columns that `V` vectors hold from each of `starts` on.
    #[inline(always)]
    #[allow(clippy::too_many_arguments)]
    fn all_rows<const V: usize>(
        simd: Avx512,
        (a, first): (&FixedPoint, usize),
        x: &[f32],
        y: &mut [f32],
        (inputs, outputs, columns): (usize, usize, usize),
        starts: impl Iterator<Item = usize>,
        base: Option<Base<'_>>,
        store: Store<'_>,
    ) {
        let mut packed = Packed {
            // Numbers and no vectors, which would be made elsewhere and copied.
            pairs: [[[0; COLUMN_ALIGN]; V]; MOST_INPUTS / 2],
            scales: [F::splat(simd, 0.0); V],
        };
        for c in starts {
            packed.set(simd, &x[..inputs * columns], columns, c);
            let mut m = 0;
            while m + 8 <= outputs {
                block::<8, V>(simd, &packed, (a, first), y, columns, (m, c), base, store);
                m += 8;
            }
            while m < outputs {
                block::<1, V>(simd, &packed, (a, first), y, columns, (m, c), base, store);
                m += 1;
            }
        }
    }

    impl<const V: usize> Packed<V> {
        /// Takes the columns from `c` on of `x`, rows of `columns` numbers.
        #[inline(always)]
        fn set(&mut self, simd: Avx512, x: &[f32], columns: usize, c: usize) {
            let load =
                |row: &[f32], j: usize| F::from_slice(simd, &row[c + j * COLUMN_ALIGN..][..COLUMN_ALIGN]);
            let magnitude = U::splat(simd, 0x7fff_ffff);
            let mut largest = [U::splat(simd, LEAST.to_bits()); V];
            for row in x.chunks_exact(columns) {
                for (j, largest) in largest.iter_mut().enumerate() {
                    *largest = largest.max(load(row, j).bitcast::<U>() & magnitude);
                }
            }
            let largest = largest.map(|bits| bits.bitcast::<F>());
            self.scales = largest.map(|l| l * F::splat(simd, 1.0 / TOP));
            let factors = largest.map(|l| F::splat(simd, TOP) / l);
            let magic = F::splat(simd, MAGIC);
            let low_half = I::splat(simd, 0xffff);
            let integer = |row: &[f32], j: usize| load(row, j).mul_add(factors[j], magic).bitcast::<I>();
            for (pair, two) in self.pairs.iter_mut().zip(x.chunks(2 * columns)) {
                let (low, high) = two.split_at(columns);
                for (j, pair) in pair.iter_mut().enumerate() {
                    let mut both = integer(low, j) & low_half;
                    if !high.is_empty() {
                        both |= integer(high, j) << 16;
                    }
                    both.store_slice(pair);
                }
            }
        }
    }

    /// An `M` by `V` block of vectors of the product, held in registers over the whole sum.
    #[inline(always)]
    #[allow(clippy::too_many_arguments)]
    fn block<const M: usize, const V: usize>(
        simd: Avx512,
        packed: &Packed<V>,
        (a, first): (&FixedPoint, usize),
        y: &mut [f32],
        columns: usize,
        (m, c): (usize, usize),
        base: Option<Base<'_>>,
        store: Store<'_>,
    ) {
        let (first, width) = (first + m, a.scales.len());
        let mut sum = [[I::splat(simd, 0); V]; M];
        for (x, a) in packed.pairs.iter().zip(a.pairs.chunks_exact(width)) {
            let a = &a[first..first + M];
            let x: [I; V] = std::array::from_fn(|j| I::from_slice(simd, &x[j]));
            for i in 0..M {
                let a = I::splat(simd, a[i] as i32);
                for j in 0..V {
                    sum[i][j] = add_products(simd, sum[i][j], x[j], a);
                }
            }
        }
        // Nothing else here, so that the sums stay in registers from first to last.
        let block = &mut y[m * columns + c..];
        for i in 0..M {
            let scale = F::splat(simd, a.scales[first + i]);
            for j in 0..V {
                let product = sum[i][j].to_float::<F>() * scale * packed.scales[j];
                product.store_slice(&mut block[i * columns + j * COLUMN_ALIGN..][..COLUMN_ALIGN]);
            }
        }
        finish::<Avx512, M, V>(simd, y, columns, (m, c), base, store);
    }

    /// `sum`, and the products of the low halves and of the high ones.
    #[inline(always)]
    fn add_products(simd: Avx512, sum: I, a: I, b: I) -> I {
        let [sum, a, b]: [__m512i; 3] = [sum.into(), a.into(), b.into()];
        // SAFETY: the processor has the instruction: AVX-512 VNNI is among those that `simd` stands for.
        I::simd_from(simd, unsafe { _mm512_dpwssd_epi32(sum, a, b) })
    }
}

#[cfg(all(test, target_arch = "x86_64"))]
mod tests {
    use super::super::tests::numbers;
    use super::super::{Base, Matrix, Store, padded, repeat_rows};
    use super::*;

    /// Inputs, outputs and columns.
    const SHAPES: [(usize, usize, usize); 6] =
        [(64, 64, 192), (16, 64, 16), (33, 17, 48), (63, 64, 208), (MOST_INPUTS, 24, 32), (17, 33, 112)];

    fn multiply(a: &[f32], stride: usize, first: usize, x: &[f32], shape: (usize, usize, usize)) -> Vec<f32> {
        multiply_to(a, stride, first, x, shape, None, Store::Set)
    }

    fn multiply_to(
        a: &[f32],
        stride: usize,
        first: usize,
        x: &[f32],
        shape: (usize, usize, usize),
        base: Option<Base<'_>>,
        store: Store<'_>,
    ) -> Vec<f32> {
        let (fixed, mut y) = (FixedPoint::new(a, stride), vec![f32::NAN; shape.1 * shape.2]);
        assert!(fixed.is_some());
        let matrix = Matrix { fixed: fixed.as_ref(), ..Matrix::new(a, stride, first) };
        super::super::multiply(Level::new(), matrix, x, &mut y, shape, base, store);
        y
    }

    /// What the kernel does, number by number: sums of products of integers, and what an integer is worth.
    fn plain(a: &[f32], stride: usize, first: usize, x: &[f32], shape: (usize, usize, usize)) -> Vec<f32> {
        let (inputs, outputs, columns) = shape;
        let scale = |largest: f32| (largest.max(LEAST) * (1.0 / TOP), TOP / largest.max(LEAST));
        let integer = |number: f32, factor: f32| i64::from(integer(number, factor) as u16 as i16);
        let mut y = Vec::new();
        for m in first..first + outputs {
            let weights: Vec<f32> = (0..inputs).map(|k| a[k * stride + m]).collect();
            let (unit, factor) = scale(weights.iter().fold(0.0, |l, w| w.abs().max(l)));
            for c in 0..columns {
                let column: Vec<f32> = (0..inputs).map(|k| x[k * columns + c]).collect();
                let (column_unit, column_factor) = scale(column.iter().fold(0.0, |l, v| v.abs().max(l)));
                let products = weights.iter().zip(&column);
                let sum: i64 = products.map(|(&w, &v)| integer(w, factor) * integer(v, column_factor)).sum();
                y.push(sum as f32 * unit * column_unit);
            }
        }
        y
    }

    #[test]
    fn the_kernel_sums_integers_exactly() {
        for shape in SHAPES.into_iter().filter(|_| has_fixed_point(Level::new())) {
            let (inputs, outputs, columns) = shape;
            let (stride, first) = (outputs + 3, 2);
            let (a, x) = (numbers(inputs * stride, 1), numbers(inputs * columns, 2));
            let product = plain(&a, stride, first, &x, shape);
            assert_eq!(multiply(&a, stride, first, &x, shape), product, "{shape:?}");

            let (mask, rows) = (numbers(outputs * columns, 3), numbers(outputs * padded(17), 4));
            let mut repeated = vec![f32::NAN; outputs * Base::stride(17)];
            repeat_rows(&rows, 17, &mut repeated);
            let base = Some(Base { data: &repeated, period: 17 });
            let stores = [Store::Set, Store::Rectified, Store::WherePositive(&mask)];
            for (base, store) in [None, base].into_iter().flat_map(|base| stores.map(|store| (base, store))) {
                let stored = |(i, product): (usize, &f32)| {
                    let added = base.map(|_| rows[i / columns * padded(17) + i % columns % 17]);
                    let value = added.map_or(*product, |added| product + added);
                    match store {
                        Store::Set => value,
                        Store::Rectified => value.max(0.0),
                        Store::WherePositive(_) if mask[i] > 0.0 => value,
                        Store::WherePositive(_) => 0.0,
                    }
                };
                let expected: Vec<f32> = product.iter().enumerate().map(stored).collect();
                assert_eq!(multiply_to(&a, stride, first, &x, shape, base, store), expected, "{shape:?}");
            }
        }
    }

    #[test]
    fn products_are_those_of_single_precision_to_12_bits() {
        for shape in SHAPES {
            let (inputs, outputs, columns) = shape;
            let (a, x) = (numbers(inputs * outputs, 1), numbers(inputs * columns, 2));
            let ours = multiply(&a, outputs, 0, &x, shape);
            for (i, ours) in ours.iter().enumerate() {
                let terms = (0..inputs).map(|k| a[k * outputs + i / columns] * x[k * columns + i % columns]);
                let exact: f32 = terms.sum();
                // Both factors are at most a half, and off by at most half an integer's worth.
                let bound = inputs as f32 * 2.0 * 0.5 * (0.5 * 0.5 / TOP) * 1.01;
                assert!((ours - exact).abs() < bound, "{shape:?}, number {i}: {ours} {exact}");
            }
        }
    }

    #[test]
    fn the_largest_numbers_fit_and_small_columns_keep_their_bits() {
        let shape = (MOST_INPUTS, 16, 16);
        let close = |ours: f32, wanted: f32| (ours / wanted - 1.0).abs() < 1e-3;
        for size in [1.0f32, 1e6, 1e-9, 1e-20] {
            let (a, x) = (vec![-3.0; shape.0 * shape.1], vec![size; shape.0 * shape.2]);
            let wanted = -3.0 * size * MOST_INPUTS as f32;
            assert!(multiply(&a, 16, 0, &x, shape).iter().all(|&y| close(y, wanted)), "{size}");
        }
        let nothing = multiply(&vec![0.0; shape.0 * 16], 16, 0, &vec![0.0; shape.0 * 16], shape);
        assert!(nothing.iter().all(|&y| y == 0.0));
        let tiny = multiply(&vec![1.0; shape.0 * 16], 16, 0, &vec![1e-38; shape.0 * 16], shape);
        assert!(tiny.iter().all(|&y| (0.0..=1e-30).contains(&y)), "{tiny:?}");
    }

    #[test]
    fn layers_whose_sums_could_overflow_are_refused() {
        assert!(FixedPoint::new(&[1.0; MOST_INPUTS * 3], 3).is_some());
        assert!(FixedPoint::new(&[1.0; (MOST_INPUTS + 1) * 3], 3).is_none());
    }

    #[test]
    fn what_is_not_a_number_spoils_its_column_and_no_other() {
        let shape = (64, 16, 48);
        for bad in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
            let (a, mut x) = (numbers(64 * 16, 1), numbers(64 * 48, 2));
            x[5 * 48 + 20] = bad;
            let y = multiply(&a, 16, 0, &x, shape);
            assert!(y.iter().enumerate().all(|(i, y)| y.is_finite() == (i % 48 != 20)), "{bad}");
            let y = multiply_to(&a, 16, 0, &x, shape, None, Store::Rectified);
            assert!(
                !has_fixed_point(Level::new()) || y.iter().skip(20).step_by(48).all(|&y| y == 0.0),
                "{bad}"
            );
            let (mut a, x) = (numbers(64 * 16, 1), numbers(64 * 48, 2));
            a[7 * 16 + 3] = bad;
            let y = multiply(&a, 16, 0, &x, shape);
            assert!(y.iter().enumerate().all(|(i, y)| y.is_finite() == (i / 48 != 3)), "{bad}");
        }
    }
}
