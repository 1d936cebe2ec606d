//! Means and deviations, and how they are printed.

use serde::Serialize;

/// A mean over seeds.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub(crate) struct Figure {
    /// The mean.
    pub mean: f64,
    /// Standard deviation of a sample (n - 1); `None` of a single value.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub deviation: Option<f64>,
}

impl Figure {
    /// Of one value a seed; `None` of none.
    pub fn of(values: &[f64]) -> Option<Self> {
        let n = values.len() as f64;
        let mean = values.iter().sum::<f64>() / n;
        match values {
            [] => None,
            [_] => Some(Self { mean, deviation: None }),
            _ => {
                let squares: f64 = values.iter().map(|v| (v - mean) * (v - mean)).sum();
                Some(Self { mean, deviation: Some((squares / (n - 1.0)).sqrt()) })
            }
        }
    }

    /// With `digits` behind the point: `25.79`, `25.79 ± 0.12`, or `∞`.
    pub fn told(&self, digits: usize) -> String {
        let number = |value: f64| match value {
            v if v.is_finite() => format!("{v:.digits$}"),
            v if v.is_nan() => "–".to_owned(),
            _ => "∞".to_owned(),
        };
        match self.deviation {
            Some(deviation) => format!("{} ± {}", number(self.mean), number(deviation)),
            None => number(self.mean),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn means_and_deviations_are_those_of_a_sample() {
        assert_eq!(Figure::of(&[]), None);
        assert_eq!(Figure::of(&[3.0]).unwrap().told(2), "3.00");
        // 2, 4, 4, 4, 5, 5, 7, 9: mean 5, squares sum to 32.
        let figure = Figure::of(&[2.0, 4.0, 4.0, 4.0, 5.0, 5.0, 7.0, 9.0]).unwrap();
        assert_eq!(figure.told(3), "5.000 ± 2.138");
        assert_eq!(Figure::of(&[f64::INFINITY]).unwrap().told(2), "∞");
        assert_eq!(Figure::of(&[f64::INFINITY, 1.0]).unwrap().told(2), "∞ ± –");
    }
}
