//! A calibration in words.

use std::fmt;

use super::result::{CENTRE_ACCURACY, Calibration, DIRECTION_ACCURACY, Waypoint};

impl fmt::Display for Calibration {
    /// The lens with its standard errors, a line for each waypoint, then what is bad or left out, and the light's arm.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (lens, errors) = (&self.intrinsics, &self.intrinsics_errors);
        writeln!(
            f,
            "lens      fx {:.2} +- {:.2}, fy {:.2} +- {:.2}, cx {:.2} +- {:.2}, cy {:.2} +- {:.2} px; {:.3} px RMS",
            lens.fx, errors[0], lens.fy, errors[1], lens.cx, errors[2], lens.cy, errors[3], self.rms_pixels
        )?;
        write!(f, "         ")?;
        let names = ["k1", "k2", "p1", "p2", "k3"];
        for ((name, value), error) in names.iter().zip(&lens.distortion).zip(&errors[4..]) {
            match *error {
                0.0 => write!(f, " {name} {value} (held)")?,
                error => write!(f, " {name} {value:.5} +- {error:.5},")?,
            }
        }
        writeln!(f)?;
        self.write_lens_photographs(f)?;
        writeln!(f, "waypoint  corners  RMS px  worst px  RMS mm  centre +- mm  direction +- deg")?;
        for waypoint in &self.waypoints {
            writeln!(f, "{waypoint}")?;
        }
        for left_out in &self.left_out {
            writeln!(f, "waypoint {} has no pose: {}", left_out.label, left_out.reason)?;
        }
        let means = [|w: &Waypoint| w.position_error, |w: &Waypoint| w.rotation_error]
            .map(|of| self.waypoints.iter().map(of).sum::<f64>() / self.waypoints.len() as f64);
        writeln!(
            f,
            "expected  centres to {:.4} mm, directions to {:.4} degrees (mean)",
            means[0] * 1e3,
            means[1].to_degrees()
        )?;
        if let Some(light) = &self.light {
            let how = if light.is_rotation_measured { "measured" } else { "declared" };
            let touches = light.residuals.len();
            let rms = light.rms * 1e3;
            writeln!(f, "light     {touches} touches, {rms:.3} mm RMS; its rotation is {how}")?;
        }
        Ok(())
    }
}

impl Calibration {
    fn write_lens_photographs(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let all = self.lens_photographs.len();
        let taking_part = self.lens_photographs.iter().filter(|p| p.problem.is_none()).count();
        if all > 0 {
            writeln!(f, "          {taking_part} of {all} photographs for the lens alone took part")?;
        }
        Ok(())
    }

    /// What stands in the way of trusting it, and what to do; a line each.
    pub fn warnings(&self) -> Vec<String> {
        let list = |labels: &[usize]| labels.iter().map(usize::to_string).collect::<Vec<_>>().join(", ");
        let mut warnings = Vec::new();
        let bad = self.bad();
        if !bad.is_empty() {
            warnings.push(format!("bad waypoints, shoot them again: {}", list(&bad)));
        }
        let weak = self.weak();
        if !weak.is_empty() {
            warnings.push(format!(
                "the geometry is weak: these waypoints may be off by more than {} mm or {:.2} degrees, however small their residuals: \
                 {}. Add photographs of the board for the lens alone, the camera rolled by quarter turns and the board tilted by 30 to \
                 45 degrees in all directions, or a lens that is known from an earlier session",
                CENTRE_ACCURACY * 1e3,
                DIRECTION_ACCURACY.to_degrees(),
                list(&weak)
            ));
        }
        if let Some(shift) = self.lens_shift.filter(|_| self.is_another_lens()) {
            warnings.push(format!(
                "the lens is {shift:.1} standard errors from the earlier one: it was refocused, turned or exchanged since. Calibrate \
                 without that one"
            ));
        }
        warnings
    }
}

impl fmt::Display for Waypoint {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let says = match (self.is_bad, self.is_weak()) {
            (true, _) => "  bad: shoot it again",
            (false, true) => "  weak",
            (false, false) => "",
        };
        write!(
            f,
            "{:8}  {:7}  {:6.3}  {:8.3}  {:6.4}  {:12.4}  {:16.4}{says}",
            self.label,
            self.corners,
            self.rms_pixels,
            self.worst_pixels,
            self.rms_metres * 1e3,
            self.position_error * 1e3,
            self.rotation_error.to_degrees(),
        )
    }
}
