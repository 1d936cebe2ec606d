//! Random numbers by counter: the number at `(seed, stream, index)` is a pure function of the three.
//!
//! Nothing is carried from draw to draw, so results do not depend on the number of threads or on the order in which
//! they draw. The function is SplitMix64 (Steele, Lea and Flood 2014) with random access: output `i` is the
//! finaliser applied to `key + (i + 1) * gamma`, where the key is a hash of seed and stream.

/// Odd increment of SplitMix64: 2^64 over the golden ratio.
pub const GAMMA: u64 = 0x9E37_79B9_7F4A_7C15;

/// SplitMix64's finaliser: a bijection in which every input bit reaches every output bit.
pub const fn mix(mut z: u64) -> u64 {
    z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
    z ^ (z >> 31)
}

/// One stream of random numbers, indexed at will.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Random {
    key: u64,
}

impl Random {
    /// The stream numbered `stream` of `seed`. Give each purpose (and each training step) a stream of its own.
    pub const fn new(seed: u64, stream: u64) -> Self {
        Self { key: mix(mix(seed.wrapping_add(GAMMA)) ^ stream.wrapping_mul(GAMMA)) }
    }

    /// SplitMix64 itself, from the state `state`.
    pub const fn from_state(state: u64) -> Self {
        Self { key: state }
    }

    /// The stream without its first `n` numbers.
    pub const fn after(self, n: u64) -> Self {
        Self { key: self.key.wrapping_add(n.wrapping_mul(GAMMA)) }
    }

    /// Number `index` of the stream, uniform over all 64-bit numbers.
    pub const fn u64_at(self, index: u64) -> u64 {
        mix(self.key.wrapping_add(index.wrapping_add(1).wrapping_mul(GAMMA)))
    }

    /// Number `index` of the stream, uniform over all 32-bit numbers.
    pub const fn u32_at(self, index: u64) -> u32 {
        (self.u64_at(index) >> 32) as u32
    }

    /// Number `index` of the stream, uniform in [0, 1): a multiple of 2^-24.
    pub const fn uniform_at(self, index: u64) -> f32 {
        (self.u32_at(index) >> 8) as f32 * (1.0 / 16_777_216.0)
    }

    /// Number `index` of the stream, uniform over the integers below `n`; 0 where `n` is 0. The bias is below
    /// `n / 2^32`.
    pub const fn below_at(self, index: u64, n: u32) -> u32 {
        ((self.u32_at(index) as u64 * n as u64) >> 32) as u32
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn finaliser_is_that_of_splitmix64() {
        // First outputs of SplitMix64 with state 0 (Vigna's reference program).
        let stream = Random::from_state(0);
        assert_eq!(stream.u64_at(0), 0xE220_A839_7B1D_CDAF);
        assert_eq!(stream.u64_at(1), 0x6E78_9E6A_A1B9_65F4);
        assert_eq!(stream.u64_at(2), 0x06C4_5D18_8009_454F);
    }

    #[test]
    fn streams_go_on_from_any_number() {
        let stream = Random::new(7, 3);
        for (n, index) in [(0, 4), (1, 0), (1 << 40, 1000)] {
            assert_eq!(stream.after(n).u64_at(index), stream.u64_at(n + index));
        }
    }

    #[test]
    fn uniform_numbers_fill_the_unit_interval_evenly() {
        let random = Random::new(7, 3);
        let mut bins = [0usize; 16];
        for i in 0..160_000 {
            let u = random.uniform_at(i);
            assert!((0.0..1.0).contains(&u));
            bins[(u * 16.0) as usize] += 1;
        }
        // Standard deviation of a bin is 97: five of them.
        assert!(bins.iter().all(|&n| n.abs_diff(10_000) < 500), "{bins:?}");
    }

    #[test]
    fn integers_stay_below_n_and_take_every_value() {
        let random = Random::new(1, 2);
        let mut seen = [false; 7];
        for i in 0..200 {
            seen[random.below_at(i, 7) as usize] = true;
        }
        assert_eq!(seen, [true; 7]);
        assert_eq!(random.below_at(0, 0), 0);
        assert_eq!(random.below_at(5, 1), 0);
    }

    #[test]
    fn neighbouring_seeds_streams_and_indices_do_not_correlate() {
        let pairs: [(Random, Random, u64); 3] = [
            (Random::new(0, 0), Random::new(1, 0), 0),
            (Random::new(0, 0), Random::new(0, 1), 0),
            (Random::new(0, 0), Random::new(0, 0), 1),
        ];
        for (a, b, shift) in pairs {
            let n = 100_000;
            let sum: f64 = (0..n)
                .map(|i| (f64::from(a.uniform_at(i)) - 0.5) * (f64::from(b.uniform_at(i + shift)) - 0.5))
                .sum();
            // Correlation; its standard deviation is 1 / sqrt(n) = 0.0032.
            assert!((12.0 * sum / n as f64).abs() < 0.016);
        }
    }
}
