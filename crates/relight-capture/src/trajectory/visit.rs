//! The order in which waypoints are visited.

/// Longest run of waypoints that is moved as one.
const LONGEST_RUN: usize = 3;
/// Changes that shorten the way by less than this share of it are rounding.
const ROUNDING: f64 = 1e-12;

/// An order of visiting waypoints with short travel. `rings` holds them ring by ring, each in the order of azimuth.
/// `travel` says what it costs to go from one to another: finite, the same both ways; a distance in space or in joints.
///
/// Starts from the rings one after another, or to and fro (every second ring reversed) if that is shorter, and then
/// reverses stretches (2-opt) and moves runs of up to three elsewhere (or-opt) while either shortens the way. The way is
/// open: it need not end where it began. It is never longer than the rings one after another, and the same each time.
pub(super) fn visit_order(rings: &[Vec<usize>], travel: &impl Fn(usize, usize) -> f64) -> Vec<usize> {
    let plain = rings.concat();
    let to_and_fro: Vec<usize> = rings
        .iter()
        .enumerate()
        .flat_map(|(ring, places)| {
            let mut places = places.clone();
            if ring % 2 == 1 {
                places.reverse();
            }
            places
        })
        .collect();
    let mut order = if length(&to_and_fro, travel) < length(&plain, travel) { to_and_fro } else { plain };
    let least_gain = ROUNDING * length(&order, travel);
    let way = Way { travel, least_gain };
    while way.reverse_stretches(&mut order) | way.move_runs(&mut order) {}
    order
}

/// Travel along an order.
pub(super) fn length(order: &[usize], travel: &impl Fn(usize, usize) -> f64) -> f64 {
    order.windows(2).map(|pair| travel(pair[0], pair[1])).sum()
}

struct Way<'a, T> {
    travel: &'a T,
    least_gain: f64,
}

impl<T: Fn(usize, usize) -> f64> Way<'_, T> {
    /// Travel between two waypoints; none before the first and after the last.
    fn between(&self, from: Option<usize>, to: Option<usize>) -> f64 {
        from.zip(to).map_or(0.0, |(from, to)| (self.travel)(from, to))
    }

    /// Reverses every stretch whose reversal shortens the way; says whether there was one.
    fn reverse_stretches(&self, order: &mut [usize]) -> bool {
        let mut improved = false;
        for first in 0..order.len() {
            let before = first.checked_sub(1).map(|place| order[place]);
            for last in first + 1..order.len() {
                let after = order.get(last + 1).copied();
                let [from, to] = [Some(order[first]), Some(order[last])];
                let now = self.between(before, from) + self.between(to, after);
                let then = self.between(before, to) + self.between(from, after);
                if then < now - self.least_gain {
                    order[first..=last].reverse();
                    improved = true;
                }
            }
        }
        improved
    }

    /// Moves every run that is better elsewhere, either way round, to its best place; says whether there was one.
    fn move_runs(&self, order: &mut Vec<usize>) -> bool {
        let mut improved = false;
        for run in 1..=LONGEST_RUN {
            for first in 0..(order.len() + 1).saturating_sub(run) {
                improved |= self.move_run(order, first, run);
            }
        }
        improved
    }

    fn move_run(&self, order: &mut Vec<usize>, first: usize, run: usize) -> bool {
        let moved: Vec<usize> = order.drain(first..first + run).collect();
        let ends = [moved.first().copied(), moved.last().copied()];
        let cost = |place: usize, [from, to]: [Option<usize>; 2]| {
            let before = place.checked_sub(1).map(|place| order[place]);
            let after = order.get(place).copied();
            self.between(before, from) + self.between(to, after) - self.between(before, after)
        };
        let [from, to] = ends;
        let mut best = (cost(first, ends) - self.least_gain, first, false);
        for place in 0..=order.len() {
            for (ends, reversed) in [([from, to], false), ([to, from], true)] {
                let cost = cost(place, ends);
                if cost < best.0 {
                    best = (cost, place, reversed);
                }
            }
        }
        let (_, place, reversed) = best;
        let improved = place != first || reversed;
        let run: Vec<usize> = if reversed { moved.into_iter().rev().collect() } else { moved };
        order.splice(place..place, run);
        improved
    }
}
