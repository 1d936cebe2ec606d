//! SSIM of a band of rows.
//!
//! Windows of neighbouring pixels overlap, and filtering is quick where a vector is read once for several of them, whole and
//! aligned. So samples are filtered along columns first, with neighbours of a row in the lanes of a vector; then 16 rows by 16
//! samples are transposed, and filtered along rows with neighbours of a column in the lanes. In both directions the next sample is
//! the next vector, and all of it stays in the nearest caches.
//!
//! Every lane goes through the same fused and single operations on every machine, so that scores agree to the last bit.

use fearless_simd::{Simd, f32x16, f64x8, prelude::*};

use super::Compared;

/// `2 (k1 L)^2` and `2 (k2 L)^2` for the data range `L` = 255.
const TWICE_C1: f32 = 2.0 * (0.01 * 255.0) * (0.01 * 255.0);
const TWICE_C2: f32 = 2.0 * (0.03 * 255.0) * (0.03 * 255.0);

/// Rows of windows of a band, in the end one a lane.
pub(super) const ROWS: usize = LANES;
const LANES: usize = 16;
/// Neighbouring windows that are filtered at a time, from what then fits into registers.
const WINDOWS: usize = 4;
/// Pixels that the widest window covers besides its first.
const OVERLAP: usize = 10;
/// New samples of a row with which a band goes on.
const STEP: usize = 96;
/// Those before them, at least as many as windows overlap by, in whole groups of windows.
const KEPT: usize = (3 * OVERLAP).next_multiple_of(3 * WINDOWS);

/// Means under windows of the two pictures' sum and difference, sample by sample: of both, then of both squared. With `s = a + b` and
/// `d = a - b`, `s^2 + d^2` is twice `a^2 + b^2` and `s^2 - d^2` four times `ab`, so these are all that SSIM needs; and where the
/// pictures are alike `d` is small, so that little is lost where the squares' means cancel.
type Moments<S, const N: usize> = [[f32x16<S>; N]; 4];

/// Sums SSIM over the windows of the [`ROWS`] rows from `top` on, as far as there are any.
#[inline(always)]
pub(super) fn sum<S: Simd, const TAPS: usize>(simd: S, compared: &Compared<'_, TAPS>, top: usize) -> f64 {
    let (columns, rows) = compared.centres();
    let zero = f32x16::splat(simd, 0.0);
    let mut taps = [zero; TAPS];
    for (tap, &weight) in taps.iter_mut().zip(&compared.window.taps) {
        *tap = f32x16::splat(simd, weight);
    }
    let centre = centre(compared, top);
    let mut bytes = [[[0; STEP]; 2]; ROWS + OVERLAP];
    let mut samples = [[zero; ROWS + OVERLAP]; 2];
    // Along columns, of the samples kept and the new ones.
    let mut means = [[zero; KEPT + STEP]; 4];
    let mut sums = [f64x8::splat(simd, 0.0); 2];
    for first in (0..3 * columns + KEPT).step_by(STEP) {
        for (row, [a, b]) in bytes.iter_mut().enumerate() {
            copy_samples(compared, compared.picture, top + row, first, a);
            copy_samples(compared, compared.truth, top + row, first, b);
        }
        for means in &mut means {
            means.copy_within(STEP.., 0);
        }
        for c in (0..STEP).step_by(LANES) {
            take_samples(simd, &bytes, c, centre, &mut samples);
            let [s, d, ss, dd] = &mut means;
            for (samples, means, squares) in [(&samples[0], s, ss), (&samples[1], d, dd)] {
                let columns = KEPT + c..KEPT + c + LANES;
                means[columns.clone()].copy_from_slice(&filtered_columns(&taps, samples, |x| x));
                squares[columns].copy_from_slice(&filtered_columns(&taps, samples, |x| x * x));
            }
        }
        for group in (0..STEP).step_by(3 * WINDOWS) {
            let pixel = ((first + group) / 3).wrapping_sub(KEPT / 3);
            let left = columns.saturating_sub(pixel);
            if left >= WINDOWS {
                add_scores::<S, TAPS, WINDOWS>(simd, compared, &taps, centre, &means, group, &mut sums);
            } else {
                for p in 0..left {
                    add_scores::<S, TAPS, 1>(simd, compared, &taps, centre, &means, group + 3 * p, &mut sums);
                }
            }
        }
    }
    sums.iter().flat_map(|sums| sums.as_slice()).take(rows - top).sum()
}

/// Sums, from `centre`, and differences of 16 columns of samples, which are the lanes.
#[inline(always)]
fn take_samples<S: Simd>(
    simd: S,
    bytes: &[[[u8; STEP]; 2]; ROWS + OVERLAP],
    c: usize,
    centre: i32,
    samples: &mut [[f32x16<S>; ROWS + OVERLAP]; 2],
) {
    for (row, [a, b]) in bytes.iter().enumerate() {
        let (mut s, mut d) = ([0.0; LANES], [0.0; LANES]);
        for i in 0..LANES {
            let (a, b) = (i32::from(a[c + i]), i32::from(b[c + i]));
            (s[i], d[i]) = ((a + b - centre) as f32, (a - b) as f32);
        }
        (samples[0][row], samples[1][row]) = (f32x16::load_array(simd, s), f32x16::load_array(simd, d));
    }
}

/// Filters a function of samples along columns, and turns the result: rows become the lanes. What the function makes of a sample is not
/// kept in memory.
#[inline(always)]
fn filtered_columns<S: Simd, const TAPS: usize>(
    taps: &[f32x16<S>; TAPS],
    samples: &[f32x16<S>; ROWS + OVERLAP],
    function: impl Fn(f32x16<S>) -> f32x16<S>,
) -> [f32x16<S>; LANES] {
    let mut rows = [samples[0]; ROWS];
    for first in (0..ROWS).step_by(WINDOWS) {
        let mut block = [samples[0]; WINDOWS];
        filter::<S, TAPS, WINDOWS, 1>(taps, &samples[first..], &function, &mut block);
        rows[first..first + WINDOWS].copy_from_slice(&block);
    }
    transposed(rows)
}

/// Filters along rows, and adds the scores of the three channels of `N` neighbouring pixels.
#[inline(always)]
fn add_scores<S: Simd, const TAPS: usize, const N: usize>(
    simd: S,
    compared: &Compared<'_, TAPS>,
    taps: &[f32x16<S>; TAPS],
    centre: i32,
    means: &Moments<S, { KEPT + STEP }>,
    first: usize,
    sums: &mut [f64x8<S>; 2],
) {
    let zero = f32x16::splat(simd, 0.0);
    for channel in 0..3 {
        let mut whole: Moments<S, N> = [[zero; N]; 4];
        for (from, to) in means.iter().zip(&mut whole) {
            filter::<S, TAPS, N, 3>(taps, &from[first + channel..], |x| x, to);
        }
        let [s, d, ss, dd] = &whole;
        let mut sum = zero;
        for n in 0..N {
            let scale = compared.window.covariance_scale;
            sum += score(simd, [s[n], d[n], ss[n], dd[n]], centre as f32, scale);
        }
        let (low, high) = simd.widen_f32x16(sum);
        sums[0] += low;
        sums[1] += high;
    }
}

/// The score from the means of the moments.
#[inline(always)]
fn score<S: Simd>(simd: S, [s, d, ss, dd]: [f32x16<S>; 4], centre: f32, scale: f32) -> f32x16<S> {
    let splat = |x| f32x16::splat(simd, x);
    let (whole, d2) = (s + centre, d * d);
    let s2 = whole.mul_add_precise(whole, splat(TWICE_C1));
    // The variances, negative.
    let (vs, vd) = (s.mul_sub_precise(s, ss), d2 - dd);
    let covariance = (vd - vs).mul_add_precise(splat(scale), splat(TWICE_C2));
    let variance = (vd + vs).mul_add_precise(splat(-scale), splat(TWICE_C2));
    ((s2 - d2) * covariance) / ((s2 + d2) * variance)
}

/// About the mean of the pictures' sum over a band. Variances do not depend on what sums are taken from; from this they lose least to
/// rounding. That the rows are read as a whole here also spares waiting for memory when small parts of many are read; those above were read
/// for the band before.
#[inline(always)]
fn centre<const TAPS: usize>(compared: &Compared<'_, TAPS>, top: usize) -> i32 {
    let (mut sum, mut samples) = (0, 0);
    for row in top + 2 * (TAPS - 1)..top + ROWS + 2 * (TAPS - 1) {
        for picture in [compared.picture, compared.truth] {
            // The sum of so many bytes fits into 16 bits.
            for part in compared.row(picture, row).chunks(256) {
                sum += u64::from(part.iter().map(|&byte| u16::from(byte)).sum::<u16>());
            }
        }
        samples += 3 * compared.width as u64;
    }
    (sum / samples) as i32
}

/// Copies the samples of a row from the `first` on, counted from the first of the first window.
#[inline(always)]
fn copy_samples<const TAPS: usize>(
    compared: &Compared<'_, TAPS>,
    picture: &[u8],
    row: usize,
    first: usize,
    to: &mut [u8; STEP],
) {
    let row = compared.row(picture, row);
    let start = (first + 3 * compared.window.margin).checked_sub(3 * (TAPS - 1));
    if let Some(bytes) = start.and_then(|start| row.get(start..start + STEP)) {
        to.copy_from_slice(bytes);
        return;
    }
    for (p, pixel) in to.chunks_exact_mut(3).enumerate() {
        let x = compared.mirrored(first / 3 + p, compared.width);
        pixel.copy_from_slice(&row[3 * x..3 * x + 3]);
    }
}

/// The weighted means of a function of samples under `N` windows that begin one after another, where neighbours are `STRIDE` vectors
/// apart. What windows share is read once and stays in registers.
#[inline(always)]
fn filter<S: Simd, const TAPS: usize, const N: usize, const STRIDE: usize>(
    taps: &[f32x16<S>; TAPS],
    from: &[f32x16<S>],
    function: impl Fn(f32x16<S>) -> f32x16<S>,
    to: &mut [f32x16<S>; N],
) {
    let from = &from[..STRIDE * (N + 2 * TAPS - 3) + 1];
    let value = |i: usize| function(from[STRIDE * i]);
    for (n, to) in to.iter_mut().enumerate() {
        let middle = n + TAPS - 1;
        let mut sum = taps[0] * value(middle);
        for (k, &tap) in taps.iter().enumerate().skip(1) {
            sum = (value(middle - k) + value(middle + k)).mul_add_precise(tap, sum);
        }
        *to = sum;
    }
}

/// Turns rows into columns: each interleaving of the upper with the lower half moves the bits of all places, row then column, on by one.
#[inline(always)]
fn transposed<S: Simd>(mut rows: [f32x16<S>; LANES]) -> [f32x16<S>; LANES] {
    for _ in 0..LANES.ilog2() {
        let halves = rows;
        for i in 0..LANES / 2 {
            (rows[2 * i], rows[2 * i + 1]) = halves[i].interleave(halves[i + LANES / 2]);
        }
    }
    rows
}
