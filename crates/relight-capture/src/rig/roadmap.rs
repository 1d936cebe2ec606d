//! Which motions an arm may take between its stations while the other arm stands still.

use std::cmp::Reverse;
use std::collections::BinaryHeap;

use crate::kinematics::Joints;

/// The first station of every arm: out of the way of everything.
pub const HOME: usize = 0;

/// Stations of one arm, by number, and the straight motions in joint space between them that are free: from home to each,
/// and along the order of visit. All are free both ways.
///
/// A roadmap as in probabilistic roadmaps (Kavraki et al. 1996), its stations and motions given rather than drawn.
#[derive(Clone, Debug, PartialEq)]
pub struct Roadmap {
    /// For each station: where motions lead, and how far the joints turn, radians.
    motions: Vec<Vec<(usize, f64)>>,
}

/// A length that is compared.
#[derive(Clone, Copy, PartialEq)]
struct Length(f64);

impl Eq for Length {}

impl PartialOrd for Length {
    fn partial_cmp(&self, other: &Self) -> Option<std::cmp::Ordering> {
        Some(self.cmp(other))
    }
}

impl Ord for Length {
    fn cmp(&self, other: &Self) -> std::cmp::Ordering {
        self.0.total_cmp(&other.0)
    }
}

impl Roadmap {
    /// The roadmap of an arm whose joints at each station are known, its home first. `order` is that of the visit,
    /// without home. `is_free` is asked of each motion once.
    pub fn new(
        stations: &[Joints],
        order: &[usize],
        mut is_free: impl FnMut(&Joints, &Joints) -> bool,
    ) -> Roadmap {
        let mut motions = vec![Vec::new(); stations.len()];
        let from_home = order.iter().map(|&to| (HOME, to));
        let along = order.windows(2).filter_map(|pair| Some((*pair.first()?, *pair.last()?)));
        for (from, to) in from_home.chain(along) {
            if let (Some(a), Some(b)) = (stations.get(from), stations.get(to))
                && is_free(a, b)
            {
                let turned = a.iter().zip(b).map(|(a, b)| (b - a).abs()).sum();
                motions[from].push((to, turned));
                motions[to].push((from, turned));
            }
        }
        Roadmap { motions }
    }

    /// The stations after `from` on the shortest free way to `to`; none if there is no way.
    pub fn way(&self, from: usize, to: usize) -> Option<Vec<usize>> {
        let before = self.shortest_ways(from);
        let mut way = vec![to];
        let mut station = to;
        while station != from {
            station = (*before.get(station)?)?;
            way.push(station);
        }
        way.pop();
        way.reverse();
        Some(way)
    }

    /// Whether each station can be reached from home.
    pub fn is_reached(&self) -> Vec<bool> {
        let before = self.shortest_ways(HOME);
        before.iter().enumerate().map(|(station, before)| station == HOME || before.is_some()).collect()
    }

    /// All motions, each once.
    pub fn motions(&self) -> impl Iterator<Item = (usize, usize)> {
        let from = self.motions.iter().enumerate();
        from.flat_map(|(from, to)| to.iter().map(move |&(to, _)| (from, to))).filter(|(from, to)| from < to)
    }

    /// For each station the one before it on the shortest way from `from` (Dijkstra 1959).
    fn shortest_ways(&self, from: usize) -> Vec<Option<usize>> {
        let mut before = vec![None; self.motions.len()];
        let mut lengths = vec![f64::INFINITY; self.motions.len()];
        let mut open = BinaryHeap::new();
        if let Some(length) = lengths.get_mut(from) {
            *length = 0.0;
            open.push(Reverse((Length(0.0), from)));
        }
        while let Some(Reverse((Length(length), station))) = open.pop() {
            if length > lengths[station] {
                continue;
            }
            for &(next, turned) in &self.motions[station] {
                if length + turned < lengths[next] {
                    lengths[next] = length + turned;
                    before[next] = Some(station);
                    open.push(Reverse((Length(length + turned), next)));
                }
            }
        }
        before
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Home at 0 and stations 1 to 4 at as many radians.
    fn stations() -> Vec<Joints> {
        (0..5).map(|i| [f64::from(i), 0.0, 0.0, 0.0, 0.0, 0.0]).collect()
    }

    #[test]
    fn the_shortest_free_way_is_taken() {
        let map = Roadmap::new(&stations(), &[1, 2, 3, 4], |_, _| true);
        assert_eq!(map.way(1, 3), Some(vec![2, 3]));
        assert_eq!(map.way(3, HOME), Some(vec![HOME]));
        assert_eq!(map.way(2, 2), Some(vec![]));
        assert_eq!(map.way(2, 9), None);
        assert_eq!(map.motions().count(), 7);
    }

    #[test]
    fn blocked_motions_are_gone_around_and_what_nothing_leads_to_is_not_reached() {
        // Neither from home to 2 nor from 2 to 3, and nothing to 4.
        let is_free = |a: &Joints, b: &Joints| !(b[0] == 4.0 || (a[0], b[0]) == (0.0, 2.0) || a[0] == 2.0);
        let map = Roadmap::new(&stations(), &[1, 2, 3, 4], is_free);
        assert_eq!(map.way(2, 3), Some(vec![1, HOME, 3]));
        assert_eq!(map.way(HOME, 2), Some(vec![1, 2]));
        assert_eq!((map.way(HOME, 4), map.is_reached()), (None, vec![true, true, true, true, false]));
    }
}
