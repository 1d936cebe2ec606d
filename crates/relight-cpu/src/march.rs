//! From rays to samples.
//!
//! A ray is cut into intervals that tile its way through the box; each holds one sample. The last sample is opaque.

use relight_scene::Bounds;

use crate::density_grid::DensityGrid;

/// Share of guided samples spread evenly, so that what the density grid does not know of is found (training).
const UNIFORM_SHARE: f32 = 0.15;
/// The same when drawing pictures.
const UNIFORM_SHARE_DRAWING: f32 = 0.02;
/// Largest opacity a cell may claim when samples are placed: some must fall behind a surface that may be wrong.
const OPACITY_LIMIT: f32 = 0.5;
/// Optical depth, by the density grid, below which a shadow ray counts as clear.
const SHADING: f32 = 0.05;
/// Cells that a ray looks at, at most; a ray through a cubic box meets fewer.
const MOST_BINS: usize = 2048;
/// Placing ends where less than this of the limited transmittance is left.
const TRANSMITTANCE_END: f32 = 0.01;

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

/// Optical depths of the cells that a ray from `o` along `d`, both in the unit cube, meets in the middle of its `bins`
/// steps of length `step` from `near` on, each with the number of its step. Those of empty bricks are stepped over.
fn optical_depths(
    grid: &DensityGrid,
    (o, d): ([f32; 3], [f32; 3]),
    (near, step, bins): (f32, f32, usize),
) -> impl Iterator<Item = (usize, f32)> {
    let (mut next, crossings, steps_a_metre) = (0, grid.brick_crossings(d), 1.0 / step);
    std::iter::from_fn(move || {
        while next < bins {
            let b = next;
            let unit = along(o, d, near + (b as f32 + 0.5) * step);
            let cell = grid.cell(unit);
            let Some(ahead) = grid.empty_ahead(unit, cell, crossings) else {
                next += 1;
                return Some((b, grid.optical_depth(cell)));
            };
            next = b.saturating_add(((ahead * steps_a_metre) as usize).max(1));
        }
        None
    })
}

/// Whether the density grid knows of nothing between two distances that could shade what lies behind.
pub fn is_clear(
    grid: &DensityGrid,
    cube: &UnitCube,
    (origin, direction): ([f32; 3], [f32; 3]),
    (near, far): (f32, f32),
) -> bool {
    let step = grid.cell_size().max((far - near) / MOST_BINS as f32);
    let stretch = step / grid.cell_size();
    let (o, mut depth) = (cube.map(origin), 0.0);
    let d: [f32; 3] = std::array::from_fn(|a| direction[a] * cube.inverse_extent[a]);
    let bins = ((far - near) / step).ceil() as usize;
    for (_, optical) in optical_depths(grid, (o, d), (near, step, bins)) {
        depth += optical * stretch;
        if depth > SHADING {
            return false;
        }
    }
    true
}

/// Memory for [`guided`], reused from ray to ray.
#[derive(Default)]
pub struct GuideScratch {
    /// Steps at which something may be, ascending, with the chance of a sample there.
    occupied: Vec<(usize, f32)>,
    /// Stretches of the ray, of one such step or of all between two: where each ends, counted in steps.
    ends: Vec<usize>,
    /// The chance of a sample in each.
    mass: Vec<f32>,
}

impl GuideScratch {
    /// Raises the chance of a step: one of the last three, or a new one behind them.
    fn raise(&mut self, step: usize, chance: f32) {
        match self.occupied.iter_mut().rev().take(3).find(|(s, _)| *s == step) {
            Some((_, known)) => *known = known.max(chance),
            None => self.occupied.push((step, chance)),
        }
    }

    /// Divides `steps` steps of a ray into stretches: those of `occupied` with `scale` times their chance, and in every
    /// step `uniform` beside.
    fn divide(&mut self, steps: usize, scale: f32, uniform: f32) {
        let Self { occupied, ends, mass } = self;
        ends.clear();
        mass.clear();
        let mut start = 0;
        for &(step, chance) in &*occupied {
            if step > start {
                ends.push(step);
                mass.push((step - start) as f32 * uniform);
            }
            ends.push(step + 1);
            mass.push(chance * scale + uniform);
            start = step + 1;
        }
        if start < steps {
            ends.push(steps);
            mass.push((steps - start) as f32 * uniform);
        }
    }
}

/// Places samples where the density grid says that something is: `t.len() - 1` of them inside, the last where the
/// ray leaves the box.
pub fn guided(
    grid: &DensityGrid,
    cube: &UnitCube,
    (origin, direction): ([f32; 3], [f32; 3]),
    (near, far): (f32, f32),
    jitter: Option<&dyn Fn(usize) -> f32>,
    scratch: &mut GuideScratch,
    t: &mut [f32],
) {
    let Some((last, t)) = t.split_last_mut() else { return };
    *last = far;
    // Cells as long as the shortest side of the box allows, unless that makes too many of them.
    let step = grid.cell_size().max((far - near) / MOST_BINS as f32);
    let stretch = step / grid.cell_size();
    let bins = (((far - near) / step).ceil() as usize).clamp(1, MOST_BINS);
    scratch.occupied.clear();
    let (o, mut limited, mut depth) = (cube.map(origin), 1f32, 0f32);
    let d: [f32; 3] = std::array::from_fn(|a| direction[a] * cube.inverse_extent[a]);
    for (b, optical) in optical_depths(grid, (o, d), (near, step, bins)) {
        let optical = optical * stretch;
        if optical == 0.0 {
            continue;
        }
        depth += optical;
        let alpha = (1.0 - (-optical).exp()).min(OPACITY_LIMIT);
        // A surface may lie just outside the cell that knows of it.
        for near_by in b.saturating_sub(1)..(b + 2).min(bins) {
            scratch.raise(near_by, limited * alpha);
        }
        limited *= 1.0 - alpha;
        if limited < TRANSMITTANCE_END {
            break;
        }
    }
    let total: f32 = scratch.occupied.iter().map(|(_, chance)| chance).sum();
    let least = if jitter.is_some() { UNIFORM_SHARE } else { UNIFORM_SHARE_DRAWING };
    let uniform = if total > 0.0 { least + (1.0 - least) * (-depth).exp() } else { 1.0 };
    let scale = if total > 0.0 { (1.0 - uniform) / total } else { 0.0 };
    scratch.divide(bins, scale, uniform / bins as f32);
    let end = |stretch: usize| (near + scratch.ends[stretch] as f32 * step).min(far);
    match jitter {
        Some(jitter) => draw(&scratch.mass, near, end, jitter, t),
        None => draw(&scratch.mass, near, end, |_| 0.5, t),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use relight_field::random::Random;

    const BOUNDS: Bounds = Bounds { lo: [-1.0, 0.0, 2.0], hi: [1.0, 0.8, 4.0] };

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

    fn direction() -> impl Strategy<Value = [f32; 3]> {
        let component = || prop_oneof![4 => -1f32..1.0, 1 => Just(0.0), 1 => Just(-0.0)];
        [component(), component(), component()].prop_filter_map("a direction", |d| {
            let norm = d.iter().map(|x| x * x).sum::<f32>().sqrt();
            (norm > 0.1).then(|| d.map(|x| x / norm))
        })
    }

    fn origin() -> impl Strategy<Value = [f32; 3]> {
        [-3f32..3.0, -2f32..3.0, 0f32..6.0]
    }

    /// Density of the background and of some cells.
    fn occupied() -> impl Strategy<Value = (f32, Vec<(usize, f32)>)> {
        let seen = proptest::collection::vec((0usize..4096, 0f32..2000.0), 0..20);
        (prop_oneof![Just(0f32), Just(1.0), Just(1e30)], seen)
    }

    /// Whether distances ascend from `near` to `far`, but for rounding.
    fn assert_ascends(t: &[f32], (near, far): (f32, f32)) {
        let slack = 1e-6 * (1.0 + far);
        assert!(t.iter().all(|t| (near - slack..=far + slack).contains(t)), "{t:?} {near} {far}");
        assert!(t.windows(2).all(|pair| pair[0] <= pair[1] + slack), "{t:?}");
    }

    fn assert_tiles(t: &[f32], span: (f32, f32)) {
        let mut lengths = vec![f32::NAN; t.len()];
        interval_lengths(t, span, &mut lengths);
        assert!(lengths.iter().all(|&l| l >= 0.0), "{lengths:?}");
        let sum: f32 = lengths.iter().sum();
        assert!((sum - (span.1 - span.0)).abs() < 1e-5 * (1.0 + span.1), "{sum} {span:?}");
    }

    /// [`is_clear`], looking at every cell.
    fn is_clear_cell_by_cell(
        grid: &DensityGrid,
        cube: &UnitCube,
        ray: ([f32; 3], [f32; 3]),
        span: (f32, f32),
    ) -> bool {
        let (step, o) = (grid.cell_size(), cube.map(ray.0));
        let d = std::array::from_fn(|a| ray.1[a] * cube.inverse_extent[a]);
        let bins = ((span.1 - span.0) / step).ceil() as usize;
        let place = |b: usize| along(o, d, span.0 + (b as f32 + 0.5) * step);
        (0..bins).map(|b| grid.optical_depth(grid.cell(place(b)))).sum::<f32>() <= SHADING
    }

    proptest! {
        #[test]
        fn empty_bricks_are_stepped_over_and_no_others(
            origin in origin(), direction in direction(),
            occupied in proptest::collection::vec(0usize..4096, 0..40), density in 0.1f32..10.0,
        ) {
            let cube = UnitCube::new(&BOUNDS);
            let mut grid = DensityGrid::uniform(&BOUNDS, 16, 0.0);
            occupied.iter().for_each(|&cell| grid.observe(cell, density));
            let (ray, span) = ((origin, direction), cube.clip(origin, direction));
            let plain = is_clear_cell_by_cell(&grid, &cube, ray, span);
            prop_assert_eq!(is_clear(&grid, &cube, ray, span), plain);
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

        #[test]
        fn guided_samples_ascend_inside_the_box_and_their_lengths_tile_it(
            (background, seen) in occupied(), origin in origin(), direction in direction(),
            n in 2usize..64, seed in proptest::option::of(any::<u64>()),
        ) {
            let mut grid = DensityGrid::uniform(&BOUNDS, 16, background);
            seen.into_iter().for_each(|(cell, density)| grid.observe(cell, density));
            let cube = UnitCube::new(&BOUNDS);
            let span = cube.clip(origin, direction);
            let mut t = vec![f32::NAN; n];
            let jitter = seed.map(|seed| move |i: usize| Random::new(seed, 0).uniform_at(i as u64));
            let jitter = jitter.as_ref().map(|j| j as &dyn Fn(usize) -> f32);
            guided(&grid, &cube, (origin, direction), span, jitter, &mut GuideScratch::default(), &mut t);
            assert_ascends(&t, span);
            prop_assert_eq!(t[n - 1], span.1);
            assert_tiles(&t, span);
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

    /// A long box has more cells on a ray than are looked at, and samples must reach its end all the same.
    #[test]
    fn guided_samples_reach_the_end_of_a_long_box() {
        let bounds = Bounds { lo: [0.0; 3], hi: [0.1, 0.1, 30.0] };
        let cube = UnitCube::new(&bounds);
        for density in [0.0, 0.1] {
            let grid = DensityGrid::uniform(&bounds, 16, density);
            let (ray, span) = (([0.05, 0.05, -1.0], [0.0, 0.0, 1.0]), (1.0, 31.0));
            let mut t = vec![f32::NAN; 61];
            guided(&grid, &cube, ray, span, None, &mut GuideScratch::default(), &mut t);
            let ends = (t[0], t[59]);
            assert!(ends.0 < 2.0 && ends.1 > 30.0 && ends.1 <= 31.0, "density {density}: {ends:?}");
        }
    }

    /// Drawing a picture of a dense slab: nearly all samples lie in its cells or in those beside them. Training
    /// spares some for the rest of the ray.
    #[test]
    fn guided_samples_gather_at_a_dense_slab() {
        let cube = UnitCube::new(&BOUNDS);
        let mut grid = DensityGrid::uniform(&BOUNDS, 64, 0.0);
        for i in 0..64 * 64 {
            let cell = grid.cell([(i % 64) as f32 / 64.0, (i / 64) as f32 / 64.0, 0.5]);
            grid.observe(cell, 500.0);
        }
        let ray = ([0.1, 0.3, 0.0], [0.0, 0.0, 1.0]);
        let near_slab = |jitter: Option<&dyn Fn(usize) -> f32>| {
            let mut t = vec![f32::NAN; 101];
            guided(&grid, &cube, ray, (2.0, 4.0), jitter, &mut GuideScratch::default(), &mut t);
            // The slab fills 3.0 to 3.03 m.
            t[..100].iter().filter(|t| (2.95..3.1).contains(*t)).count()
        };
        let random = Random::new(0, 0);
        assert!(near_slab(None) >= 95);
        assert!((75..95).contains(&near_slab(Some(&|i| random.uniform_at(i as u64)))));
    }
}
