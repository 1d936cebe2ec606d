//! Regions of the unit sphere between two colatitudes and two azimuths.

use std::f64::consts::{PI, TAU};
use std::fmt;

/// The narrowest range of colatitude or azimuth that is parted, radians: a micrometre at a metre's distance.
const NARROWEST: f64 = 1e-6;
/// Ranges that miss a full turn by no more than this are whole circles, radians.
const ROUNDING: f64 = 1e-9;

/// The part of the unit sphere between two colatitudes and two azimuths, radians: the whole sphere, a dome around a pole, a
/// belt, or a wedge of any of these.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Region {
    colatitude: [f64; 2],
    azimuth: [f64; 2],
}

/// Why two ranges are no region. Angles are told in degrees.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum RegionFault {
    /// A bound is infinite or not a number.
    #[error("the {0} range holds a bound that is not a finite number")]
    NotFinite(&'static str),
    /// A range ends before it begins.
    #[error("the {0} range {1} to {2} degrees is reversed: put the lower bound first")]
    Reversed(&'static str, Degrees, Degrees),
    /// A range holds nothing, or next to nothing.
    #[error("the {0} range {1} to {2} degrees is empty: it must span at least {least} degrees", least = Degrees(NARROWEST))]
    Empty(&'static str, Degrees, Degrees),
    /// A colatitude beyond a pole.
    #[error(
        "the colatitude range {0} to {1} degrees leaves 0..180: colatitude is 0 at the zenith (+Z), 90 at the horizon \
         (elevation is 90 - colatitude)"
    )]
    BeyondPole(Degrees, Degrees),
    /// An azimuth that nobody means.
    #[error("the azimuth range {0} to {1} degrees leaves -360..720: write the same angles within it")]
    FarAzimuth(Degrees, Degrees),
    /// More than a whole circle.
    #[error("the azimuth range {0} to {1} degrees is more than a full turn: it would cover cells twice")]
    MoreThanCircle(Degrees, Degrees),
}

/// An angle in radians, shown in degrees without the digits that conversion adds.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Degrees(f64);

impl fmt::Display for Degrees {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let degrees = self.0.to_degrees();
        let rounded = (degrees * 1e9).round() / 1e9;
        write!(f, "{}", if rounded == 0.0 { degrees } else { rounded })
    }
}

impl Region {
    /// The whole sphere.
    pub const SPHERE: Region = Region { colatitude: [0.0, PI], azimuth: [0.0, TAU] };

    /// The region between two colatitudes and two azimuths, radians. Azimuths that span a full turn make a whole circle.
    ///
    /// # Errors
    /// If a range is not finite, reversed, empty or next to it, leaves 0..pi (colatitude) or -2 pi..4 pi (azimuth), or
    /// spans more than a full turn.
    pub fn new(colatitude: [f64; 2], azimuth: [f64; 2]) -> Result<Region, RegionFault> {
        for (name, [lo, hi]) in [("colatitude", colatitude), ("azimuth", azimuth)] {
            if !lo.is_finite() || !hi.is_finite() {
                return Err(RegionFault::NotFinite(name));
            }
            if lo > hi {
                return Err(RegionFault::Reversed(name, Degrees(lo), Degrees(hi)));
            }
            if hi - lo < NARROWEST {
                return Err(RegionFault::Empty(name, Degrees(lo), Degrees(hi)));
            }
        }
        let told = |[lo, hi]: [f64; 2]| (Degrees(lo), Degrees(hi));
        if colatitude[0] < 0.0 || colatitude[1] > PI {
            let (lo, hi) = told(colatitude);
            return Err(RegionFault::BeyondPole(lo, hi));
        }
        let (lo, hi) = told(azimuth);
        if azimuth[0] < -TAU || azimuth[1] > 2.0 * TAU {
            return Err(RegionFault::FarAzimuth(lo, hi));
        }
        if azimuth[1] - azimuth[0] > TAU + ROUNDING {
            return Err(RegionFault::MoreThanCircle(lo, hi));
        }
        Ok(Region { colatitude, azimuth })
    }

    /// Least and greatest colatitude, radians.
    pub fn colatitude(&self) -> [f64; 2] {
        self.colatitude
    }

    /// Least and greatest azimuth, radians.
    pub fn azimuth(&self) -> [f64; 2] {
        self.azimuth
    }

    /// Whether the region holds the zenith and the nadir inside, not only at a wedge's tip.
    pub fn holds_poles(&self) -> [bool; 2] {
        holds_poles(self.colatitude, self.azimuth)
    }

    /// Area on the unit sphere, steradians.
    pub fn area(&self) -> f64 {
        area(self.colatitude, self.azimuth)
    }
}

/// As [`Region::holds_poles`].
pub(super) fn holds_poles([top, bottom]: [f64; 2], [lo, hi]: [f64; 2]) -> [bool; 2] {
    [top == 0.0, bottom == PI].map(|reached| reached && hi - lo >= TAU - ROUNDING)
}

/// Area between two colatitudes and two azimuths on the unit sphere, steradians.
pub(super) fn area([top, bottom]: [f64; 2], [lo, hi]: [f64; 2]) -> f64 {
    // The difference of the cosines, as a product: exact for thin cells too.
    (hi - lo) * 2.0 * ((top + bottom) / 2.0).sin() * ((bottom - top) / 2.0).sin()
}
