//! What the machine can do at most, on all threads: the roofs that stages of a step are held against.
//!
//! Each kernel here does nothing but the one thing that it measures, as the engine's own kernels do it.

use std::hint::black_box;
use std::time::{Duration, Instant};

use fearless_simd::{Level, Simd, dispatch, prelude::*};
use rayon::prelude::*;

/// Rates a second, on all threads.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Limits {
    /// Additions and multiplications of single-precision numbers, in registers.
    pub operations: f64,
    /// Bytes read and written one after another, in arrays larger than any cache.
    pub bytes: f64,
    /// Entries of 8 bytes read in no order from one table.
    pub lookups: f64,
    /// Entries of 8 bytes added to in no order, in a table for each thread.
    pub updates: f64,
}

/// How long each rate is measured.
const TIME: Duration = Duration::from_millis(150);
/// Bytes of the arrays that are copied, for each thread.
const STREAM_BYTES: usize = 64 << 20;
/// Entries between two looks at the clock.
const CHUNK: usize = 1 << 16;

impl Limits {
    /// Measures this machine for a table of `read` entries and tables of `written` entries, both a power of two.
    pub fn measure(read: usize, written: usize) -> Self {
        let level = Level::new();
        let table = vec![[1f32; 2]; read];
        Self {
            operations: on_all_threads(|| 0.1, |x| multiply_adds(level, x, CHUNK)),
            bytes: on_all_threads(
                || (vec![1u64; STREAM_BYTES / 8], vec![0u64; STREAM_BYTES / 8]),
                |(from, to)| {
                    to.copy_from_slice(black_box(from));
                    2 * STREAM_BYTES
                },
            ),
            lookups: on_all_threads(
                || 1,
                |state| {
                    black_box(gather(&table, state, CHUNK));
                    CHUNK
                },
            ),
            updates: on_all_threads(
                || (vec![[1f32; 2]; written], 1),
                |(table, state)| {
                    scatter(black_box(table), state, CHUNK);
                    CHUNK
                },
            ),
        }
    }
}

/// Things a second that all threads together do with `work`, which does some and says how many, on its own `memory`.
fn on_all_threads<T>(memory: impl Fn() -> T + Sync, work: impl Fn(&mut T) -> usize + Sync) -> f64 {
    (0..rayon::current_num_threads())
        .into_par_iter()
        .with_max_len(1)
        .map(|_| {
            let mut memory = memory();
            work(&mut memory);
            let (started, mut done) = (Instant::now(), 0);
            while started.elapsed() < TIME {
                done += work(&mut memory);
            }
            done as f64 / started.elapsed().as_secs_f64()
        })
        .sum()
}

/// Fused multiply-adds in registers, about `rounds` rounds of independent ones; returns the operations.
pub fn multiply_adds(level: Level, x: &mut f32, rounds: usize) -> usize {
    dispatch!(level, simd => multiply_adds_simd(simd, x, rounds))
}

#[inline(always)]
fn multiply_adds_simd<S: Simd>(simd: S, x: &mut f32, rounds: usize) -> usize {
    /// Enough for two units of latency four, with spares.
    const INDEPENDENT: usize = 12;
    let mut sums = [S::f32s::splat(simd, *x); INDEPENDENT];
    let (a, b) = (S::f32s::splat(simd, black_box(0.999)), S::f32s::splat(simd, black_box(1e-3)));
    for _ in 0..rounds {
        for sum in &mut sums {
            *sum = sum.mul_add(a, b);
        }
    }
    *x = black_box(sums.iter().map(|sum| sum[0]).sum::<f32>() / INDEPENDENT as f32);
    2 * rounds * INDEPENDENT * S::f32s::LEN
}

/// The next index of a sequence that jumps all over a table of a power of two.
fn next(state: &mut u32) -> usize {
    *state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
    (*state >> 8) as usize
}

/// Sum of `n` entries of a table of a power of two, read in no order.
pub fn gather(table: &[[f32; 2]], state: &mut u32, n: usize) -> [f32; 2] {
    let mask = table.len() - 1;
    let mut sum = [0f32; 2];
    for _ in 0..n {
        let entry = table[next(state) & mask];
        sum[0] += entry[0];
        sum[1] += entry[1];
    }
    sum
}

/// Adds to `n` entries of a table of a power of two, in no order.
pub fn scatter(table: &mut [[f32; 2]], state: &mut u32, n: usize) {
    let mask = table.len() - 1;
    for _ in 0..n {
        let entry = &mut table[next(state) & mask];
        entry[0] += 0.5;
        entry[1] += 0.25;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lookups_and_updates_reach_the_whole_table() {
        let mut table = vec![[0f32; 2]; 1 << 10];
        scatter(&mut table, &mut 1, 1 << 14);
        assert!(table.iter().all(|entry| entry[0] > 0.0));
        let total: f32 = table.iter().map(|entry| entry[1]).sum();
        assert_eq!(total, 0.25 * (1 << 14) as f32);
        let ones = vec![[1f32, 2.0]; 1 << 10];
        assert_eq!(gather(&ones, &mut 1, 100), [100.0, 200.0]);
    }

    #[test]
    fn every_rate_is_measured() {
        let limits = Limits::measure(1 << 12, 1 << 10);
        for rate in [limits.operations, limits.bytes, limits.lookups, limits.updates] {
            assert!(rate.is_finite() && rate > 0.0, "{limits:?}");
        }
    }
}
