//! The speed profile of a joint motion.

/// A trapezoidal speed profile over a distance: speed up evenly, go on, slow down evenly; a triangle where the distance
/// is too short for full speed. Distances in radians of the joint that goes farthest; the others go in proportion.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Trapezoid {
    /// Seconds of speeding up, and of slowing down.
    ramp: f64,
    duration: f64,
}

impl Trapezoid {
    /// The profile over `distance` (rad, not negative) with at most `speed` (rad/s) and `acceleration` (rad/s^2), both
    /// positive.
    pub fn new(distance: f64, speed: f64, acceleration: f64) -> Self {
        let peak = speed.min((distance * acceleration).sqrt());
        if peak <= 0.0 {
            return Self { ramp: 0.0, duration: 0.0 };
        }
        Self { ramp: peak / acceleration, duration: distance / peak + peak / acceleration }
    }

    /// Seconds from rest to rest.
    pub fn duration(&self) -> f64 {
        self.duration
    }

    /// The part of the way that is behind after `seconds`, 0 to 1, and its rate per second.
    pub fn at(&self, seconds: f64) -> (f64, f64) {
        if seconds <= 0.0 && self.duration > 0.0 {
            return (0.0, 0.0);
        }
        if seconds >= self.duration {
            return (1.0, 0.0);
        }
        let peak = 1.0 / (self.duration - self.ramp);
        let left = self.duration - seconds;
        if seconds < self.ramp {
            (0.5 * peak * seconds * seconds / self.ramp, peak * seconds / self.ramp)
        } else if left < self.ramp {
            (1.0 - 0.5 * peak * left * left / self.ramp, peak * left / self.ramp)
        } else {
            (peak * (seconds - 0.5 * self.ramp), peak)
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn durations_are_those_of_the_closed_form() {
        // 2 rad at 1 rad/s and 2 rad/s^2: half a second of ramp, 1.5 s at full speed, half a second of ramp.
        assert!((Trapezoid::new(2.0, 1.0, 2.0).duration() - 2.5).abs() < 1e-12);
        // Too short for full speed: 2 sqrt(d / a).
        assert!((Trapezoid::new(0.02, 1.0, 2.0).duration() - 0.2).abs() < 1e-12);
        assert_eq!(Trapezoid::new(0.0, 1.0, 2.0).duration(), 0.0);
    }

    #[test]
    fn the_rate_is_the_derivative_and_never_above_the_limits() {
        for distance in [0.02, 0.5, 3.0] {
            let (profile, step) = (Trapezoid::new(distance, 1.0, 2.0), 1e-5);
            let n = (profile.duration() / step) as usize;
            let mut before = (0.0, 0.0);
            for i in 1..=n {
                let (part, rate) = profile.at(i as f64 * step);
                assert!(part >= before.0 && rate * distance <= 1.0 + 1e-9);
                assert!((rate - before.1).abs() * distance <= 2.0 * step * (1.0 + 1e-6));
                assert!(((part - before.0) / step - 0.5 * (rate + before.1)).abs() < 1e-6);
                before = (part, rate);
            }
            assert!((before.0 - 1.0).abs() < 1e-6);
        }
    }
}
