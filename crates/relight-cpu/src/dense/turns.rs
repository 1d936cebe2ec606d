//! Rows that the columns of a product go through again and again: what all lights of a point share.

use fearless_simd::{Level, Simd, dispatch, prelude::*};

use super::{COLUMN_ALIGN, padded};

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

    /// Which number of its row column `column` goes through.
    #[inline(always)]
    pub(super) fn turned(self, column: usize) -> usize {
        column % self.period
    }

    /// Those of row `row` from its number `turned` on.
    #[inline(always)]
    pub(super) fn vector<S: Simd>(self, simd: S, row: usize, turned: usize) -> S::f32s {
        let first = row * Self::stride(self.period) + turned;
        S::f32s::from_slice(simd, &self.data[first..first + S::f32s::LEN])
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
mod tests {
    use super::*;
    use crate::dense::tests::{levels, numbers};

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
