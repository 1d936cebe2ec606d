//! What the sensor adds and the lens takes away: dark frames, flat frames, hot and dead pixels.

use super::development::FULL_LEVEL;
use super::{BayerPattern, CameraError, Development, Frame, Signals};

/// A pixel whose dark level lies above the median by more than this is hot, levels.
const HOT: f32 = 8.0;
/// ... and by more than this many robust standard deviations.
const HOT_DEVIATIONS: f32 = 8.0;
/// A pixel that sees less than this share of what its colour's mean sees is dead, or behind dirt.
const DEAD: f32 = 0.2;
/// Flat frames are to lie between these mean levels: noise is small then, and nothing is full.
const FLAT_LEVELS: [f32; 2] = [40.0, 235.0];

/// The mean of several raw frames of one thing, in the sensor's levels, black level included.
#[derive(Clone, Debug, PartialEq)]
pub struct Average {
    /// Pixels a row.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// Which filters lie where.
    pub pattern: BayerPattern,
    /// Row-major from the top left, 0 to 255.
    pub data: Vec<f32>,
}

impl Average {
    /// The mean of frames.
    ///
    /// # Errors
    /// If there is none, one is developed, they are of several sizes or patterns, or one is incomplete.
    pub fn of(frames: &[Frame]) -> Result<Average, CameraError> {
        let mut sum: Option<Average> = None;
        for frame in frames {
            frame.signals(&Development::default())?;
            let Frame::Raw { width, height, pattern, data } = frame else {
                return Err(CameraError::Failed {
                    problem: "it develops its frames itself, and dark and flat frames correct raw ones"
                        .to_owned(),
                    mend: "Let it deliver raw frames, or ask for no dark and flat frames.",
                });
            };
            let (width, height, pattern) = (*width, *height, *pattern);
            let sum =
                sum.get_or_insert_with(|| Average { width, height, pattern, data: vec![0.0; data.len()] });
            if (sum.width, sum.height, sum.pattern) != (width, height, pattern) {
                return Err(CameraError::Failed {
                    problem: "its frames are of several sizes or patterns".to_owned(),
                    mend: "Let no other program set the camera meanwhile.",
                });
            }
            // Sums of 8-bit numbers are exact in f32 for 65,000 frames.
            sum.data.iter_mut().zip(data).for_each(|(sum, &level)| *sum += f32::from(level));
        }
        let mut mean = sum.ok_or_else(|| CameraError::Failed {
            problem: "no frame was shot".to_owned(),
            mend: "Average one frame at least.",
        })?;
        mean.data.iter_mut().for_each(|sum| *sum /= frames.len() as f32);
        Ok(mean)
    }

    fn describe(&self) -> String {
        format!("{}x{} pixels of pattern {:?}", self.width, self.height, self.pattern)
    }
}

/// Takes from raw signals what is the camera's and not the scene's.
#[derive(Clone, Debug, PartialEq)]
pub struct Correction {
    width: u32,
    height: u32,
    pattern: BayerPattern,
    /// Levels above black without light, at the session's exposure.
    dark: Option<Vec<f32>>,
    /// Factors that make an even target even.
    gains: Option<Vec<f32>>,
    /// Pixels that say nothing, and the pixels of their colour around them whose mean takes their place.
    bad: Vec<(usize, Vec<usize>)>,
}

impl Correction {
    /// The correction that dark and flat frames ask for; none without either. A flat frame is corrected by the dark one first.
    ///
    /// # Errors
    /// If the two differ in size or pattern, or the flat frame is too dark or full.
    pub fn new(
        dark: Option<&Average>,
        flat: Option<&Average>,
        development: &Development,
    ) -> Result<Option<Correction>, CameraError> {
        let Some(first) = dark.or(flat) else { return Ok(None) };
        if let Some(flat) = flat
            && flat.describe() != first.describe()
        {
            return Err(CameraError::Failed {
                problem: format!(
                    "the flat frame is of {}, the dark frame of {}",
                    flat.describe(),
                    first.describe()
                ),
                mend: "Shoot both again with the camera as it is set now.",
            });
        }
        let Average { width, height, pattern, .. } = *first;
        let above = |average: &Average| -> Vec<f32> {
            average.data.iter().map(|level| level - development.black_level).collect()
        };
        let dark = dark.map(above);
        let mut is_bad = vec![false; first.data.len()];
        if let Some(dark) = &dark {
            let (middle, deviation) = spread(dark);
            let limit = middle + HOT.max(HOT_DEVIATIONS * deviation);
            is_bad.iter_mut().zip(dark).for_each(|(bad, &level)| *bad = level > limit);
        }
        let gains = match flat {
            None => None,
            Some(flat) => {
                let mut seen = above(flat);
                if let Some(dark) = &dark {
                    seen.iter_mut().zip(dark).for_each(|(seen, dark)| *seen -= dark);
                }
                Some(gains(flat, &seen, &mut is_bad)?)
            }
        };
        let bad =
            (0..is_bad.len()).filter(|&at| is_bad[at]).map(|at| (at, around(at, width, height, &is_bad)));
        Ok(Some(Correction { width, height, pattern, bad: bad.collect(), dark, gains }))
    }

    /// How many pixels are hot or dead.
    pub fn bad_pixels(&self) -> usize {
        self.bad.len()
    }

    /// Corrects signals that were exposed for a multiple of the session's time: what the sensor gathers in the dark grows
    /// with time.
    ///
    /// # Errors
    /// If the signals are of another size or pattern than the dark and flat frames.
    pub fn apply(&self, signals: &mut Signals, multiple: f64) -> Result<(), CameraError> {
        if (signals.width, signals.height, signals.pattern) != (self.width, self.height, Some(self.pattern)) {
            return Err(CameraError::Failed {
                problem: format!(
                    "a frame of {}x{} pixels ({}) came, and dark and flat frames are of {}x{} ({:?})",
                    signals.width,
                    signals.height,
                    signals.pattern.map_or("developed".to_owned(), |pattern| format!("{pattern:?}")),
                    self.width,
                    self.height,
                    self.pattern
                ),
                mend: "Set the camera as it was, or begin anew with dark and flat frames of its new setting.",
            });
        }
        if let Some(dark) = &self.dark {
            let grown = multiple as f32;
            signals.data.iter_mut().zip(dark).for_each(|(value, dark)| *value -= grown * dark);
        }
        if let Some(gains) = &self.gains {
            signals.data.iter_mut().zip(gains).for_each(|(value, gain)| *value *= gain);
        }
        for (at, around) in &self.bad {
            let sum: f32 = around.iter().map(|&near| signals.data[near]).sum();
            signals.data[*at] = sum / around.len().max(1) as f32;
            signals.full[*at] = around.iter().any(|&near| signals.full[near]);
        }
        Ok(())
    }
}

/// Median, and robust standard deviation (1.4826 median absolute deviations).
fn spread(values: &[f32]) -> (f32, f32) {
    let median = |mut values: Vec<f32>| {
        let middle = values.len() / 2;
        if values.is_empty() { 0.0 } else { *values.select_nth_unstable_by(middle, f32::total_cmp).1 }
    };
    let middle = median(values.to_vec());
    (middle, 1.4826 * median(values.iter().map(|value| (value - middle).abs()).collect()))
}

/// Factors that make each colour of an even target even, each about its own mean so that white balance stays as it is.
fn gains(flat: &Average, seen: &[f32], is_bad: &mut [bool]) -> Result<Vec<f32>, CameraError> {
    let [low, high] = FLAT_LEVELS;
    let width = flat.width as usize;
    let plane = |at: usize| 2 * (at / width % 2) + at % width % 2;
    let means = |is_bad: &[bool]| -> [f32; 4] {
        let (mut sums, mut counts) = ([0.0f64; 4], [0usize; 4]);
        for (at, &value) in seen.iter().enumerate() {
            if !is_bad[at] {
                sums[plane(at)] += f64::from(value);
                counts[plane(at)] += 1;
            }
        }
        std::array::from_fn(|p| (sums[p] / counts[p].max(1) as f64) as f32)
    };
    let first = means(is_bad);
    for (at, &value) in seen.iter().enumerate() {
        is_bad[at] |= value < DEAD * first[plane(at)];
    }
    // Dead pixels have no part in the mean that the others are brought to.
    let means = means(is_bad);
    let full = flat.data.iter().filter(|&&level| level >= f32::from(FULL_LEVEL)).count();
    let brightest = means.iter().copied().fold(0.0, f32::max);
    if brightest < low || brightest > high || 1000 * full > flat.data.len() {
        return Err(CameraError::Failed {
            problem: format!(
                "the flat frame's mean level is {brightest:.0}, and {full} of its pixels are full"
            ),
            mend: "Show it an evenly lit, matt white target at a level of 40 to 235 without full pixels.",
        });
    }
    let factors = seen.iter().enumerate();
    Ok(factors.map(|(at, &value)| if is_bad[at] { 1.0 } else { means[plane(at)] / value }).collect())
}

/// The nearest good pixels of the colour of `at`, a period of the mosaic away; further rings if there are none.
fn around(at: usize, width: u32, height: u32, is_bad: &[bool]) -> Vec<usize> {
    let (w, h) = (width as isize, height as isize);
    let (x, y) = (at as isize % w, at as isize / w);
    for ring in [2, 4, 6] {
        let steps = [-ring, 0, ring];
        let near = steps.iter().flat_map(|dy| steps.iter().map(move |dx| (x + dx, y + dy)));
        let near = near.filter(|&(x, y)| (0..w).contains(&x) && (0..h).contains(&y));
        let good: Vec<usize> =
            near.map(|(x, y)| (y * w + x) as usize).filter(|&near| !is_bad[near]).collect();
        if !good.is_empty() {
            return good;
        }
    }
    Vec::new()
}

#[cfg(test)]
mod tests {
    use super::*;

    const SIZE: (u32, u32) = (16, 12);
    const BLACK: f32 = 10.0;

    fn raw(level: impl Fn(usize, usize) -> f32) -> Frame {
        let (width, height) = SIZE;
        let places = (0..height as usize).flat_map(|y| (0..width as usize).map(move |x| (x, y)));
        let data = places.map(|(x, y)| level(x, y).round() as u8).collect();
        Frame::Raw { width, height, pattern: BayerPattern::Rggb, data }
    }

    /// Dark current that differs from pixel to pixel, levels.
    fn dark(x: usize, y: usize) -> f32 {
        ((3 * x + 5 * y) % 4) as f32
    }

    /// A lens that darkens towards one side, in steps that 8 bits can hold: 1, 1/2 or 1/4.
    fn shade(x: usize) -> f32 {
        [1.0, 1.0, 0.5, 0.5, 0.5, 0.5, 0.25, 0.25][x / 2 % 8]
    }

    fn development() -> Development {
        Development { black_level: BLACK, ..Development::default() }
    }

    fn correction() -> Correction {
        let dark_frame = raw(|x, y| if (x, y) == (5, 5) { 90.0 } else { BLACK + dark(x, y) });
        // One dead pixel.
        let flat = raw(|x, y| {
            if (x, y) == (8, 3) {
                BLACK
            } else {
                BLACK + dark(x, y) + 160.0 * shade(x) + 40.0 * (x % 2) as f32 * shade(x)
            }
        });
        let dark = Average::of(&[dark_frame.clone(), dark_frame]).unwrap();
        let flat = Average::of(&[flat]).unwrap();
        Correction::new(Some(&dark), Some(&flat), &development()).unwrap().unwrap()
    }

    /// An even grey under this sensor and lens comes out even, hot and dead pixels too, at any exposure.
    #[test]
    fn an_even_target_becomes_even() {
        let correction = correction();
        assert_eq!(correction.bad_pixels(), 2);
        for multiple in [1.0, 2.0] {
            let frame = raw(|x, y| {
                BLACK
                    + multiple * dark(x, y)
                    + multiple * 80.0 * shade(x)
                    + if (x, y) == (5, 5) { 100.0 } else { 0.0 }
            });
            let mut signals = frame.signals(&development()).unwrap();
            correction.apply(&mut signals, f64::from(multiple)).unwrap();
            let first = signals.data[0];
            assert!(first > 30.0);
            // Each colour to rounding; the colours' means differ a little for their bad pixels in so small a picture.
            for (at, value) in signals.data.iter().enumerate() {
                let fellow = signals.data[16 * (at / 16 % 2) + at % 2];
                assert!((value - fellow).abs() < 1e-3 && (value / first - 1.0).abs() < 0.01, "{at}: {value}");
            }
        }
    }

    #[test]
    fn averages_are_means() {
        let frames = [10.0, 11.0, 15.0].map(|level| raw(|x, _| level + x as f32));
        let average = Average::of(&frames).unwrap();
        assert_eq!(average.data[3], 15.0);
        assert_eq!(Correction::new(None, None, &development()).unwrap(), None);
    }

    #[test]
    fn what_does_not_fit_is_refused() {
        let average = |level: f32| Average::of(&[raw(|_, _| level)]).unwrap();
        let refusal = |dark: Option<&Average>, flat: Option<&Average>| {
            Correction::new(dark, flat, &development()).unwrap_err().to_string()
        };
        for level in [30.0, 250.0] {
            assert!(refusal(None, Some(&average(level))).contains("40 to 235"));
        }
        let small = Average { width: 12, height: 16, ..average(100.0) };
        let error = refusal(Some(&average(12.0)), Some(&small));
        assert!(
            error.contains("the flat frame is of 12x16") && error.contains("dark frame of 16x12"),
            "{error}"
        );
        let correction = correction();
        let mut other = Signals {
            width: 2,
            height: 2,
            pattern: Some(BayerPattern::Rggb),
            data: vec![0.0; 4],
            full: vec![false; 4],
        };
        let error = correction.apply(&mut other, 1.0).unwrap_err().to_string();
        assert!(error.contains("a frame of 2x2 pixels (Rggb) came") && error.contains("16x12"), "{error}");
        let image = relight_scene::Image { width: 1, height: 1, data: vec![1; 3] };
        let error = Average::of(&[Frame::Developed(image)]).unwrap_err().to_string();
        assert!(error.contains("develops its frames itself"), "{error}");
        assert!(Average::of(&[]).is_err());
    }
}
