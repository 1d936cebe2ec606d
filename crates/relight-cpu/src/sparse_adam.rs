//! Adam on the entries of a hash level that samples touched (Kingma and Ba 2015; sparse as in tiny-cuda-nn).
//!
//! Entries are updated a line at a time: eight of them fill a vector register, and neighbours along x are neighbours in
//! memory, so that samples mostly touch several of a line. One bit tells whether a line was touched, which keeps a
//! level's bits in the first-level cache. Lines that nobody touched cost nothing.

use fearless_simd::{Level, Simd, dispatch};

use crate::adam::{self, BiasCorrection};

/// Entries of a line.
const LINE: usize = 8;
/// Numbers of a line: two features an entry.
const NUMBERS: usize = 2 * LINE;

/// One entry of the table: its two features.
pub type Entry = [f32; 2];

/// Gradient of one level, all zero between steps.
pub struct LevelGradient {
    values: Vec<[f32; NUMBERS]>,
    /// A bit for each line that may hold a gradient.
    touched: Vec<u64>,
}

impl LevelGradient {
    /// For levels of up to `entries` entries.
    pub fn new(entries: usize) -> Self {
        let lines = entries.div_ceil(LINE);
        Self { values: vec![[0.0; NUMBERS]; lines], touched: vec![0; lines.div_ceil(64)] }
    }

    /// To add to entries in any order.
    pub fn adder(&mut self) -> Adder<'_> {
        Adder { entries: self.values.as_flattened_mut().as_chunks_mut().0, touched: &mut self.touched }
    }
}

/// A gradient under way.
pub struct Adder<'a> {
    entries: &'a mut [Entry],
    touched: &'a mut [u64],
}

impl Adder<'_> {
    /// Adds `weight` times `g` to an entry.
    #[inline(always)]
    pub fn add(&mut self, index: usize, weight: f32, g: Entry) {
        let entry = &mut self.entries[index];
        entry[0] = g[0].mul_add(weight, entry[0]);
        entry[1] = g[1].mul_add(weight, entry[1]);
        let line = index / LINE;
        self.touched[line / 64] |= 1 << (line % 64);
    }
}

/// Adam's state of the entries of a line.
#[derive(Clone, Copy, Default)]
#[repr(align(32))]
struct LineMoments {
    m: [f32; NUMBERS],
    v: [f32; NUMBERS],
    updates: [u32; LINE],
}

/// Adam's state of a level.
#[derive(Default)]
pub struct LevelMoments {
    /// Empty until the first step: drawing needs none.
    lines: Vec<LineMoments>,
}

impl LevelMoments {
    /// Appends first and second moments and numbers of updates of `entries` entries.
    pub fn extend(&self, entries: usize, m: &mut Vec<f32>, v: &mut Vec<f32>, updates: &mut Vec<u32>) {
        if self.lines.is_empty() {
            m.resize(m.len() + 2 * entries, 0.0);
            v.resize(v.len() + 2 * entries, 0.0);
            updates.resize(updates.len() + entries, 0);
            return;
        }
        m.extend(self.lines.iter().flat_map(|l| l.m).take(2 * entries));
        v.extend(self.lines.iter().flat_map(|l| l.v).take(2 * entries));
        updates.extend(self.lines.iter().flat_map(|l| l.updates).take(entries));
    }

    /// The state with given moments `[entries, 2]` and numbers of updates `[entries]`.
    pub fn from_entries(m: &[f32], v: &[f32], updates: &[u32]) -> Self {
        let mut lines = vec![LineMoments::default(); updates.len().div_ceil(LINE)];
        let parts = m.chunks(NUMBERS).zip(v.chunks(NUMBERS)).zip(updates.chunks(LINE));
        for (line, ((m, v), updates)) in lines.iter_mut().zip(parts) {
            line.m[..m.len()].copy_from_slice(m);
            line.v[..v.len()].copy_from_slice(v);
            line.updates[..updates.len()].copy_from_slice(updates);
        }
        Self { lines }
    }

    /// One update of the entries of `table` whose gradient is not zero, in the order of their addresses; clears the
    /// gradient. All others keep their weights and moments.
    pub fn step(
        &mut self,
        simd: Level,
        gradient: &mut LevelGradient,
        table: &mut [Entry],
        rate: f32,
        correction: &BiasCorrection,
    ) {
        self.lines.resize(table.len().div_ceil(LINE), LineMoments::default());
        dispatch!(simd, simd => step_lines(simd, gradient, table, &mut self.lines, rate, correction));
    }
}

#[inline(always)]
fn step_lines<S: Simd>(
    simd: S,
    gradient: &mut LevelGradient,
    table: &mut [Entry],
    moments: &mut [LineMoments],
    rate: f32,
    correction: &BiasCorrection,
) {
    simd.vectorize(
        #[inline(always)]
        || {
            let (full, rest) = table.as_flattened_mut().as_chunks_mut::<NUMBERS>();
            for (word, touched) in gradient.touched.iter_mut().enumerate() {
                let mut bits = std::mem::take(touched);
                while bits != 0 {
                    let line = word * 64 + bits.trailing_zeros() as usize;
                    bits &= bits - 1;
                    let g = std::mem::take(&mut gradient.values[line]);
                    let state = &mut moments[line];
                    if let Some(weights) = full.get_mut(line) {
                        step_line(weights, &g, state, rate, correction);
                    } else {
                        // The last line of a level may be short.
                        let mut weights = [0.0; NUMBERS];
                        weights[..rest.len()].copy_from_slice(rest);
                        step_line(&mut weights, &g, state, rate, correction);
                        rest.copy_from_slice(&weights[..rest.len()]);
                    }
                }
            }
        },
    );
}

#[inline(always)]
fn step_line(
    weights: &mut [f32; NUMBERS],
    g: &[f32; NUMBERS],
    state: &mut LineMoments,
    rate: f32,
    correction: &BiasCorrection,
) {
    // Of untouched entries both corrections stay zero, which no other's are.
    let (mut c1, mut c2) = ([0.0; NUMBERS], [0.0; NUMBERS]);
    for (e, updates) in state.updates.iter_mut().enumerate() {
        if g[2 * e] != 0.0 || g[2 * e + 1] != 0.0 {
            *updates = updates.saturating_add(1);
            let (first, second) = correction.at(*updates);
            (c1[2 * e], c1[2 * e + 1]) = (first, first);
            (c2[2 * e], c2[2 * e + 1]) = (second, second);
        }
    }
    for i in 0..NUMBERS {
        let (mut w, mut m, mut v) = (weights[i], state.m[i], state.v[i]);
        adam::update(&mut w, &mut m, &mut v, g[i], rate, (c1[i], c2[i]));
        let touched = c1[i] > 0.0;
        weights[i] = if touched { w } else { weights[i] };
        state.m[i] = if touched { m } else { state.m[i] };
        state.v[i] = if touched { v } else { state.v[i] };
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dense::tests::levels;
    use relight_field::random::Random;

    /// Three lines, the last of them short.
    const ENTRIES: usize = 19;

    #[test]
    fn lines_are_updated_as_entries_are_one_by_one() {
        let (random, rate, correction) = (Random::new(2, 0), 0.01, BiasCorrection::default());
        for level in levels() {
            let mut table: Vec<Entry> =
                (0..ENTRIES as u64).map(|i| [2 * i, 2 * i + 1].map(|i| random.uniform_at(i) - 0.5)).collect();
            let mut plain = table.clone();
            let mut states = vec![([0f32; 2], [0f32; 2], 0u32); ENTRIES];
            let (mut gradient, mut moments) = (LevelGradient::new(ENTRIES), LevelMoments::default());
            for step in 0..4u64 {
                let mut sums = [[0f32; 2]; ENTRIES];
                // Entries of the first line and of the last; one twice, one with nothing.
                for (i, index) in [1, 6, 16, 18, 6].into_iter().enumerate().skip(step as usize % 2) {
                    let draw = 1000 + 20 * step + 3 * i as u64;
                    let g = [draw, draw + 1].map(|d| random.uniform_at(d) - 0.5);
                    gradient.adder().add(index, 0.5, g);
                    (sums[index][0], sums[index][1]) =
                        (g[0].mul_add(0.5, sums[index][0]), g[1].mul_add(0.5, sums[index][1]));
                }
                gradient.adder().add(3, 0.0, [1.0, 1.0]);
                moments.step(level, &mut gradient, &mut table, rate, &correction);
                for (i, g) in sums.iter().enumerate().filter(|(_, g)| **g != [0.0; 2]) {
                    let (m, v, updates) = &mut states[i];
                    *updates += 1;
                    for f in 0..2 {
                        let c = correction.at(*updates);
                        adam::update(&mut plain[i][f], &mut m[f], &mut v[f], g[f], rate, c);
                    }
                }
            }
            let (mut m, mut v, mut updates) = (Vec::new(), Vec::new(), Vec::new());
            moments.extend(ENTRIES, &mut m, &mut v, &mut updates);
            assert_eq!((m.len(), v.len()), (2 * ENTRIES, 2 * ENTRIES));
            for i in 0..ENTRIES {
                let (plain_m, plain_v, plain_updates) = states[i];
                assert_eq!(updates[i], plain_updates, "{level:?}, entry {i}");
                for f in 0..2 {
                    // Instruction sets may fuse products and sums.
                    let close = |a: f32, b: f32| (a - b).abs() <= 1e-6 * b.abs().max(1e-3);
                    assert!(close(m[2 * i + f], plain_m[f]) && close(v[2 * i + f], plain_v[f]));
                    assert!((table[i][f] - plain[i][f]).abs() < 1e-5, "{level:?}, entry {i}");
                    let untouched = plain_updates > 0 || table[i][f].to_bits() == plain[i][f].to_bits();
                    assert!(untouched, "{level:?}, entry {i}");
                }
            }
            // Nothing is left of the gradient.
            let before = table.clone();
            moments.step(level, &mut gradient, &mut table, rate, &correction);
            assert_eq!(before, table);
        }
    }

    #[test]
    fn moments_return_as_they_were() {
        let m: Vec<f32> = (0..2 * ENTRIES).map(|i| i as f32).collect();
        let v: Vec<f32> = m.iter().map(|m| m + 0.5).collect();
        let updates: Vec<u32> = (0..ENTRIES as u32).collect();
        let moments = LevelMoments::from_entries(&m, &v, &updates);
        let (mut m2, mut v2, mut updates2) = (vec![9.0], Vec::new(), Vec::new());
        moments.extend(ENTRIES, &mut m2, &mut v2, &mut updates2);
        assert_eq!((&m2[1..], v2, updates2), (&m[..], v, updates));
        let mut zeros = Vec::new();
        LevelMoments::default().extend(3, &mut zeros, &mut Vec::new(), &mut Vec::new());
        assert_eq!(zeros, [0.0; 6]);
    }
}
