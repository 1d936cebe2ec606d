//! Partition of a spherical region into cells of equal area.

use serde::{Deserialize, Serialize};

use super::region::{self, Region};
use super::rings;

/// Most cells of a partition; a capture with more is a mistake.
pub const MAX_CELLS: usize = 100_000;

/// A cell: what lies between two colatitudes and two azimuths, radians.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Cell {
    /// Bounds in colatitude.
    pub colatitude: [f64; 2],
    /// Bounds in azimuth.
    pub azimuth: [f64; 2],
}

impl Cell {
    /// Colatitude and azimuth of the centre, radians: the means of the bounds, but the pole for a polar cap.
    pub fn centre(&self) -> [f64; 2] {
        let mean = |[lo, hi]: [f64; 2]| lo + (hi - lo) / 2.0;
        let [top, bottom] = self.colatitude;
        let colatitude = match region::holds_poles(self.colatitude, self.azimuth) {
            [true, _] => top,
            [_, true] => bottom,
            _ => mean(self.colatitude),
        };
        [colatitude, mean(self.azimuth)]
    }

    /// Whether it is a polar cap: a whole circle that holds a pole.
    pub fn is_cap(&self) -> bool {
        region::holds_poles(self.colatitude, self.azimuth) != [false; 2]
    }

    /// Area on the unit sphere, steradians.
    pub fn area(&self) -> f64 {
        region::area(self.colatitude, self.azimuth)
    }
}

/// A region in rings of cells, all of one area.
#[derive(Clone, Debug, PartialEq)]
pub struct Partition {
    /// Cells of each ring, from the zenith down; a polar cap is a ring of one.
    pub rings: Vec<usize>,
    /// The cells, ring by ring, by azimuth within each.
    pub cells: Vec<Cell>,
}

/// Why a region cannot be parted.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum PartitionError {
    /// No cells were asked for.
    #[error("0 cells: a partition needs at least one")]
    NoCells,
    /// More cells than anybody can visit.
    #[error("{0} cells are too many: at most {MAX_CELLS}")]
    TooManyCells(usize),
}

impl Partition {
    /// Parts `region` into exactly `cells` cells of equal area.
    ///
    /// The whole sphere as Kegerreis et al. 2019 do (*Planetary giant impacts: convergence of high-resolution
    /// simulations using efficient spherical initial conditions and SWIFT*, appendix A; their stretching is for particles
    /// and left out): a cap on each pole and rings between. One cell is the sphere, two are its halves. Any other
    /// region has a polar cap only where it holds the pole inside, and otherwise the rings that make cells as square as
    /// can be. Each ring's first cell begins at the region's least azimuth.
    ///
    /// # Errors
    /// For no cells, or more than [`MAX_CELLS`].
    pub fn new(region: &Region, cells: usize) -> Result<Partition, PartitionError> {
        match cells {
            0 => return Err(PartitionError::NoCells),
            1..=MAX_CELLS => {}
            _ => return Err(PartitionError::TooManyCells(cells)),
        }
        let bounds: Vec<f64> = (0..=cells).map(|above| bound(region, above, cells)).collect();
        let [lo, hi] = region.azimuth();
        let rings = match region.holds_poles() {
            _ if cells == 1 => vec![1],
            [true, true] if cells == 2 => vec![1, 1],
            [true, true] => rings::of_sphere(cells),
            caps => {
                let [first, after_last] = caps.map(usize::from);
                let side = (region.area() / cells as f64).sqrt();
                let between = rings::squarest(&bounds, side, first, cells - after_last);
                [vec![1; first], between, vec![1; after_last]].concat()
            }
        };
        let mut parted = Vec::with_capacity(cells);
        for &count in &rings {
            let above = parted.len();
            let colatitude = [bounds[above], bounds[above + count]];
            let meridian =
                |place: usize| if place == count { hi } else { lo + (hi - lo) * place as f64 / count as f64 };
            parted.extend(
                (0..count).map(|place| Cell { colatitude, azimuth: [meridian(place), meridian(place + 1)] }),
            );
        }
        Ok(Partition { rings, cells: parted })
    }
}

/// The colatitude above which `above` of the region's `cells` cells fit.
fn bound(region: &Region, above: usize, cells: usize) -> f64 {
    let [top, bottom] = region.colatitude();
    if above == 0 || above == cells {
        return if above == 0 { top } else { bottom };
    }
    // Squared sine and cosine of half the angle are linear in area; with both, neither pole loses digits.
    let share = above as f64 / cells as f64;
    let between = ((top + bottom) / 2.0).sin() * ((bottom - top) / 2.0).sin();
    let sine = (top / 2.0).sin().powi(2) + share * between;
    let cosine = (bottom / 2.0).cos().powi(2) + (cells - above) as f64 / cells as f64 * between;
    2.0 * sine.sqrt().atan2(cosine.sqrt())
}
