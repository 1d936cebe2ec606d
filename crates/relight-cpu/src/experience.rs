//! What photographs tell of probes: what shadows leave of a colour, and how far what is imagined can be trusted.
//!
//! Some probes stand where a photograph was taken that their ray is not compared with. What would have been imagined
//! there is compared with what was seen.

use crate::shadow::Shadow;

/// What must have been seen before its mean says anything.
const ENOUGH: f32 = 8.0;
/// Share that a step leaves of what was seen before.
const MEMORY: f32 = 0.999;

/// A mean that forgets.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Fading {
    /// Sum, fading.
    pub sum: f32,
    /// Number, or sum of weights, fading.
    pub count: f32,
}

impl Fading {
    /// Takes in the sum and the number of what one step saw.
    pub fn observe(&mut self, seen: Seen) {
        self.sum = MEMORY * self.sum + seen.sum as f32;
        self.count = MEMORY * self.count + seen.count as f32;
    }

    /// The mean, if enough was seen.
    pub fn mean(self) -> Option<f32> {
        (self.count >= ENOUGH).then(|| self.sum / self.count)
    }
}

/// A sum over what a part of a step saw.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Seen {
    /// Sum.
    pub sum: f64,
    /// Number, or sum of weights.
    pub count: f64,
}

impl Seen {
    /// One more, of this weight.
    pub fn see(&mut self, value: f64, weight: f64) {
        self.sum += weight * value;
        self.count += weight;
    }

    /// All that another part saw.
    pub fn add(&mut self, other: Self) {
        self.sum += other.sum;
        self.count += other.count;
    }
}

/// What shadows of a class leave of a colour: the factor that, by least squares, takes colours in the light to photographs.
/// It forgets as [`Fading`] does.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Share {
    /// Sum of products of colours in the light and photographs, each as much as it is sure.
    pub products: f32,
    /// Sum of squares of colours in the light, likewise.
    pub squares: f32,
    /// Sum of how sure they were.
    pub count: f32,
}

impl Share {
    /// Takes in what another part of a step saw.
    fn add(&mut self, other: Self) {
        self.products += other.products;
        self.squares += other.squares;
        self.count += other.count;
    }

    /// Takes in what one step saw.
    fn observe(&mut self, seen: Self) {
        *self = Self {
            products: MEMORY * self.products + seen.products,
            squares: MEMORY * self.squares + seen.squares,
            count: MEMORY * self.count + seen.count,
        };
    }

    /// The factor, if enough was seen; nothing is brighter for a shadow.
    fn factor(self) -> Option<f32> {
        (self.count >= ENOUGH && self.squares > 0.0).then(|| (self.products / self.squares).min(1.0))
    }
}

/// What the photographs of a part of a step tell of probes.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Told {
    /// See [`Experience::shares`].
    pub shares: [Share; Shadow::CLASSES],
    /// See [`Experience::imagined`].
    pub imagined: Seen,
}

impl Told {
    /// A place that would have colour `lit` in the light, so sure, was photographed, and its shadow ray met `shadow`.
    pub fn see_light(&mut self, shadow: Shadow, (lit, certainty): ([f32; 3], f32), photographed: [f32; 3]) {
        let dot = |a: [f32; 3], b: [f32; 3]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f32>();
        let (products, squares) = (certainty * dot(photographed, lit), certainty * dot(lit, lit));
        self.shares[shadow.class()].add(Share { products, squares, count: certainty });
    }

    /// Whether all that it tells is a number.
    pub fn is_finite(&self) -> bool {
        let shares = self.shares.iter().map(|share| share.products + share.squares + share.count);
        self.imagined.sum.is_finite() && shares.sum::<f32>().is_finite()
    }

    /// All that another part told.
    pub fn add(&mut self, other: &Self) {
        self.shares.iter_mut().zip(other.shares).for_each(|(mine, other)| mine.add(other));
        self.imagined.add(other.imagined);
    }
}

/// What photographs told of probes.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Experience {
    /// What shadows of each [class](Shadow::class) leave.
    pub shares: [Share; Shadow::CLASSES],
    /// Mean square by which imagined colours miss photographs.
    pub imagined: Fading,
    /// Mean square by which the field misses photographs.
    pub field: Fading,
    /// Least mean of `field` so far; 0: not known.
    pub least: f32,
}

impl Experience {
    /// What an imagined colour counts beside a photograph, 0..1. Two measurements count inversely to their variance:
    /// the field's error at photographs stands in for that of photographs, since the field shows nothing finer. A rule
    /// of thumb: probes are known only where lights stood, and most stand elsewhere.
    pub fn trust(&self) -> f32 {
        match self.imagined.mean() {
            Some(imagined) if self.least > 0.0 => (self.least / imagined).min(1.0),
            _ => 0.0,
        }
    }

    /// What is left of a colour in the light where a shadow ray met this; `None` if nothing is known of the like.
    pub fn share(&self, shadow: Shadow) -> Option<f32> {
        let class = shadow.class();
        self.shares[class].factor().or((class == Shadow::NONE.class()).then_some(1.0))
    }

    /// Takes in what a step told.
    pub fn observe(&mut self, told: &Told) {
        self.shares.iter_mut().zip(told.shares).for_each(|(share, seen)| share.observe(seen));
        self.imagined.observe(told.imagined);
    }

    /// Takes in the mean square by which the field missed the photographs of a step.
    pub fn observe_field(&mut self, loss: f64) {
        self.field.observe(Seen { sum: loss, count: 1.0 });
        if let Some(mean) = self.field.mean() {
            self.least = if self.least > 0.0 { self.least.min(mean) } else { mean };
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn means_wait_and_forget() {
        let mut mean = Fading::default();
        mean.observe(Seen { sum: 2.0, count: 4.0 });
        assert_eq!(mean.mean(), None);
        mean.observe(Seen { sum: 2.1, count: 4.1 });
        assert!((mean.mean().unwrap() - 0.506).abs() < 1e-3);
        for _ in 0..5000 {
            mean.observe(Seen { sum: 0.25, count: 1.0 });
        }
        assert!((mean.mean().unwrap() - 0.25).abs() < 0.01);
    }

    #[test]
    fn shares_are_those_that_fit_photographs_best() {
        let lit = [0.8, 0.4, 0.2];
        let dim = Shadow { transmittance: 0.05, away: 30.0 };
        let (mut experience, mut told) = (Experience::default(), Told::default());
        assert_eq!((experience.share(Shadow::NONE), experience.share(dim)), (Some(1.0), None));
        // What would be black in the light tells nothing.
        (0..20).for_each(|_| told.see_light(dim, ([0.0; 3], 1.0), lit));
        experience.observe(&told);
        assert_eq!(experience.share(dim), None);
        (experience, told) = (Experience::default(), Told::default());
        // A dark one, and another that counts twice as much and is not there; all of a scene that is dark itself.
        let lit = lit.map(|c| 0.01 * c);
        for _ in 0..20 {
            told.see_light(dim, (lit, 0.5), lit.map(|c| 0.4 * c));
            told.see_light(dim, (lit, 1.0), lit);
            told.see_light(Shadow::NONE, (lit, 1.0), lit.map(|c| 0.9 * c));
        }
        let mut both = told;
        both.add(&told);
        experience.observe(&both);
        assert!((experience.share(dim).unwrap() - 0.8).abs() < 1e-5, "{experience:?}");
        assert!((experience.share(Shadow::NONE).unwrap() - 0.9).abs() < 1e-5);
        assert_eq!(experience.share(Shadow { away: 3.0, ..dim }), None, "of another class");
        (0..2000).for_each(|_| told.see_light(dim, (lit, 1.0), lit.map(|c| 3.0 * c)));
        experience.observe(&told);
        assert_eq!(experience.share(dim), Some(1.0), "no shadow makes anything brighter");
        assert!(told.is_finite());
        told.see_light(dim, (lit, 1.0), [f32::INFINITY; 3]);
        assert!(!told.is_finite());
    }

    #[test]
    fn imagined_colours_that_miss_photographs_are_trusted_less() {
        let mut experience = Experience::default();
        assert_eq!(experience.trust(), 0.0, "nothing is known yet");
        for _ in 0..20 {
            experience.imagined.observe(Seen { sum: 4.0, count: 100.0 });
            experience.observe_field(0.01);
        }
        assert!((experience.trust() - 0.25).abs() < 1e-3);
        // A field that gets worse, perhaps by what was imagined, makes that no more credible.
        for _ in 0..1000 {
            experience.observe_field(0.1);
        }
        assert!((experience.trust() - 0.25).abs() < 1e-3);
        for _ in 0..9000 {
            experience.imagined.observe(Seen { sum: 0.1, count: 100.0 });
        }
        assert_eq!(experience.trust(), 1.0, "never more than a photograph");
    }
}
