//! Russian roulette on the gradients of samples (Arvo and Kirk 1990, for photons).
//!
//! Most samples lie before or behind the surface and have next to no gradient, yet going back through the grid costs
//! each as much as one on the surface. So a sample is dropped with a chance that grows as its gradient shrinks, and
//! the gradients of those that stay are stretched to make up for it: on average over the draws the gradient stays the
//! same. (Adam's steps do not: an entry that only such samples reach is updated less often.)

/// Thins the gradients of a tile, `[features][columns]`, of which the first `used` columns are samples. One whose
/// gradient is shorter than `strength` times the tile's mean stays with a chance in proportion to its length;
/// `draw(column)` is a random number in 0..1. `lengths` is memory.
pub fn thin(
    gradients: &mut [f32],
    (columns, used): (usize, usize),
    strength: f32,
    draw: impl Fn(usize) -> f32,
    lengths: &mut Vec<f32>,
) {
    lengths.clear();
    lengths.resize(used, 0.0);
    for row in gradients.chunks_exact(columns) {
        lengths.iter_mut().zip(row).for_each(|(l, g)| *l += g * g);
    }
    lengths.iter_mut().for_each(|l| *l = l.sqrt());
    let certain = strength * lengths.iter().sum::<f32>() / used as f32;
    for (column, factor) in lengths.iter_mut().enumerate() {
        let stays = *factor / certain;
        // Where nothing has a gradient the chance is NaN, and there is nothing to stretch.
        *factor = if stays >= 1.0 {
            1.0
        } else if draw(column) < stays {
            1.0 / stays
        } else {
            0.0
        };
    }
    for row in gradients.chunks_exact_mut(columns) {
        row.iter_mut().zip(&*lengths).for_each(|(g, factor)| *g *= factor);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use relight_field::random::Random;

    /// Two features of five samples, from long to nothing, and a column that is no sample.
    const GRADIENTS: [f32; 12] = [3.0, -0.6, 0.1, 0.01, 0.0, 7.0, -4.0, 0.8, 0.1, 0.02, 0.0, 7.0];
    const COLUMNS: usize = 6;
    const USED: usize = 5;

    fn thinned(strength: f32, random: Random) -> [f32; 12] {
        let mut gradients = GRADIENTS;
        thin(&mut gradients, (COLUMNS, USED), strength, |c| random.uniform_at(c as u64), &mut Vec::new());
        gradients
    }

    #[test]
    fn the_mean_gradient_stays() {
        const DRAWS: u64 = 200_000;
        let mut sums = [0f64; 12];
        for draw in 0..DRAWS {
            let gradients = thinned(1.5, Random::new(4, draw));
            sums.iter_mut().zip(gradients).for_each(|(s, g)| *s += f64::from(g));
        }
        for (sum, expected) in sums.iter().zip(GRADIENTS) {
            let mean = sum / DRAWS as f64;
            assert!(
                (mean - f64::from(expected)).abs() < 0.02 * f64::from(expected.abs()) + 2e-3,
                "{mean} {expected}"
            );
        }
    }

    #[test]
    fn samples_go_whole_or_stay_stretched_alike() {
        let (mut gone, mut stretched) = (0, 0);
        for draw in 0..100 {
            let gradients = thinned(1.5, Random::new(4, draw));
            for c in 0..COLUMNS {
                let factors = [c, COLUMNS + c].map(|i| gradients[i] / GRADIENTS[i]);
                // The longest is sure to stay, and what is no sample is left alone.
                match c {
                    0 | 5 => assert_eq!(factors, [1.0; 2]),
                    4 => assert_eq!([gradients[c], gradients[COLUMNS + c]], [0.0; 2]),
                    _ => assert!((factors[0] - factors[1]).abs() <= 1e-3 * factors[0].abs(), "{factors:?}"),
                }
                gone += usize::from(c < 4 && factors[0] == 0.0);
                stretched += usize::from(factors[0] > 1.0);
            }
        }
        assert!(gone > 100 && stretched > 10, "{gone} {stretched}");
    }

    #[test]
    fn no_gradient_at_all_stays_none() {
        let mut gradients = [0f32; 12];
        thin(&mut gradients, (COLUMNS, USED), 1.5, |_| 0.0, &mut Vec::new());
        assert_eq!(gradients, [0.0; 12]);
    }
}
