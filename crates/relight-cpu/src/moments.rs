//! The optimiser of a network: the moments of its weights, and what follows them, Adam for all of them or SOAP for each layer.

use fearless_simd::{Level, Simd, dispatch};

use crate::adam::{Adam, UPDATE_OPERATIONS};
use crate::soap::Soap;

/// Moments of a network's weights.
#[derive(Default)]
pub struct Moments {
    /// First moments.
    pub m: Vec<f32>,
    /// Second moments.
    pub v: Vec<f32>,
    /// Updates so far.
    pub updates: u32,
    /// The bases of every layer, in which its moments are then; none under plain Adam.
    pub bases: Vec<Soap>,
}

impl Moments {
    /// Zero moments of `n` weights.
    pub fn new(n: usize, bases: Vec<Soap>) -> Self {
        Self { m: vec![0.0; n], v: vec![0.0; n], updates: 0, bases }
    }

    /// Operations of an update.
    pub fn operations(&self) -> usize {
        UPDATE_OPERATIONS * self.m.len() + self.bases.iter().map(Soap::operations).sum::<usize>()
    }

    /// One update of all weights, which lie in one array after another; `gradient` is that of all of them.
    pub fn step<'a>(
        &mut self,
        simd: Level,
        weights: impl Iterator<Item = &'a mut [f32]>,
        mut gradient: &[f32],
        rate: f32,
        adam: &Adam,
    ) {
        self.updates = self.updates.saturating_add(1);
        let c = adam.corrections(self.updates);
        let (mut m, mut v) = (&mut self.m[..], &mut self.v[..]);
        for (layer, weights) in (0..).zip(weights) {
            let (g, rest_g) = gradient.split_at(weights.len());
            let (here_m, rest_m) = m.split_at_mut(weights.len());
            let (here_v, rest_v) = v.split_at_mut(weights.len());
            (gradient, m, v) = (rest_g, rest_m, rest_v);
            if let Some(soap) = self.bases.get_mut(layer) {
                let at = (layer as u32, self.updates);
                soap.step(simd, weights, g, [here_m, here_v], at, rate, adam);
                continue;
            }
            dispatch!(simd, simd => simd.vectorize(
                #[inline(always)]
                || {
                    let moments = here_m.iter_mut().zip(here_v);
                    for ((w, &g), (m, v)) in weights.iter_mut().zip(g).zip(moments) {
                        adam.update(w, [m, v], g, rate, c);
                    }
                },
            ));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use relight_field::optimiser::{EARLY, PERIOD};
    use relight_field::random::Random;

    #[test]
    fn moments_step_like_plain_adam() {
        for beta2 in [0.99, 0.999] {
            moments_step_with(beta2);
        }
    }

    fn moments_step_with(beta2: f64) {
        const WEIGHTS: usize = 75;
        let (random, rate, adam) = (Random::new(1, 0), 0.01, Adam::new(beta2));
        let mut weights: Vec<f32> = (0..WEIGHTS as u64).map(|i| random.uniform_at(i) - 0.5).collect();
        let mut moments = Moments::new(WEIGHTS, Vec::new());
        let mut plain: Vec<[f64; 3]> = weights.iter().map(|&w| [f64::from(w), 0.0, 0.0]).collect();
        for step in 1..=30 {
            // Magnitudes from 1e-9 to 1e3: Adam's step depends on none of them.
            let gradient: Vec<f32> = (0..WEIGHTS)
                .map(|i| {
                    (random.uniform_at((100 * step + i) as u64) - 0.4) * 10f32.powi(2 * (i % 7) as i32 - 9)
                })
                .collect();
            moments.step(Level::new(), weights.chunks_mut(40), &gradient, rate, &adam);
            for ([w, m, v], &g) in plain.iter_mut().zip(&gradient) {
                let g = f64::from(g);
                *m = 0.9 * *m + 0.1 * g;
                *v = beta2 * *v + (1.0 - beta2) * g * g;
                let (m, v) = (*m / (1.0 - 0.9f64.powi(step as i32)), *v / (1.0 - beta2.powi(step as i32)));
                *w -= f64::from(rate) * m / (v.sqrt() + 1e-15);
            }
        }
        assert_eq!(moments.updates, 30);
        for (ours, [plain, ..]) in weights.iter().zip(&plain) {
            assert!((f64::from(*ours) - plain).abs() < 1e-5, "{ours} {plain}");
        }
    }

    #[test]
    fn layers_take_turns_to_renew_their_bases() {
        const SIDE: usize = 6;
        let (adam, layers) = (Adam::new(0.999), 3);
        let mut moments =
            Moments::new(layers * SIDE * SIDE, (0..layers).map(|_| Soap::new(SIDE, SIDE)).collect());
        let mut weights = vec![0.0; layers * SIDE * SIDE];
        let mut renewed = Vec::new();
        for count in 1..=PERIOD {
            let random = Random::new(2, u64::from(count));
            let gradient: Vec<f32> = (0..weights.len() as u64).map(|i| random.uniform_at(i) - 0.4).collect();
            let bases = |moments: &Moments| -> Vec<Vec<f32>> {
                moments.bases.iter().map(|soap| soap.arrays()[1].clone()).collect()
            };
            let before = bases(&moments);
            moments.step(Level::new(), weights.chunks_mut(SIDE * SIDE), &gradient, 0.01, &adam);
            let after = bases(&moments);
            let changed = (0..layers).filter(|&layer| before[layer] != after[layer]);
            renewed.extend(changed.map(|layer| (count, layer)));
        }
        let early = (1..=EARLY).flat_map(|count| (0..layers).map(move |layer| (count, layer)));
        let turns = (0..layers).rev().map(|layer| (PERIOD - layer as u32, layer));
        assert_eq!(renewed, early.chain(turns).collect::<Vec<_>>());
    }
}
