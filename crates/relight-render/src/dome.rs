//! The part of a sphere about the focus on which cameras or lights stand.

use std::f64::consts::{FRAC_PI_2, PI, TAU};

use relight_scene::Pose;

/// An azimuth gap wider than this is not crossed: what stands there was never seen or lit from there.
const WIDEST_GAP: f64 = FRAC_PI_2;

/// A part of a sphere with its axis upright; angles in radians.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Dome {
    focus: [f64; 3],
    /// Mean distance from the focus, metres.
    radius: f64,
    /// Mean elevation.
    pub(crate) elevation: f64,
    /// Elevations that all but a tenth at either end lie between.
    pub(crate) elevations: [f64; 2],
    /// Middle of the azimuths.
    middle: f64,
    /// Half the range of azimuths; pi where they go all round.
    half: f64,
}

impl Dome {
    /// The dome on which `poses` stand; `None` if there are none.
    pub(crate) fn of<'a>(poses: impl IntoIterator<Item = &'a Pose>, focus: [f64; 3]) -> Option<Dome> {
        let polar: Vec<[f64; 3]> = poses.into_iter().map(|pose| polar(pose.position(), focus)).collect();
        let mean = |i: usize| polar.iter().map(|p| p[i]).sum::<f64>() / polar.len() as f64;
        let sorted = |i: usize| {
            let mut values: Vec<f64> = polar.iter().map(|p| p[i]).collect();
            values.sort_by(f64::total_cmp);
            values
        };
        let (azimuths, elevations) = (sorted(1), sorted(2));
        let last = elevations.len().checked_sub(1)?;
        let gap_after = |i: usize| match azimuths.get(i + 1) {
            Some(next) => next - azimuths[i],
            None => azimuths[0] + TAU - azimuths[i],
        };
        let widest = (0..=last).max_by(|&i, &j| gap_after(i).total_cmp(&gap_after(j)))?;
        let gap = gap_after(widest);
        // The range starts where the widest gap ends.
        let half = if gap > WIDEST_GAP { (TAU - gap) / 2.0 } else { PI };
        Some(Dome {
            focus,
            radius: mean(0),
            elevation: mean(2),
            elevations: [elevations[last / 10], elevations[last - last / 10]],
            middle: azimuths[widest] + gap + half,
            half,
        })
    }

    /// The azimuth at `phase`, of period 1: all round at constant speed, or there and back within the range.
    pub(crate) fn azimuth(&self, phase: f64) -> f64 {
        let swing = if self.half == PI { TAU * phase } else { self.half * (TAU * phase).sin() };
        self.middle + swing
    }

    /// The point of the dome at an azimuth and an elevation, world frame, metres.
    pub(crate) fn point(&self, azimuth: f64, elevation: f64) -> [f64; 3] {
        let flat = self.radius * elevation.cos();
        let offset = [flat * azimuth.cos(), flat * azimuth.sin(), self.radius * elevation.sin()];
        std::array::from_fn(|i| self.focus[i] + offset[i])
    }
}

/// Distance, azimuth and elevation of a point as seen from the focus.
fn polar(point: [f64; 3], focus: [f64; 3]) -> [f64; 3] {
    let [x, y, z]: [f64; 3] = std::array::from_fn(|i| point[i] - focus[i]);
    let flat = x.hypot(y);
    [flat.hypot(z), y.atan2(x), z.atan2(flat)]
}
