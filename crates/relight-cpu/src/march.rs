//! From rays to samples.
//!
//! A ray is cut into intervals, each around one sample, that tile its way through the box, or through what may be filled of it. The last
//! sample is opaque.

use relight_scene::Bounds;

/// Maps the world box to the unit cube.
#[derive(Clone, Copy, Debug)]
pub struct UnitCube {
    lo: [f32; 3],
    inverse_extent: [f32; 3],
    /// Longest edge of the box, metres.
    pub edge: f32,
}

impl UnitCube {
    /// The cube of a box.
    pub fn new(bounds: &Bounds) -> Self {
        let extent: [f32; 3] = std::array::from_fn(|a| bounds.hi[a] - bounds.lo[a]);
        Self {
            lo: bounds.lo,
            inverse_extent: extent.map(|e| 1.0 / e),
            edge: extent.into_iter().fold(0.0, f32::max),
        }
    }

    /// World position to unit cube.
    pub fn map(&self, p: [f32; 3]) -> [f32; 3] {
        std::array::from_fn(|a| (p[a] - self.lo[a]) * self.inverse_extent[a])
    }

    /// World direction to unit cube.
    pub fn map_direction(&self, d: [f32; 3]) -> [f32; 3] {
        std::array::from_fn(|a| d[a] * self.inverse_extent[a])
    }

    /// Unit cube to world position.
    pub fn unmap(&self, u: [f32; 3]) -> [f32; 3] {
        std::array::from_fn(|a| self.lo[a] + u[a] / self.inverse_extent[a])
    }

    /// Distances along a ray at which it enters and leaves the box; the same number twice where it misses.
    pub fn clip(&self, origin: [f32; 3], direction: [f32; 3]) -> (f32, f32) {
        let (mut near, mut far) = (0f32, f32::INFINITY);
        let (o, d) = (self.map(origin), direction);
        for a in 0..3 {
            if d[a] == 0.0 {
                // Parallel to these faces: between them all the way, or never.
                if !(0.0..=1.0).contains(&o[a]) {
                    far = 0.0;
                }
                continue;
            }
            let inverse = 1.0 / (d[a] * self.inverse_extent[a]);
            let (t0, t1) = ((0.0 - o[a]) * inverse, (1.0 - o[a]) * inverse);
            near = near.max(t0.min(t1));
            far = far.min(t0.max(t1));
        }
        if far > near && far.is_finite() { (near, far) } else { (near.min(1e3), near.min(1e3)) }
    }
}

/// `origin + t * direction`.
pub fn along(origin: [f32; 3], direction: [f32; 3], t: f32) -> [f32; 3] {
    std::array::from_fn(|a| t * direction[a] + origin[a])
}

/// Lengths of the intervals that sorted samples stand for: cut halfway between neighbours, and at `near` and `far`; but on neither side
/// does sample `i` reach further than `reach(i)`.
pub fn interval_lengths(
    t: &[f32],
    (near, far): (f32, f32),
    reach: impl Fn(usize) -> f32,
    lengths: &mut [f32],
) {
    let mut before = t.first().map_or(0.0, |first| first - near);
    for (i, length) in lengths[..t.len()].iter_mut().enumerate() {
        let after = t.get(i + 1).map_or(far - t[i], |next| 0.5 * (next - t[i]));
        *length = (before.min(reach(i)) + after.min(reach(i))).max(0.0);
        before = after;
    }
}

/// One sample in each of `t.len()` equal parts of the ray; `jitter(i)` in 0..1 says where in part `i`.
pub fn stratified((near, far): (f32, f32), jitter: impl Fn(usize) -> f32, t: &mut [f32]) {
    let part = (far - near) / t.len() as f32;
    for (i, t) in t.iter_mut().enumerate() {
        *t = near + (i as f32 + jitter(i)) * part;
    }
}

/// Draws `n` samples, ascending, from a density that is constant on bins: bin `b` ends at `end(b)` and holds `mass[b]`, the first begins
/// at `near`. `put(i, t, apart)` is told where sample `i` is, and how far samples are apart where the density is as there.
pub fn draw(
    mass: &[f32],
    near: f32,
    end: impl Fn(usize) -> f32,
    jitter: impl Fn(usize) -> f32,
    n: usize,
    mut put: impl FnMut(usize, f32, f32),
) {
    let total: f32 = mass.iter().sum();
    let step = total / n as f32;
    let (mut bin, mut before, mut start) = (0, 0.0, near);
    for i in 0..n {
        let target = (i as f32 + jitter(i)) * step;
        while bin + 1 < mass.len() && before + mass[bin] < target {
            before += mass[bin];
            start = end(bin);
            bin += 1;
        }
        let (length, here) = (end(bin) - start, mass[bin]);
        if here > 0.0 {
            let scale = length / here;
            put(i, start + (target - before).clamp(0.0, here) * scale, scale * step);
        } else {
            put(i, start + 0.5 * length, length);
        }
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use proptest::prelude::*;
    use relight_field::random::Random;

    pub(crate) const BOUNDS: Bounds = Bounds { lo: [-1.0, 0.0, 2.0], hi: [1.0, 0.8, 4.0] };

    /// The stretch of a ray inside [`BOUNDS`], in double precision and with slabs that it runs along taken for what
    /// they are; `None` where it misses.
    fn slabs(origin: [f32; 3], direction: [f32; 3]) -> Option<(f64, f64)> {
        let (mut near, mut far) = (0f64, f64::INFINITY);
        for a in 0..3 {
            let [lo, hi, o, d] = [BOUNDS.lo[a], BOUNDS.hi[a], origin[a], direction[a]].map(f64::from);
            if d == 0.0 {
                if !(lo..=hi).contains(&o) {
                    return None;
                }
                continue;
            }
            let (t0, t1) = ((lo - o) / d, (hi - o) / d);
            near = near.max(t0.min(t1));
            far = far.min(t0.max(t1));
        }
        (near < far).then_some((near, far))
    }

    fn assert_clips(origin: [f32; 3], direction: [f32; 3]) {
        let (near, far) = UnitCube::new(&BOUNDS).clip(origin, direction);
        assert!(near.is_finite() && far.is_finite() && 0.0 <= near && near <= far, "{near} {far}");
        let (ours, plain) = (f64::from(far - near), slabs(origin, direction));
        match plain {
            Some((n, f)) if f - n > 1e-3 => {
                let errors = ((f64::from(near) - n).abs(), (f64::from(far) - f).abs());
                assert!(errors.0 < 1e-4 && errors.1 < 1e-4, "({near}, {far}) is not {plain:?}");
            }
            // A ray that grazes an edge may be counted either way.
            Some(_) => assert!(ours < 2e-3),
            None => assert!(ours < 1e-3, "({near}, {far}), but the ray misses"),
        }
    }

    pub(crate) fn direction() -> impl Strategy<Value = [f32; 3]> {
        let component = || prop_oneof![4 => -1f32..1.0, 1 => Just(0.0), 1 => Just(-0.0)];
        [component(), component(), component()].prop_filter_map("a direction", |d| {
            let norm = d.iter().map(|x| x * x).sum::<f32>().sqrt();
            (norm > 0.1).then(|| d.map(|x| x / norm))
        })
    }

    pub(crate) fn origin() -> impl Strategy<Value = [f32; 3]> {
        [-3f32..3.0, -2f32..3.0, 0f32..6.0]
    }

    /// Whether distances ascend from `near` to `far`, but for rounding.
    pub(crate) fn assert_ascends(t: &[f32], (near, far): (f32, f32)) {
        let slack = 1e-6 * (1.0 + far);
        assert!(t.iter().all(|t| (near - slack..=far + slack).contains(t)), "{t:?} {near} {far}");
        assert!(t.windows(2).all(|pair| pair[0] <= pair[1] + slack), "{t:?}");
    }

    pub(crate) fn assert_tiles(t: &[f32], span: (f32, f32)) {
        let mut lengths = vec![f32::NAN; t.len()];
        interval_lengths(t, span, |_| f32::INFINITY, &mut lengths);
        assert!(lengths.iter().all(|&l| l >= 0.0), "{lengths:?}");
        let sum: f32 = lengths.iter().sum();
        assert!((sum - (span.1 - span.0)).abs() < 1e-5 * (1.0 + span.1), "{sum} {span:?}");
    }

    proptest! {
        #[test]
        fn samples_stand_for_what_lies_halfway_to_their_neighbours_and_within_reach(
            samples in proptest::collection::vec((0.1f32..2.0, 0f32..0.3), 1..20),
        ) {
            let (mut t, reach): (Vec<f32>, Vec<f32>) = samples.into_iter().unzip();
            t.sort_by(f32::total_cmp);
            let mut lengths = vec![f32::NAN; t.len()];
            interval_lengths(&t, (0.0, 2.1), |i| reach[i], &mut lengths);
            for (i, &length) in lengths.iter().enumerate() {
                let before = if i == 0 { t[0] } else { 0.5 * (t[i] - t[i - 1]) };
                let after = t.get(i + 1).map_or(2.1 - t[i], |next| 0.5 * (next - t[i]));
                prop_assert!((length - before.min(reach[i]) - after.min(reach[i])).abs() < 1e-6);
            }
        }

        #[test]
        fn rays_are_clipped_to_the_box(origin in origin(), direction in direction()) {
            assert_clips(origin, direction);
        }

        #[test]
        fn rays_from_inside_start_at_once(share in [0.01f32..0.99, 0.01f32..0.99, 0.01f32..0.99], direction in direction()) {
            let cube = UnitCube::new(&BOUNDS);
            let origin = cube.unmap(share);
            assert_clips(origin, direction);
            prop_assert_eq!(cube.clip(origin, direction).0, 0.0);
            let back = cube.map(origin);
            prop_assert!((0..3).all(|a| (back[a] - share[a]).abs() < 1e-6));
        }

        #[test]
        fn stratified_samples_lie_each_in_its_part(
            near in 0f32..5.0, length in 0f32..3.0, n in 1usize..40, seed in any::<u64>(),
        ) {
            let (far, random) = (near + length, Random::new(seed, 0));
            let mut t = vec![f32::NAN; n];
            stratified((near, far), |i| random.uniform_at(i as u64), &mut t);
            for (i, &t) in t.iter().enumerate() {
                let part = |i: usize| near + length * i as f32 / n as f32;
                prop_assert!((part(i) - 1e-5..=part(i + 1) + 1e-5).contains(&t));
            }
            assert_tiles(&t, (near, far));
        }

    }

    #[test]
    fn rays_parallel_to_axes_pass_between_the_faces_or_miss() {
        for zero in [0.0, -0.0] {
            assert_clips([0.1, 0.3, 0.0], [zero, zero, 1.0]);
            assert_clips([0.1, 0.3, 3.0], [zero, zero, -1.0]);
            assert_clips([5.0, 0.3, 0.0], [zero, zero, 1.0]);
            assert_clips([0.1, 0.3, 5.0], [zero, zero, 1.0]);
            assert_clips([-2.0, 0.3, 3.5], [1.0, zero, zero]);
            assert_clips([-2.0, 3.0, 3.5], [1.0, zero, zero]);
        }
    }

    #[test]
    fn rays_along_a_face_stay_in_the_box() {
        for zero in [0.0, -0.0] {
            assert_clips([-1.0, 0.3, 0.0], [zero, zero, 1.0]);
            assert_clips([1.0, 0.3, 0.0], [zero, zero, 1.0]);
            assert_clips([0.5, 2.0, 4.0], [zero, -1.0, zero]);
            assert_clips([-1.0, 0.8, 0.0], [zero, zero, 1.0]);
        }
    }

    #[test]
    fn rays_that_are_nowhere_are_harmless() {
        let cube = UnitCube::new(&BOUNDS);
        for (origin, direction) in [
            ([f32::NAN; 3], [0.0, 0.0, 1.0]),
            ([0.0; 3], [f32::NAN; 3]),
            ([0.0, 0.1, 3.0], [0.0; 3]),
            ([f32::INFINITY; 3], [0.0, 1.0, 0.0]),
            ([1e30, 0.0, 0.0], [-1.0, 0.0, 0.0]),
        ] {
            let (near, far) = cube.clip(origin, direction);
            assert!(near.is_finite() && near <= far && far.is_finite(), "{near} {far}");
        }
    }

    #[test]
    fn draws_follow_the_mass() {
        let (mut t, mut apart) = (vec![f32::NAN; 400], vec![f32::NAN; 400]);
        let mass = [0.0, 3.0, 0.0, 1.0];
        let mut put = |i: usize, at, distance| (t[i], apart[i]) = (at, distance);
        draw(&mass, 2.0, |b| 2.0 + (b as f32 + 1.0) * 0.5, |_| 0.5, 400, &mut put);
        assert_ascends(&t, (2.0, 4.0));
        let within = |lo, hi| t.iter().filter(|t| (lo..hi).contains(*t)).count();
        assert_eq!((within(2.5, 3.0), within(3.5, 4.0)), (300, 100));
        // Evenly inside a bin.
        assert!((t[150] - (2.5 + 0.5 * 150.5 / 300.0)).abs() < 1e-4);
        assert!((0..300).all(|i| (apart[i] - 0.5 / 300.0).abs() < 1e-6));
        assert!((300..400).all(|i| (apart[i] - 0.5 / 100.0).abs() < 1e-6));
        // Without any mass they are still somewhere on the ray.
        draw(&[0.0; 3], 0.0, |b| b as f32 + 1.0, |_| 0.5, 400, |i, at, _| t[i] = at);
        assert_ascends(&t, (0.0, 3.0));
    }
}
