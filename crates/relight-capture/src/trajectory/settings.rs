//! What a person says about a rig, in TOML: where camera and light may stand.

use serde::{Deserialize, Serialize};

use super::dome::{Dome, DomeFault};
use super::plan::ObjectBox;
use super::region::Region;

/// What a plan is made from. The default is the rig of the ReNe paper, its camera towards -Y.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct PlanSettings {
    /// The box that holds the object, world, metres; camera and light look at its middle.
    pub object: ObjectBox,
    /// The camera's dome.
    pub camera: ArmSettings,
    /// The light's dome.
    pub light: ArmSettings,
}

/// Where the waypoints of one arm stand. Angles in degrees: a person writes them.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, rename_all = "kebab-case")]
pub struct ArmSettings {
    /// How many, each over a cell of the same area.
    pub waypoints: usize,
    /// Range of colatitude: 0 at the zenith, 90 at the horizon.
    pub colatitude_degrees: [f64; 2],
    /// Range of azimuth, from +X towards +Y; the whole circle if not given.
    #[serde(default = "whole_circle")]
    pub azimuth_degrees: [f64; 2],
    /// Range of distance from the centre.
    pub radius_metres: [f64; 2],
    /// Middle of the sphere in the world; the origin if not given.
    #[serde(default)]
    pub centre_metres: [f64; 3],
    /// Turn about the direction of sight, from right towards down.
    #[serde(default)]
    pub roll_degrees: f64,
}

fn whole_circle() -> [f64; 2] {
    [0.0, 360.0]
}

impl Default for PlanSettings {
    fn default() -> Self {
        let (centre_metres, roll_degrees) = ([0.0; 3], 0.0);
        PlanSettings {
            object: ObjectBox { lo: [-0.1, -0.1, 0.0], hi: [0.1, 0.1, 0.15] },
            camera: ArmSettings {
                waypoints: 50,
                colatitude_degrees: [48.0, 68.0],
                azimuth_degrees: [-118.5, -61.5],
                radius_metres: [0.602, 0.623],
                centre_metres,
                roll_degrees,
            },
            light: ArmSettings {
                waypoints: 40,
                colatitude_degrees: [5.0, 43.0],
                azimuth_degrees: whole_circle(),
                radius_metres: [0.363, 0.414],
                centre_metres,
                roll_degrees,
            },
        }
    }
}

impl ArmSettings {
    /// The dome, looking at `target` (world, metres).
    ///
    /// # Errors
    /// If the ranges are no region.
    pub fn dome(&self, target: [f64; 3]) -> Result<Dome, DomeFault> {
        let radians = |range: [f64; 2]| range.map(f64::to_radians);
        Ok(Dome {
            region: Region::new(radians(self.colatitude_degrees), radians(self.azimuth_degrees))?,
            cells: self.waypoints,
            centre: self.centre_metres,
            radius: self.radius_metres,
            target,
            roll: self.roll_degrees.to_radians(),
        })
    }
}
