//! Capsules, and distances between the shapes of a cell.

use glam::{DAffine3, DVec3};

/// All points within a radius of a segment, metres.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Capsule {
    /// One end of the segment.
    pub start: [f64; 3],
    /// The other.
    pub end: [f64; 3],
    /// How far the surface is from the segment.
    pub radius: f64,
}

impl Capsule {
    /// A capsule around the segment between two points.
    pub const fn new(start: [f64; 3], end: [f64; 3], radius: f64) -> Self {
        Self { start, end, radius }
    }

    pub(super) fn is_sound(&self) -> bool {
        let ends = self.start.iter().chain(&self.end);
        ends.into_iter().all(|c| c.is_finite()) && self.radius.is_finite() && self.radius > 0.0
    }

    pub(super) fn segment(&self, frame: &DAffine3) -> Segment {
        Segment {
            start: frame.transform_point3(DVec3::from_array(self.start)),
            end: frame.transform_point3(DVec3::from_array(self.end)),
        }
    }
}

/// A segment in the world.
#[derive(Clone, Copy, Debug)]
pub(super) struct Segment {
    pub start: DVec3,
    pub end: DVec3,
}

impl Segment {
    fn at(&self, t: f64) -> DVec3 {
        self.start + t * (self.end - self.start)
    }

    /// Where along the segment (0 to 1) it is nearest to a point.
    fn nearest(&self, point: DVec3) -> f64 {
        let along = self.end - self.start;
        let square = along.length_squared();
        if square > 0.0 { ((point - self.start).dot(along) / square).clamp(0.0, 1.0) } else { 0.0 }
    }

    /// Distance between two segments.
    pub fn distance(&self, other: &Segment) -> f64 {
        // Nearest points are an end of one and a point of the other, or, if the segments pass each other, the feet of their
        // common perpendicular. All are candidates: that needs no cases for parallel or empty segments.
        let ends = [
            self.at(self.nearest(other.start)).distance(other.start),
            self.at(self.nearest(other.end)).distance(other.end),
            other.at(other.nearest(self.start)).distance(self.start),
            other.at(other.nearest(self.end)).distance(self.end),
        ];
        let (a, b) = (self.end - self.start, other.end - other.start);
        let offset = other.start - self.start;
        let normal = a.cross(b);
        let square = normal.length_squared();
        let (s, t) = (offset.cross(b).dot(normal), offset.cross(a).dot(normal));
        // Of segments that are nearly parallel an end is as near, and the common perpendicular is all rounding.
        let parallel = square <= 1e-16 * a.length_squared() * b.length_squared();
        let passing = !parallel && (0.0..=square).contains(&s) && (0.0..=square).contains(&t);
        let perpendicular = if passing { offset.dot(normal).abs() / square.sqrt() } else { f64::INFINITY };
        ends.into_iter().fold(perpendicular, f64::min)
    }

    /// Height of the lower end over a horizontal plane.
    pub fn height_over(&self, plane: f64) -> f64 {
        self.start.z.min(self.end.z) - plane
    }

    /// Distance to an axis-aligned box; zero inside.
    pub fn distance_to_box(&self, lo: DVec3, hi: DVec3) -> f64 {
        let along = self.end - self.start;
        let outside = |t: f64| self.at(t) - self.at(t).clamp(lo, hi);
        // The squared distance is convex, its slope linear between the places where a face's plane is crossed.
        let slope = |t: f64| outside(t).dot(along);
        let mut turns = [1.0; 6];
        for (i, turn) in turns.iter_mut().enumerate() {
            let face = if i < 3 { lo[i] } else { hi[i - 3] };
            let crossing = (face - self.start[i % 3]) / along[i % 3];
            if (0.0..1.0).contains(&crossing) {
                *turn = crossing;
            }
        }
        turns.sort_by(f64::total_cmp);
        let (mut before, mut slope_before) = (0.0, slope(0.0));
        if slope_before >= 0.0 {
            return outside(0.0).length();
        }
        for t in turns.into_iter().chain([1.0]) {
            let slope_here = slope(t);
            if slope_here >= 0.0 {
                let lowest = before + (t - before) * slope_before / (slope_before - slope_here);
                return outside(lowest).length();
            }
            (before, slope_before) = (t, slope_here);
        }
        outside(1.0).length()
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    const STEPS: usize = 200;

    fn point() -> impl Strategy<Value = DVec3> {
        // Few values, so that parallel, touching and empty segments are drawn too.
        let coordinate = prop_oneof![(-2i32..3).prop_map(f64::from), -2.0..2.0f64];
        [coordinate.clone(), coordinate.clone(), coordinate].prop_map(DVec3::from_array)
    }

    fn segment() -> impl Strategy<Value = Segment> {
        (point(), point()).prop_map(|(start, end)| Segment { start, end })
    }

    fn samples(segment: Segment) -> impl Iterator<Item = DVec3> {
        (0..=STEPS).map(move |i| segment.at(i as f64 / STEPS as f64))
    }

    proptest! {
        #[test]
        fn distances_between_segments_are_those_of_dense_points(a in segment(), b in segment()) {
            let points: Vec<DVec3> = samples(b).collect();
            let dense = samples(a).flat_map(|p| points.iter().map(move |q| p.distance(*q))).fold(f64::MAX, f64::min);
            let step = (a.start.distance(a.end) + b.start.distance(b.end)) / STEPS as f64;
            let exact = a.distance(&b);
            prop_assert!(exact <= dense + 1e-12 && dense <= exact + step, "{exact} {dense}");
        }

        #[test]
        fn distances_to_a_box_are_those_of_dense_points(a in segment(), corner in point(), size in point()) {
            let (lo, hi) = (corner, corner + size.abs());
            let dense = samples(a).map(|p| p.distance(p.clamp(lo, hi))).fold(f64::MAX, f64::min);
            let exact = a.distance_to_box(lo, hi);
            prop_assert!(exact <= dense + 1e-12, "{exact} {dense}");
            prop_assert!(dense <= exact + a.start.distance(a.end) / STEPS as f64, "{exact} {dense}");
        }
    }
}
