//! How finely a rig traces.

use super::error::{RigError, within};

/// How finely a rig traces.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Settings {
    /// Camera rays a pixel; powers of two are stratified best.
    pub samples: u32,
    /// Each bounce is joined to one in `bounce_share` of the lights, in turn, and counts for all of them: faster, and noisier
    /// in indirect light only.
    pub bounce_share: u32,
    /// How a pixel weighs what lies around its centre.
    pub filter: Filter,
    /// Which of many equally good pictures: paths and sensor noise.
    pub seed: u64,
}

/// How a pixel weighs what lies around its centre.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Filter {
    /// Its own square evenly, as a sensor of full fill factor does.
    Box,
    /// A tent of two pixels' width: softer, without stairs.
    Tent,
}

impl Default for Settings {
    fn default() -> Self {
        Self { samples: 32, bounce_share: 1, filter: Filter::Box, seed: 0 }
    }
}

impl Settings {
    pub(super) fn check(&self) -> Result<(), RigError> {
        within("the number of samples a pixel", f64::from(self.samples), [1.0, 65_536.0], "1 to 65536")?;
        within(
            "the share of lights a bounce is joined to",
            f64::from(self.bounce_share),
            [1.0, 64.0],
            "1 to 64",
        )
    }
}
