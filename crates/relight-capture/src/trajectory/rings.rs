//! How many cells each ring of a partition has.

use std::f64::consts::PI;

/// The rings of Kegerreis et al. 2019 on the whole sphere, from cap to cap, for at least three cells: rings of equal height
/// first, as many as make cells about square; then the whole number of cells nearest to each ring's share, what rounding
/// leaves carried on to the next.
pub(super) fn of_sphere(cells: usize) -> Vec<usize> {
    let n = cells as f64;
    let cap = 2.0 * (1.0 / n).sqrt().asin();
    let cell_area = 4.0 * PI / n;
    // Three cells leave one between the caps, of which the rule makes no ring.
    let collars = ((PI - 2.0 * cap) / cell_area.sqrt()).round_ties_even().max(1.0);
    let height = (PI - 2.0 * cap) / collars;
    let share_above = |bound: f64| (bound * height + cap) / 2.0;
    let mut rings = vec![1];
    let mut carried = 0.0;
    for collar in 0..collars as usize {
        let [top, bottom] = [collar, collar + 1].map(|bound| share_above(bound as f64).sin().powi(2));
        let ideal = 4.0 * PI * (bottom - top) / cell_area;
        let count = (ideal + carried).round_ties_even();
        carried += ideal - count;
        rings.push(count as usize);
    }
    rings.push(1);
    rings
}

/// The rings whose cells are as square as can be: of all ways to part the cells from `first` to `last` into rings, the one
/// in which [`elongation`] has the least sum over the cells.
///
/// `bounds[c]` is the colatitude above which `c` of the cells fit, `side` that of a square of a cell's area, radians. Rings
/// less than a third or more than three times as high as that are not tried: two of them joined, or one halved, do better. (Of few
/// cells the first may be a little less than half as high.)
pub(super) fn squarest(bounds: &[f64], side: f64, first: usize, last: usize) -> Vec<usize> {
    // The shortest path over the numbers of cells above a bound.
    let mut least = vec![f64::INFINITY; last + 1];
    let mut ring_above = vec![0; last + 1];
    least[first] = 0.0;
    for above in first..last {
        if least[above] == f64::INFINITY {
            continue;
        }
        let within = |height: f64| bounds[..=last].partition_point(|bound| bound - bounds[above] <= height);
        let lowest = within(side / 3.0).clamp(above + 1, last);
        let highest = (within(3.0 * side) - 1).max(lowest);
        for end in lowest..=highest {
            let count = end - above;
            let sum = least[above] + count as f64 * elongation(bounds[end] - bounds[above], side);
            if sum < least[end] {
                least[end] = sum;
                ring_above[end] = count;
            }
        }
    }
    let mut rings = Vec::new();
    let mut above = last;
    while above > first {
        rings.push(ring_above[above]);
        above -= ring_above[above];
    }
    rings.reverse();
    rings
}

/// How far a cell of a height is from square: the sum of height over mean width and its inverse, 2 for a square. But for
/// a constant it is the cell's squared perimeter over its area, `side` squared.
pub(super) fn elongation(height: f64, side: f64) -> f64 {
    let aspect = (height / side).powi(2);
    aspect + 1.0 / aspect
}
