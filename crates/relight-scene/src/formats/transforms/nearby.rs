//! What was seen before at nearly the same place: numbers in a text file are rounded, each time anew.

use std::collections::HashMap;

use crate::pose::Pose;

/// Differences up to this, metres or entries of a rotation, come from rounding.
pub(super) const ROUNDING: f64 = 1e-4;
/// Edges of a cell: metres of the position, then of the unit vector that tells where the pose looks.
const CELL: [f64; 6] = [1e-3, 1e-3, 1e-3, 0.05, 0.05, 0.05];
/// Things of a cell that are compared; that many are near each other in hostile files alone, and must not slow reading down.
const CROWD: usize = 256;

type Cell = [i64; 6];

/// Numbers of things by their poses.
#[derive(Default)]
pub(super) struct Nearby {
    cells: HashMap<Cell, Vec<usize>>,
}

impl Nearby {
    /// The first thing near `pose` of which `is_same` holds.
    pub(super) fn find(&self, pose: &Pose, is_same: impl Fn(usize) -> bool) -> Option<usize> {
        let [low, high] = [-ROUNDING, ROUNDING].map(|by| cell(pose, by));
        let mut cells = vec![low];
        for axis in (0..CELL.len()).filter(|&axis| low[axis] != high[axis]) {
            let beyond = cells.clone().into_iter().map(|mut cell| {
                cell[axis] = high[axis];
                cell
            });
            cells.extend(beyond);
        }
        let things = cells.iter().filter_map(|cell| self.cells.get(cell)).flatten();
        things.copied().filter(|&thing| is_same(thing)).min()
    }

    /// Adds a thing.
    pub(super) fn add(&mut self, pose: &Pose, thing: usize) {
        let things = self.cells.entry(cell(pose, 0.0)).or_default();
        if things.len() < CROWD {
            things.push(thing);
        }
    }
}

/// The cell of a pose all of whose numbers are moved by `by`.
fn cell(pose: &Pose, by: f64) -> Cell {
    let ([x, y, z], [u, v, w]) = (pose.position(), pose.axis(2));
    let numbers = [x, y, z, u, v, w];
    std::array::from_fn(|i| ((numbers[i] + by) / CELL[i]).floor() as i64)
}
