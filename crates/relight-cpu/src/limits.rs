//! What the machine can do at most, on all threads: the roofs that stages of a step are held against.
//!
//! Each kernel here does nothing but the one thing that it measures, as the engine's own kernels do it.

use std::hint::black_box;
use std::iter::repeat_n;
use std::sync::Barrier;
use std::time::{Duration, Instant};

use fearless_simd::{Level, Simd, dispatch, prelude::*};

use crate::huge_pages;
use crate::prefetch::ask;

/// Rates a second, on all threads.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Limits {
    /// Additions and multiplications of single-precision numbers, in registers.
    pub operations: f64,
    /// Bytes read and written one after another, in arrays larger than any cache.
    pub bytes: f64,
    /// Entries of a hash grid read in no order from one table; memory is asked ahead if that is faster, which it is for
    /// tables that no cache holds.
    pub lookups: f64,
    /// Entries added to in no order, in a table for each thread, likewise.
    pub updates: f64,
}

/// How long each rate is measured.
const TIME: Duration = Duration::from_millis(150);
/// Bytes of the arrays that are copied, for each thread.
const STREAM_BYTES: usize = 64 << 20;
/// Entries between two looks at the clock.
const CHUNK: usize = 1 << 16;

impl Limits {
    /// Measures this machine for a table of `read` entries and tables of `written` entries, both a power of two, of `F` numbers
    /// each.
    pub fn measure<const F: usize>(read: usize, written: usize) -> Self {
        let level = Level::new();
        let table = huge_pages::collect(repeat_n([1f32; F], read));
        Self {
            operations: on_all_threads(|_| 0.1, |x| multiply_adds(level, x, CHUNK)),
            bytes: on_all_threads(
                |_| (vec![1u64; STREAM_BYTES / 8], vec![0u64; STREAM_BYTES / 8]),
                |(from, to)| {
                    to.copy_from_slice(black_box(from));
                    black_box(to);
                    2 * STREAM_BYTES
                },
            ),
            lookups: lookups::<F, 64, true>(&table).max(lookups::<F, 8, false>(&table)),
            updates: updates::<F, 64, true>(written).max(updates::<F, 8, false>(written)),
        }
    }
}

/// Things a second that all threads together do with `work`, which does some and says how many, on the `memory` of each.
pub fn on_all_threads<T>(memory: impl Fn(u32) -> T + Sync, work: impl Fn(&mut T) -> usize + Sync) -> f64 {
    // They start together, or the first would have the machine for itself.
    let ready = Barrier::new(rayon::current_num_threads());
    let rates = rayon::broadcast(|thread| {
        let mut memory = memory(thread.index() as u32);
        work(&mut memory);
        ready.wait();
        let (started, mut done) = (Instant::now(), 0);
        while started.elapsed() < TIME {
            done += work(&mut memory);
        }
        done as f64 / started.elapsed().as_secs_f64()
    });
    rates.into_iter().sum()
}

/// Fused multiply-adds in registers, `rounds` rounds of independent ones; returns the operations.
fn multiply_adds(level: Level, x: &mut f32, rounds: usize) -> usize {
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

/// Lookups a second in a table, by `N` sequences side by side in each thread; memory is asked for their next entries while those
/// before are used if `ASK`.
fn lookups<const F: usize, const N: usize, const ASK: bool>(table: &[[f32; F]]) -> f64 {
    on_all_threads(jumps::<N>, |jumps| {
        black_box(gather::<F, N, ASK>(table, jumps, CHUNK));
        CHUNK
    })
}

/// Updates a second in tables of so many entries, likewise.
fn updates<const F: usize, const N: usize, const ASK: bool>(entries: usize) -> f64 {
    on_all_threads(
        |thread| (huge_pages::collect(repeat_n([1f32; F], entries)), jumps::<N>(thread)),
        |(table, jumps)| {
            scatter::<F, N, ASK>(black_box(table), jumps, CHUNK);
            CHUNK
        },
    )
}

/// Sequences that jump all over a table, side by side so that none waits for another.
type Jumps<const N: usize> = [u64; N];

/// Sequences of a thread's own.
fn jumps<const N: usize>(thread: u32) -> Jumps<N> {
    std::array::from_fn(|i| u64::from(thread) << 32 | (i as u64 + 1))
}

/// The next indices, in a table whose size is a power of two; memory is asked for them if `ASK`.
#[inline(always)]
fn jump<E, const N: usize, const ASK: bool>(jumps: &mut Jumps<N>, table: &[E]) -> [usize; N] {
    let mut indices = [0; N];
    for (state, index) in jumps.iter_mut().zip(&mut indices) {
        *state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        *index = (*state >> 33) as usize & (table.len() - 1);
        if ASK {
            ask(table, *index);
        }
    }
    indices
}

/// Sum of about `n` entries of a table whose size is a power of two, read in no order.
fn gather<const F: usize, const N: usize, const ASK: bool>(
    table: &[[f32; F]],
    jumps: &mut Jumps<N>,
    n: usize,
) -> [f32; F] {
    let (mut sums, mut next) = ([[0f32; F]; 8], jump::<_, N, ASK>(jumps, table));
    for _ in 0..n / N {
        let here = next;
        next = jump::<_, N, ASK>(jumps, table);
        for indices in here.chunks_exact(8) {
            for (&index, sum) in indices.iter().zip(&mut sums) {
                sum.iter_mut().zip(table[index]).for_each(|(sum, value)| *sum += value);
            }
        }
    }
    std::array::from_fn(|f| sums.iter().map(|sum| sum[f]).sum())
}

/// Adds to about `n` entries of a table whose size is a power of two, in no order.
fn scatter<const F: usize, const N: usize, const ASK: bool>(
    table: &mut [[f32; F]],
    jumps: &mut Jumps<N>,
    n: usize,
) {
    let mut next = jump::<_, N, ASK>(jumps, table);
    for _ in 0..n / N {
        let here = next;
        next = jump::<_, N, ASK>(jumps, table);
        for index in here {
            table[index].iter_mut().for_each(|value| *value += 0.25);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lookups_and_updates_reach_the_whole_table() {
        let mut table = vec![[0f32; 2]; 1 << 10];
        scatter::<2, 64, true>(&mut table, &mut jumps(0), 1 << 14);
        assert!(table.iter().all(|entry| entry[0] > 1.0));
        let total: f32 = table.iter().map(|entry| entry[1]).sum();
        assert_eq!(total, 0.25 * (1 << 14) as f32);
        let ones = vec![[1f32, 2.0]; 1 << 10];
        assert_eq!(gather::<2, 64, true>(&ones, &mut jumps(1), 640), [640.0, 1280.0]);
        assert_eq!(gather::<2, 8, false>(&ones, &mut jumps(1), 640), [640.0, 1280.0]);
        assert_ne!(jumps::<8>(0), jumps(1), "threads go ways of their own");
    }

    #[test]
    fn every_rate_is_measured() {
        let limits = Limits::measure::<4>(1 << 12, 1 << 10);
        for rate in [limits.operations, limits.bytes, limits.lookups, limits.updates] {
            assert!(rate.is_finite() && rate > 0.0, "{limits:?}");
        }
    }
}
