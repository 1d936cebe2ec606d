//! Whether photographs are as good as their fellows.

use relight_scene::Image;

/// Frames of a view whose sharpness lies below this share of the view's median are named.
const BLURRED: f64 = 0.5;
/// ... and those below this share of the median of all views, which see the object from other sides.
const BLURRED_VIEW: f64 = 0.35;
/// Frames darker than this, of 255, say nothing of sharpness.
const TOO_DARK: f64 = 4.0;

/// Mean of all bytes, 0 to 255.
pub fn brightness(image: &Image) -> f64 {
    let sum: u64 = image.data.iter().map(|&byte| u64::from(byte)).sum();
    sum as f64 / image.data.len().max(1) as f64
}

/// How much fine detail there is: the root mean square of the Laplacian of green over its mean, which a change of
/// exposure leaves as it is and blur lowers (variance of the Laplacian, Pech-Pacheco et al. 2000).
pub fn sharpness(image: &Image) -> f64 {
    let (w, h) = (image.width as usize, image.height as usize);
    if w < 3 || h < 3 {
        return 0.0;
    }
    let green = |x: usize, y: usize| f64::from(image.data[3 * (y * w + x) + 1]);
    let (mut squares, mut sum) = (0.0, 0.0);
    for y in 1..h - 1 {
        for x in 1..w - 1 {
            let around = green(x - 1, y) + green(x + 1, y) + green(x, y - 1) + green(x, y + 1);
            squares += (around - 4.0 * green(x, y)).powi(2);
            sum += green(x, y);
        }
    }
    let pixels = ((w - 2) * (h - 2)) as f64;
    if sum == 0.0 { 0.0 } else { (squares / pixels).sqrt() / (sum / pixels) }
}

/// Of frames of views, given as light, brightness and sharpness, those that are blurred beside the others of their view: the
/// camera shook, or lost its focus. Views that are blurred as a whole are compared with the other views: there the object was out of
/// focus under every light.
pub fn blurred(views: &[Vec<(usize, f64, f64)>]) -> Vec<(usize, usize)> {
    let middles: Vec<Option<f64>> = views
        .iter()
        .map(|frames| {
            let known = frames.iter().filter(|(_, brightness, _)| *brightness > TOO_DARK);
            median(known.map(|&(_, _, sharpness)| sharpness).collect())
        })
        .collect();
    let Some(usual) = median(middles.iter().flatten().copied().collect()) else { return Vec::new() };
    let mut found = Vec::new();
    for (view, (frames, middle)) in views.iter().zip(&middles).enumerate() {
        let limit = BLURRED * middle.unwrap_or(0.0).max(usual * BLURRED_VIEW / BLURRED);
        let is_blurred =
            |&&(_, brightness, sharpness): &&(usize, f64, f64)| brightness > TOO_DARK && sharpness < limit;
        found.extend(frames.iter().filter(is_blurred).map(|&(light, _, _)| (view, light)));
    }
    found
}

/// The upper median.
fn median(mut values: Vec<f64>) -> Option<f64> {
    values.sort_by(f64::total_cmp);
    values.get(values.len() / 2).copied()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Stripes of a width, of a brightness.
    fn stripes(width: usize, bright: u8) -> Image {
        let row: Vec<u8> = (0..48)
            .flat_map(|x| [if (x / width).is_multiple_of(2) { bright } else { bright / 4 }; 3])
            .collect();
        Image { width: 48, height: 8, data: row.repeat(8) }
    }

    #[test]
    fn sharpness_falls_with_blur_and_not_with_exposure() {
        let (fine, dim, coarse) = (stripes(1, 200), stripes(1, 100), stripes(4, 200));
        assert!((sharpness(&fine) / sharpness(&dim) - 1.0).abs() < 1e-9);
        assert!(sharpness(&coarse) < 0.6 * sharpness(&fine));
        assert_eq!(sharpness(&Image { width: 3, height: 3, data: vec![0; 27] }), 0.0);
        assert_eq!(brightness(&stripes(1, 200)), 125.0);
    }

    #[test]
    fn the_blurred_are_named_and_the_dark_are_not() {
        let mut frames: Vec<(usize, f64, f64)> = (0..9).map(|light| (light, 90.0, 1.0)).collect();
        frames[3].2 = 0.4;
        frames[5] = (5, 2.0, 0.1);
        assert_eq!(blurred(std::slice::from_ref(&frames)), [(0, 3)]);
        assert!(blurred(&[]).is_empty() && blurred(&[Vec::new()]).is_empty());
        // A whole view out of focus beside two others, and one that has little texture.
        let all = |sharpness: f64| (0..4).map(|light| (light, 90.0, sharpness)).collect::<Vec<_>>();
        let views = [all(1.0), all(0.3), all(0.5), all(1.1)];
        assert_eq!(blurred(&views), [(1, 0), (1, 1), (1, 2), (1, 3)]);
    }
}
