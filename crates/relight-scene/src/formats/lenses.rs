//! Whether a lens can be that of its images.

use crate::camera::Intrinsics;

/// Pixels by which a corner of the image may move when its distortion is undone and done again.
const ROUND_TRIP: f64 = 0.5;

/// What looks wrong about a lens, and how to mend it.
pub(super) fn odd(lens: &Intrinsics) -> Vec<(String, &'static str)> {
    let Intrinsics { width, height, cx, cy, .. } = lens;
    let mut odd = Vec::new();
    // Pixels reach half their width to both sides of their centres.
    let is_inside = |c: f64, side: u32| (-0.5..f64::from(side) - 0.5).contains(&c);
    if !is_inside(*cx, *width) || !is_inside(*cy, *height) {
        let problem = format!(
            "the principal point lies outside the image of {width}x{height}, at {cx}, {cy} from its first pixel's centre"
        );
        odd.push((
            problem,
            "Check that the lens and the image size (width, then height) belong to the same resolution.",
        ));
    }
    let miss = lens.round_trip_error();
    if miss > ROUND_TRIP {
        // A wild lens misses by numbers of three hundred digits.
        let miss = if miss < 1e6 { format!("{miss:.1}") } else { format!("{miss:e}") };
        let problem =
            format!("the lens distortion cannot be undone at the image's corners (off by {miss} pixels)");
        let mend =
            "Check the distortion coefficients (OpenCV's order is k1 k2 p1 p2 k3 …) or calibrate with fewer.";
        odd.push((problem, mend));
    }
    odd
}
