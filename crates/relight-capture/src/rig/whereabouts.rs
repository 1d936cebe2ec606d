//! Where along the planned motions an arm stands.

use super::itinerary::Itinerary;
use crate::kinematics::Joints;

/// How near to a planned place an arm must be measured, radians: as near as a motion asks for that begins there.
pub(super) const NEAR: f64 = 5e-3;

/// Where an arm stands.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Whereabouts {
    /// At a station.
    At(usize),
    /// Somewhere along a planned motion that was interrupted.
    Between {
        /// Where.
        joints: Joints,
        /// The nearer end of the motion.
        nearest: usize,
    },
}

/// Where an arm stands along the motions that are free for it while the other stands at station `beside`; none if it is
/// elsewhere.
pub fn locate(itinerary: &Itinerary, arm: usize, beside: usize, joints: &Joints) -> Option<Whereabouts> {
    let map = itinerary.roadmap(arm, beside)?;
    let is_reached = map.is_reached();
    let at = |station: usize| itinerary.joints(arm, station);
    let stations = 0..itinerary.stations(arm).len();
    let here = stations.filter(|&station| is_reached.get(station) == Some(&true));
    let near = here.map(|station| (station, distance(joints, at(station)))).filter(|(_, d)| *d <= NEAR);
    if let Some((station, _)) = near.min_by(|a, b| a.1.total_cmp(&b.1)) {
        return Some(Whereabouts::At(station));
    }
    let off = |&(from, to): &(usize, usize)| {
        let (a, b) = (at(from), at(to));
        let part = fraction(joints, a, b);
        (distance(joints, &std::array::from_fn(|i| a[i] + part * (b[i] - a[i]))), part)
    };
    let motions = map.motions().filter(|(from, _)| is_reached.get(*from) == Some(&true));
    let passed = motions.map(|motion| (motion, off(&motion))).filter(|(_, (off, _))| *off <= NEAR);
    let ((from, to), (_, part)) = passed.min_by(|a, b| a.1.0.total_cmp(&b.1.0))?;
    Some(Whereabouts::Between { joints: *joints, nearest: if part < 0.5 { from } else { to } })
}

/// The largest difference of a joint, radians; endless if one is not a number.
fn distance(a: &Joints, b: &Joints) -> f64 {
    let differences = a.iter().zip(b).map(|(a, b)| (a - b).abs());
    differences.fold(0.0, |largest, d| if d.is_nan() { f64::INFINITY } else { largest.max(d) })
}

/// How far along the straight line from `a` to `b` the point next to `joints` lies, 0 to 1.
fn fraction(joints: &Joints, a: &Joints, b: &Joints) -> f64 {
    let (mut along, mut length) = (0.0, 0.0);
    for i in 0..6 {
        along += (joints[i] - a[i]) * (b[i] - a[i]);
        length += (b[i] - a[i]) * (b[i] - a[i]);
    }
    if length > 0.0 { (along / length).clamp(0.0, 1.0) } else { 0.0 }
}
