//! What an arm carries on its flange.

use std::f64::consts::FRAC_1_SQRT_2;

use relight_scene::Pose;

use super::Capsule;

/// Camera or light on a flange.
#[derive(Clone, Debug, PartialEq)]
pub struct Tool {
    /// Tool to flange, metres: a camera's axes are OpenCV's, a light shines along +Z.
    pub mount: Pose,
    /// The room that it and its bracket take, in the flange's frame, metres.
    pub hull: Vec<Capsule>,
}

impl Tool {
    /// A bare flange.
    pub fn none() -> Self {
        Self { mount: Pose::IDENTITY, hull: Vec::new() }
    }

    /// The camera of the ReNe capture: its optical axis at 45 degrees to the flange's normal, leaning to the flange's +Y.
    ///
    /// The paper tells the angle only. Assumed here: a bracket of 60 mm along the normal, the optical centre 50 mm before
    /// it along the optical axis, and a hull of 50 mm about both (the camera is 29 x 29 x 42 mm, its lens about 40 mm
    /// long). Calibration finds the true mount.
    pub fn camera() -> Self {
        let h = FRAC_1_SQRT_2;
        let bracket = [0.0, 0.0, 0.06];
        let centre = [0.0, 0.05 * h, 0.06 + 0.05 * h];
        let mount = Pose([[1.0, 0.0, 0.0, centre[0]], [0.0, h, h, centre[1]], [0.0, -h, h, centre[2]]]);
        let hull = vec![Capsule::new([0.0, 0.0, 0.02], bracket, 0.05), Capsule::new(bracket, centre, 0.05)];
        Self { mount, hull }
    }

    /// The lamp of the ReNe capture, a headlight, shining along the flange's normal.
    ///
    /// The paper does not tell how it is mounted. Assumed here: 60 mm before the flange, inside a hull of 50 mm.
    /// Registration finds the true place.
    pub fn light() -> Self {
        let mount = Pose([[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.06]]);
        Self { mount, hull: vec![Capsule::new([0.0, 0.0, 0.02], [0.0, 0.0, 0.04], 0.05)] }
    }
}
