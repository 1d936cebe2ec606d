//! Settings that change while a field is trained: functions of the progress of training, 0 at its first step and
//! 1 at its end.

use serde::{Deserialize, Serialize};

/// A number as a function of progress.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Schedule {
    /// The same all the time.
    Constant(f64),
    /// `from * (to / from)^progress`: falls by the same factor in equal times. Both ends must be positive.
    Exponential {
        /// Value at progress 0.
        from: f64,
        /// Value at progress 1.
        to: f64,
    },
    /// `from` until progress `start`, `to` after progress `end`, a straight line between them.
    Linear {
        /// Value up to `start`.
        from: f64,
        /// Value from `end` on.
        to: f64,
        /// Progress at which the line starts.
        start: f64,
        /// Progress at which the line ends; not before `start`.
        end: f64,
    },
}

impl Schedule {
    /// The value at `progress`, which is clamped to 0..1.
    pub fn at(&self, progress: f64) -> f64 {
        let progress = progress.clamp(0.0, 1.0);
        match *self {
            Self::Constant(value) => value,
            Self::Exponential { from, to } => from * (to / from).powf(progress),
            Self::Linear { from, to, start, end } => {
                if progress >= end {
                    to
                } else if progress <= start {
                    from
                } else {
                    from + (to - from) * (progress - start) / (end - start)
                }
            }
        }
    }

    /// Whether the value stays as it is from `progress` on.
    pub fn is_settled(&self, progress: f64) -> bool {
        match *self {
            Self::Constant(_) => true,
            Self::Exponential { .. } => progress >= 1.0,
            Self::Linear { end, .. } => progress >= end,
        }
    }

    /// Whether every value is finite and not negative, and the parts fit together.
    pub(crate) fn is_valid(&self) -> bool {
        let good = |v: f64| v.is_finite() && v >= 0.0;
        match *self {
            Self::Constant(value) => good(value),
            Self::Exponential { from, to } => good(from) && good(to) && from > 0.0 && to > 0.0,
            Self::Linear { from, to, start, end } => {
                good(from) && good(to) && good(start) && good(end) && start <= end
            }
        }
    }
}

/// How long to train. With neither limit, until validation stops improving; with both, until the first is reached.
///
/// Schedules stretch to fill the budget. A limit in minutes makes progress depend on the machine's speed, so two runs
/// with it differ; a limit in steps is reproducible to the bit.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Budget {
    /// Optimisation steps.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub steps: Option<u64>,
    /// Minutes of training, validation included.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub minutes: Option<f64>,
}

impl Budget {
    /// Whether training ends with validation rather than with a limit.
    pub fn is_open(&self) -> bool {
        self.steps.is_none() && self.minutes.is_none()
    }

    /// Whether `step` steps or `seconds` seconds are more than it allows.
    pub fn is_exceeded(&self, step: u64, seconds: f64) -> bool {
        self.steps.is_some_and(|all| step > all) || self.minutes.is_some_and(|all| seconds > 60.0 * all)
    }

    /// Progress after `step` steps and `seconds` seconds. An open budget progresses towards `horizon` steps.
    pub fn progress(&self, step: u64, seconds: f64, horizon: u64) -> f64 {
        let share = |done: f64, all: f64| if all > 0.0 { done / all } else { 1.0 };
        let by_steps = self.steps.map(|all| share(step as f64, all as f64));
        let by_time = self.minutes.map(|minutes| share(seconds, minutes * 60.0));
        match (by_steps, by_time) {
            (None, None) => share(step as f64, horizon as f64),
            (steps, time) => steps.unwrap_or(0.0).max(time.unwrap_or(0.0)),
        }
        .min(1.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn schedules_meet_their_ends_and_hold_outside() {
        let decay = Schedule::Exponential { from: 1e-2, to: 1e-3 };
        assert!((decay.at(0.0) - 1e-2).abs() < 1e-12);
        assert!((decay.at(0.5) - 1e-2 / 10f64.sqrt()).abs() < 1e-12);
        assert!((decay.at(7.0) - 1e-3).abs() < 1e-12);
        let ramp = Schedule::Linear { from: 1.0, to: 0.0, start: 0.2, end: 0.4 };
        assert_eq!(ramp.at(0.1), 1.0);
        assert!((ramp.at(0.3) - 0.5).abs() < 1e-12);
        assert_eq!(ramp.at(0.9), 0.0);
        let jump = Schedule::Linear { from: 1.0, to: 3.0, start: 0.5, end: 0.5 };
        assert_eq!((jump.at(0.49), jump.at(0.5)), (1.0, 3.0));
    }

    #[test]
    fn schedules_settle_where_they_stop_changing() {
        assert!(Schedule::Constant(1.0).is_settled(0.0));
        let decay = Schedule::Exponential { from: 1e-2, to: 1e-3 };
        assert!(!decay.is_settled(0.99) && decay.is_settled(1.0));
        let ramp = Schedule::Linear { from: 1.0, to: 0.0, start: 0.2, end: 0.4 };
        assert!(!ramp.is_settled(0.1) && ramp.is_settled(0.4));
    }

    #[test]
    fn impossible_schedules_are_found() {
        assert!(!Schedule::Constant(f64::NAN).is_valid());
        assert!(!Schedule::Exponential { from: 0.0, to: 1.0 }.is_valid());
        assert!(!Schedule::Linear { from: 0.0, to: 1.0, start: 0.5, end: 0.4 }.is_valid());
        assert!(Schedule::Linear { from: 0.0, to: 1.0, start: 0.4, end: 0.5 }.is_valid());
    }

    #[test]
    fn the_first_limit_decides_progress() {
        let both = Budget { steps: Some(100), minutes: Some(1.0) };
        assert_eq!(both.progress(50, 15.0, 1), 0.5);
        assert_eq!(both.progress(50, 45.0, 1), 0.75);
        assert_eq!(both.progress(500, 45.0, 1), 1.0);
        assert!(!both.is_exceeded(100, 60.0) && both.is_exceeded(101, 1.0) && both.is_exceeded(1, 61.0));
        assert!(!Budget::default().is_exceeded(u64::MAX, 1e9));
        assert_eq!(Budget::default().progress(50, 1e9, 200), 0.25);
        assert_eq!(Budget { steps: Some(0), minutes: None }.progress(0, 0.0, 9), 1.0);
    }
}
