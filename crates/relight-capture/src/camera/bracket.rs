//! One photograph from several exposures.

use super::{CameraError, Signals};

/// Variance of reading and rounding, levels squared: 3 electrons at 41 a level, and a twelfth.
const READ_VARIANCE: f64 = 0.09;
/// Variance of counting a level's electrons, levels squared: 10,500 electrons fill 255 levels.
const COUNT_VARIANCE: f64 = 255.0 / 10_500.0;

/// One exposure of a bracket.
#[derive(Clone, Debug)]
pub struct Exposure {
    /// Its time, as a multiple of the session's.
    pub multiple: f64,
    /// What it tells, corrected.
    pub signals: Signals,
}

/// Merges exposures of one scene to the signals that the session's own exposure would have given had the sensor no end.
///
/// A sensor is linear, so that each exposure `k` of multiple `m` estimates `v / m`, with variance `(r + c v) / m^2`; their mean
/// weighted by inverse variances, `sum(w v / m) / sum(w)` with `w = m^2 / (r + c m x)`, is the estimate of least variance, where
/// `x = sum(v) / sum(m)` is the pooled one, so that weights do not depend on a single exposure's noise (Granados et al.,
/// "Optimal HDR reconstruction with linear digital cameras", 2010). Full values are left out; where all are full the shortest
/// exposure stands as the lower limit that it is.
///
/// # Errors
/// If there is no exposure, or they are of several sizes.
pub fn merge(exposures: &[Exposure]) -> Result<Signals, CameraError> {
    let failed = |problem: &str| CameraError::Failed {
        problem: problem.to_owned(),
        mend: "Let no other program set the camera meanwhile.",
    };
    let shortest = exposures.iter().min_by(|a, b| a.multiple.total_cmp(&b.multiple));
    let shortest = shortest.ok_or_else(|| failed("a bracket needs an exposure"))?;
    let form = |e: &Exposure| {
        (e.signals.width, e.signals.height, e.signals.pattern, e.signals.data.len(), e.signals.full.len())
    };
    if exposures.iter().any(|exposure| form(exposure) != form(shortest)) {
        return Err(failed("its exposures are of several sizes or patterns"));
    }
    let merged = |at: usize| {
        let good = || exposures.iter().filter(|exposure| !exposure.signals.full[at]);
        let value = |exposure: &Exposure| f64::from(exposure.signals.data[at]);
        let times: f64 = good().map(|exposure| exposure.multiple).sum();
        if times == 0.0 {
            return value(shortest) / shortest.multiple;
        }
        let pooled = (good().map(value).sum::<f64>() / times).max(0.0);
        let (mut sum, mut weights) = (0.0, 0.0);
        for exposure in good() {
            let m = exposure.multiple;
            let weight = m * m / (READ_VARIANCE + COUNT_VARIANCE * m * pooled);
            sum += weight * value(exposure) / m;
            weights += weight;
        }
        sum / weights
    };
    let data = (0..shortest.signals.data.len()).map(|at| merged(at) as f32).collect();
    Ok(Signals { data, ..shortest.signals.clone() })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera::{BayerPattern, Development, Frame};
    use proptest::prelude::*;

    const WIDTH: u32 = 64;

    /// A row of pixels that see `light`, in levels at the session's exposure.
    fn shoot(light: &[f64], multiple: f64) -> Exposure {
        let data: Vec<u8> =
            light.iter().map(|light| (light * multiple).round().clamp(0.0, 255.0) as u8).collect();
        let frame = Frame::Raw { width: light.len() as u32, height: 1, pattern: BayerPattern::Rggb, data };
        Exposure { multiple, signals: frame.signals(&Development::default()).unwrap() }
    }

    /// Five decades of light come back, within rounding of the longest exposure that was not full.
    #[test]
    fn a_wide_range_of_light_comes_back() {
        let light: Vec<f64> = (0..WIDTH).map(|i| 0.05 * 10f64.powf(f64::from(i) / 15.0)).collect();
        let multiples = [1.0, 16.0, 1.0 / 16.0];
        let exposures = multiples.map(|multiple| shoot(&light, multiple));
        let merged = merge(&exposures).unwrap();
        for (found, light) in merged.data.iter().zip(&light) {
            let longest =
                multiples.iter().filter(|&&m| (light * m).round() < 250.0).fold(0.0, |a: f64, &b| a.max(b));
            if longest > 0.0 {
                assert!((f64::from(*found) - light).abs() < 0.75 / longest, "{found} for {light}");
            }
        }
    }

    #[test]
    fn what_is_full_everywhere_is_the_lower_limit_and_the_rest_is_the_single_exposure() {
        let exposures = [shoot(&[1e6, 100.0], 1.0), shoot(&[1e6, 100.0], 0.5)];
        let merged = merge(&exposures).unwrap();
        assert_eq!(merged.data, [510.0, 100.0]);
        assert_eq!(merge(&exposures[..1]).unwrap().data, [255.0, 100.0]);
        assert!(merge(&[]).is_err());
        let uneven = [exposures[0].clone(), shoot(&[1.0], 1.0)];
        assert!(merge(&uneven).unwrap_err().to_string().contains("several sizes"));
    }

    proptest! {
        /// Without noise and rounding, weights do not matter.
        #[test]
        fn exact_exposures_agree(light in 0.0f64..60.0, multiples in prop::collection::vec(0.01f64..4.0, 1..5)) {
            let exposures: Vec<Exposure> = multiples
                .iter()
                .map(|&multiple| {
                    let data = vec![(light * multiple) as f32];
                    Exposure { multiple, signals: Signals { width: 1, height: 1, pattern: None, data, full: vec![false] } }
                })
                .collect();
            let merged = merge(&exposures).unwrap();
            prop_assert!((f64::from(merged.data[0]) - light).abs() < 1e-4 * light.max(1e-3));
        }
    }
}
