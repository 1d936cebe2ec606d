//! A calibration in words.

use std::fmt;

use super::calibrate::{Calibration, Waypoint};

impl fmt::Display for Calibration {
    /// The lens with its standard errors, a line for each waypoint, then what is bad or left out, and the light's arm.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (lens, errors) = (&self.intrinsics, &self.intrinsics_errors);
        writeln!(
            f,
            "lens      fx {:.2} +- {:.2}, fy {:.2} +- {:.2}, cx {:.2} +- {:.2}, cy {:.2} +- {:.2} px; {:.3} px RMS",
            lens.fx, errors[0], lens.fy, errors[1], lens.cx, errors[2], lens.cy, errors[3], self.rms_pixels
        )?;
        writeln!(f, "waypoint  corners  RMS px  worst px  RMS mm  centre +- mm  direction +- deg")?;
        for waypoint in &self.waypoints {
            writeln!(f, "{waypoint}")?;
        }
        for left_out in &self.left_out {
            writeln!(f, "waypoint {} has no pose: {}", left_out.label, left_out.reason)?;
        }
        if let Some(light) = &self.light {
            let how = if light.is_rotation_measured { "measured" } else { "declared" };
            writeln!(
                f,
                "light     {} touches, {:.3} mm RMS; its rotation is {how}",
                light.residuals.len(),
                light.rms * 1e3
            )?;
        }
        Ok(())
    }
}

impl fmt::Display for Waypoint {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(
            f,
            "{:8}  {:7}  {:6.3}  {:8.3}  {:6.4}  {:12.4}  {:16.4}{}",
            self.label,
            self.corners,
            self.rms_pixels,
            self.worst_pixels,
            self.rms_metres * 1e3,
            self.position_error * 1e3,
            self.rotation_error.to_degrees(),
            if self.is_bad { "  bad: shoot it again" } else { "" }
        )
    }
}
