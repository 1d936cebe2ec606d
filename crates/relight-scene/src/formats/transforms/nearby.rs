//! What was seen before at nearly the same place: numbers in a text file are rounded, each time anew.

use std::collections::HashMap;

use crate::vector::Vector;

/// Differences up to this, metres or entries of a rotation, come from rounding.
pub(super) const ROUNDING: f64 = 1e-4;
/// Edge of a cell, metres: whatever lies within [`ROUNDING`] is in one of at most eight cells.
const CELL: f64 = 1e-3;
/// A cell with more things than this is not looked through: their number must not make reading slow.
const CROWD: usize = 256;

/// Numbers of things by where they are.
#[derive(Default)]
pub(super) struct Nearby {
    cells: HashMap<[i64; 3], Vec<usize>>,
}

impl Nearby {
    /// The first thing near `position` of which `is_same` holds.
    pub(super) fn find(&self, position: Vector, is_same: impl Fn(usize) -> bool) -> Option<usize> {
        let sides = position.map(|x| [cell(x - ROUNDING), cell(x + ROUNDING)]);
        let corners = (0..8).map(|corner| [0, 1, 2].map(|axis| sides[axis][corner >> axis & 1]));
        let things = corners.filter_map(|corner| self.cells.get(&corner)).flatten();
        things.copied().filter(|&thing| is_same(thing)).min()
    }

    /// Adds a thing.
    pub(super) fn add(&mut self, position: Vector, thing: usize) {
        let things = self.cells.entry(position.map(cell)).or_default();
        if things.len() < CROWD {
            things.push(thing);
        }
    }
}

fn cell(x: f64) -> i64 {
    (x / CELL).floor() as i64
}
