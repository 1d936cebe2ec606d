//! What photographs tell of probes: how dark shadows are, and how far what is imagined can be trusted.
//!
//! Some probes stand where a photograph was taken that their ray is not compared with. What would have been imagined
//! there is compared with what was seen.

/// What must have been seen before its mean says anything.
const ENOUGH: f32 = 8.0;
/// Share that a step leaves of what was seen before.
const MEMORY: f32 = 0.999;

/// A mean that forgets.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Fading {
    /// Sum, fading.
    pub sum: f32,
    /// Number, fading.
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

/// What photographs told of probes.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Experience {
    /// How bright shadows are beside the same place in the light.
    pub shadow: Fading,
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
    pub fn trust(self) -> f32 {
        match self.imagined.mean() {
            Some(imagined) if self.least > 0.0 => (self.least / imagined).min(1.0),
            _ => 0.0,
        }
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
