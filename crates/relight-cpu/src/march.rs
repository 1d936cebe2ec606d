//! From rays to samples.
//!
//! A ray is cut into intervals that tile its way through the box; each holds one sample. The last sample is opaque.

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

/// Lengths of the intervals that sorted samples stand for: cut halfway between neighbours, and at `near` and `far`.
pub fn interval_lengths(t: &[f32], (near, far): (f32, f32), lengths: &mut [f32]) {
    let mut start = near;
    for (i, length) in lengths[..t.len()].iter_mut().enumerate() {
        let end = if i + 1 < t.len() { 0.5 * (t[i] + t[i + 1]) } else { far };
        *length = (end - start).max(0.0);
        start = end;
    }
}

/// One sample in each of `t.len()` equal parts of the ray; `jitter(i)` in 0..1 says where in part `i`.
pub fn stratified((near, far): (f32, f32), jitter: impl Fn(usize) -> f32, t: &mut [f32]) {
    let part = (far - near) / t.len() as f32;
    for (i, t) in t.iter_mut().enumerate() {
        *t = near + (i as f32 + jitter(i)) * part;
    }
}

/// Draws `t.len()` sorted samples from a density that is constant on bins: bin `b` ends at `end(b)` and holds
/// `mass[b]`, the first begins at `near`.
pub fn draw(
    mass: &[f32],
    near: f32,
    end: impl Fn(usize) -> f32,
    jitter: impl Fn(usize) -> f32,
    t: &mut [f32],
) {
    let total: f32 = mass.iter().sum();
    let step = total / t.len() as f32;
    let (mut bin, mut before, mut start) = (0, 0.0, near);
    for (i, t) in t.iter_mut().enumerate() {
        let target = (i as f32 + jitter(i)) * step;
        while bin + 1 < mass.len() && before + mass[bin] < target {
            before += mass[bin];
            start = end(bin);
            bin += 1;
        }
        let share = if mass[bin] > 0.0 { ((target - before) / mass[bin]).clamp(0.0, 1.0) } else { 0.5 };
        *t = start + share * (end(bin) - start);
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
        interval_lengths(t, span, &mut lengths);
        assert!(lengths.iter().all(|&l| l >= 0.0), "{lengths:?}");
        let sum: f32 = lengths.iter().sum();
        assert!((sum - (span.1 - span.0)).abs() < 1e-5 * (1.0 + span.1), "{sum} {span:?}");
    }

    proptest! {
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
        let mass = [0.0, 3.0, 0.0, 1.0];
        let mut t = vec![f32::NAN; 400];
        draw(&mass, 2.0, |b| 2.0 + (b as f32 + 1.0) * 0.5, |_| 0.5, &mut t);
        assert_ascends(&t, (2.0, 4.0));
        let within = |lo, hi| t.iter().filter(|t| (lo..hi).contains(*t)).count();
        assert_eq!((within(2.5, 3.0), within(3.5, 4.0)), (300, 100));
        // Evenly inside a bin.
        assert!((t[150] - (2.5 + 0.5 * 150.5 / 300.0)).abs() < 1e-4);
        // Without any mass they are still somewhere on the ray.
        draw(&[0.0; 3], 0.0, |b| b as f32 + 1.0, |_| 0.5, &mut t);
        assert_ascends(&t, (0.0, 3.0));
    }
}
