//! How bright the lamp was in each of its places.

use crate::camera::LinearImage;

/// Factors that even out a lamp whose brightness differs from light to light: of photographs of one grey patch, one a light
/// and each already divided by what its distance and angle explain (1 if they are alike), the mean of all over each one's own.
/// `patch` is left, top, width and height in pixels.
///
/// None if a photograph does not hold the patch, or it is black there or full.
pub fn gains(photographs: &[LinearImage], explained: &[f64], patch: [u32; 4]) -> Option<Vec<f32>> {
    let means: Option<Vec<f64>> = photographs.iter().map(|photograph| mean(photograph, patch)).collect();
    let means = means.filter(|means| !means.is_empty() && means.len() == explained.len())?;
    let bright: Vec<f64> = means.iter().zip(explained).map(|(mean, explained)| mean / explained).collect();
    let all = bright.iter().sum::<f64>() / bright.len() as f64;
    bright
        .iter()
        .map(|bright| Some((all / bright) as f32).filter(|gain| gain.is_finite() && *gain > 0.0))
        .collect()
}

/// The mean of a patch that is neither black nor full.
fn mean(photograph: &LinearImage, [left, top, width, height]: [u32; 4]) -> Option<f64> {
    let within = |begin: u32, length: u32, all: u32| {
        length > 0 && begin.checked_add(length).is_some_and(|end| end <= all)
    };
    if !within(left, width, photograph.width) || !within(top, height, photograph.height) {
        return None;
    }
    let mut sum = 0.0;
    for y in top..top + height {
        let begin = 3 * (y as usize * photograph.width as usize + left as usize);
        let row = &photograph.data[begin..begin + 3 * width as usize];
        if row.iter().any(|&value| value >= 0.98) {
            return None;
        }
        sum += row.iter().map(|&value| f64::from(value)).sum::<f64>();
    }
    Some(sum / (3.0 * f64::from(width) * f64::from(height))).filter(|mean| *mean > 0.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn factors_even_out_what_geometry_does_not_explain() {
        let photograph = |grey: f32| {
            let mut data = vec![1.5; 3 * 8 * 6];
            // The patch alone is grey.
            for y in 2..5 {
                data[3 * (8 * y + 1)..3 * (8 * y + 4)].fill(grey);
            }
            LinearImage { width: 8, height: 6, data }
        };
        let photographs = [0.2, 0.1, 0.3].map(photograph);
        let found = gains(&photographs, &[1.0, 0.5, 1.0], [1, 2, 3, 3]).unwrap();
        let expected = [7.0 / 6.0, 7.0 / 6.0, 7.0 / 9.0];
        assert!(found.iter().zip(expected).all(|(a, b): (&f32, f32)| (a - b).abs() < 1e-6), "{found:?}");
        for patch in [[0, 2, 3, 3], [6, 2, 3, 3], [1, 2, 0, 3], [u32::MAX, 2, 3, 3]] {
            assert_eq!(gains(&photographs, &[1.0; 3], patch), None);
        }
        assert_eq!(gains(&photographs, &[1.0; 2], [1, 2, 3, 3]), None);
        assert_eq!(gains(&photographs, &[1.0, 0.0, 1.0], [1, 2, 3, 3]), None);
    }
}
