//! Whether a lens can be that of its images.

use std::path::Path;

use crate::camera::Intrinsics;
use crate::error::{FaultKind, Faults};

/// Pixels by which a corner of the image may move when its distortion is undone and done again.
const ROUND_TRIP: f64 = 0.5;

/// Warns of what looks wrong about the lens that `path` states.
pub(super) fn check(lens: &Intrinsics, path: &Path, faults: &mut Faults) {
    let Intrinsics { width, height, cx, cy, .. } = lens;
    if !(0.0..f64::from(*width)).contains(cx) || !(0.0..f64::from(*height)).contains(cy) {
        let problem = format!("the principal point {cx}, {cy} lies outside the image of {width}x{height}");
        let mend = "Check that the camera matrix and the image size (width, then height) belong to the same resolution.";
        faults.warning(FaultKind::Lens, path, problem, mend);
    }
    let miss = lens.round_trip_error();
    if miss > ROUND_TRIP {
        // A wild lens misses by numbers of three hundred digits.
        let miss = if miss < 1e6 { format!("{miss:.1}") } else { format!("{miss:e}") };
        let problem =
            format!("the lens distortion cannot be undone at the image's corners (off by {miss} pixels)");
        let mend =
            "Check the distortion coefficients (OpenCV's order is k1 k2 p1 p2 k3 …) or calibrate with fewer.";
        faults.warning(FaultKind::Lens, path, problem, mend);
    }
}
