//! What the density grid tells rays: where samples are worth placing, and whether anything is in the way.
//!
//! A ray looks at the grid in steps of a cell. Bricks in which nothing is are stepped over.

use fearless_simd::Level;

use crate::density_grid::DensityGrid;
use crate::march::UnitCube;
use crate::placing::{Found, Places, Placing, Stretches, opacity};
use crate::walk::{LANES, Walker, Way, walk};

/// Optical depth, by the density grid, below which a shadow ray counts as clear.
const SHADING: f32 = 0.05;
/// Cells that a ray looks at, at most; a ray through a cubic box meets fewer.
const MOST_BINS: usize = 2048;
/// Steps of nothing, or haze, behind one at which something is, that are a void.
const VOID: usize = 3;

/// A ray: its origin and unit direction, metres.
pub type Ray = ([f32; 3], [f32; 3]);
/// Two distances along a ray, metres.
pub type Span = (f32, f32);

/// What the density grid tells rays.
#[derive(Clone, Copy)]
pub struct Guide<'a> {
    /// Instruction set.
    pub simd: Level,
    /// The grid.
    pub density: &'a DensityGrid,
    /// Its box.
    pub cube: UnitCube,
}

/// Memory for [`Guide::guided`], reused from rays to rays.
#[derive(Default)]
pub struct GuideScratch {
    ways: Vec<Way>,
    /// Of each ray, where it leaves the box.
    far: Vec<f32>,
    lanes: [Found; LANES],
    stretches: Stretches,
}

/// Rays that find places for samples.
struct Finder<'a, F> {
    placing: &'a Placing,
    /// Optical depth from which on a cell claims all that it may.
    saturated: f32,
    cell_size: f32,
    ways: &'a [Way],
    far: &'a [f32],
    lanes: &'a mut [Found; LANES],
    stretches: &'a mut Stretches,
    one: F,
}

impl<F: FnMut(usize, Places<'_>)> Walker for Finder<'_, F> {
    #[inline(always)]
    fn begin(&mut self, lane: usize, way: usize) {
        let (found, Way { step, steps, .. }) = (&mut self.lanes[lane], self.ways[way]);
        (found.way, found.steps, found.stretch) = (way, steps, step / self.cell_size);
        (found.limited, found.depth) = (1.0, 0.0);
        found.occupied.clear();
    }

    #[inline(always)]
    fn meet(&mut self, lane: usize, step: usize, optical: f32) -> bool {
        if optical < self.placing.haze {
            return true;
        }
        let (found, limit) = (&mut self.lanes[lane], self.placing.opacity_limit);
        let behind = found.occupied.last().map_or(step, |&(raised, _)| raised);
        if step > behind + VOID && self.placing.look.is_some_and(|look| found.limited < look) {
            found.steps = behind + 1;
            return false;
        }
        let optical = optical * found.stretch;
        found.depth += optical;
        let alpha = if optical < self.saturated { opacity(optical) } else { limit };
        found.raise(step, found.limited * alpha);
        found.limited *= 1.0 - alpha;
        let goes_on = found.limited >= self.placing.end;
        if !goes_on && self.placing.look.is_some() {
            found.steps = found.steps.min(step + 2);
        }
        goes_on
    }

    #[inline(always)]
    fn end(&mut self, lane: usize) {
        let found = &self.lanes[lane];
        let (Way { near, step, steps, .. }, far) = (self.ways[found.way], self.far[found.way]);
        let leaves = found.steps == steps;
        found.divide(self.placing.uniform_share, self.stretches);
        let end = if leaves { far } else { (near + found.steps as f32 * step).min(far) };
        (self.one)(found.way, Places { stretches: self.stretches, near, step, end, leaves });
    }
}

/// Shadow rays that find whether anything is in their way.
struct Clear<'a> {
    cell_size: f32,
    ways: &'a [Way],
    lanes: [usize; LANES],
    depths: &'a mut [f32],
}

impl Walker for Clear<'_> {
    #[inline(always)]
    fn begin(&mut self, lane: usize, way: usize) {
        self.lanes[lane] = way;
    }

    #[inline(always)]
    fn meet(&mut self, lane: usize, _: usize, optical: f32) -> bool {
        let way = self.lanes[lane];
        self.depths[way] += optical * (self.ways[way].step / self.cell_size);
        self.depths[way] <= SHADING
    }

    #[inline(always)]
    fn end(&mut self, _: usize) {}
}

impl Guide<'_> {
    /// Whether the density grid knows of nothing, between two distances along each ray, that could shade what lies behind.
    pub fn are_clear(&self, rays: impl Iterator<Item = (Ray, Span)>) -> impl Iterator<Item = bool> {
        let ways: Vec<Way> = rays.map(|(ray, span)| self.way(ray, span)).collect();
        let (mut depths, cell_size) = (vec![0f32; ways.len()], self.density.cell_size());
        let mut clear = Clear { cell_size, ways: &ways, lanes: [0; LANES], depths: &mut depths };
        walk(self.simd, self.density, &ways, &mut clear);
        depths.into_iter().map(|depth| depth <= SHADING)
    }

    /// Finds where samples are worth placing along rays, between two distances each, and tells `one` of each ray, in no order: its
    /// number, and its places.
    pub fn guided(
        &self,
        placing: &Placing,
        rays: impl Iterator<Item = (Ray, Span)>,
        scratch: &mut GuideScratch,
        one: impl FnMut(usize, Places<'_>),
    ) {
        let GuideScratch { ways, far, lanes, stretches } = scratch;
        ways.clear();
        far.clear();
        for (ray, span) in rays {
            let way = self.way(ray, span);
            ways.push(Way { steps: way.steps.max(1), ..way });
            far.push(span.1);
        }
        let (saturated, cell_size) = (-(1.0 - placing.opacity_limit).ln(), self.density.cell_size());
        debug_assert!(saturated < 0.7, "`opacity` is not made for that");
        let mut finder = Finder { placing, saturated, cell_size, ways, far, lanes, stretches, one };
        walk(self.simd, self.density, ways, &mut finder);
    }

    /// A ray's way, in steps as long as the shortest edge of a cell, unless that makes too many of them.
    fn way(&self, (origin, direction): Ray, (near, far): Span) -> Way {
        let step = self.density.cell_size().max((far - near) / MOST_BINS as f32);
        Way {
            origin: self.cube.map(origin),
            direction: self.cube.map_direction(direction),
            near,
            step,
            steps: ((far - near) / step).ceil() as usize,
        }
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use std::iter;

    use super::*;
    use crate::march::draw;
    use crate::march::tests::{BOUNDS, assert_ascends, assert_tiles, direction, origin};
    use crate::placing::{KNOWING, SEARCHING};
    use crate::walk::tests::{aimed, grid_of, step_by_step};
    use proptest::prelude::*;
    use relight_field::random::Random;
    use relight_scene::Bounds;

    pub(crate) fn guide<'a>(density: &'a DensityGrid, &cube: &UnitCube) -> Guide<'a> {
        Guide { simd: Level::new(), density, cube }
    }

    /// Samples of one ray.
    pub(crate) fn place(
        guide: Guide<'_>,
        placing: &Placing,
        ray: Ray,
        span: Span,
        jitter: Option<&dyn Fn(usize) -> f32>,
        t: &mut [f32],
    ) {
        let mut placed = 0;
        guide.guided(placing, iter::once((ray, span)), &mut GuideScratch::default(), |i, places| {
            assert_eq!(i, 0);
            placed += 1;
            let mut apart = vec![f32::NAN; t.len()];
            places.draw(|k| jitter.map_or(0.5, |jitter| jitter(k)), t, &mut apart);
            assert!(apart.iter().all(|&a| a >= 0.0), "{apart:?}");
        });
        assert_eq!(placed, 1);
    }

    /// A way of placing samples all along a ray.
    fn placing() -> impl Strategy<Value = &'static Placing> {
        prop_oneof![Just(&SEARCHING), Just(&KNOWING)]
    }

    /// Density of the background and of some cells.
    fn occupied() -> impl Strategy<Value = (f32, Vec<(usize, f32)>)> {
        let seen = proptest::collection::vec((0usize..4096, 0f32..2000.0), 0..20);
        (prop_oneof![Just(0f32), Just(1.0), Just(1e30)], seen)
    }

    /// [`Guide::are_clear`] of a ray, looking at every cell.
    fn is_clear_cell_by_cell(grid: &DensityGrid, cube: &UnitCube, ray: Ray, span: Span) -> bool {
        let steps = ((span.1 - span.0) / grid.cell_size()).ceil() as usize;
        let ray = (cube.map(ray.0), cube.map_direction(ray.1));
        step_by_step(grid, ray, (span.0, grid.cell_size(), steps)).sum::<f32>() <= SHADING
    }

    /// [`Guide::guided`], with every step an entry of the distribution, and the middle of each part drawn.
    fn guided_step_by_step(
        grid: &DensityGrid,
        cube: &UnitCube,
        placing: &Placing,
        (origin, direction): Ray,
        (near, far): Span,
        t: &mut [f32],
    ) {
        let (step, o) = (grid.cell_size(), cube.map(origin));
        let d = cube.map_direction(direction);
        let bins = (((far - near) / step).ceil() as usize).max(1);
        let (mut weight, mut limited, mut depth) = (vec![0f32; bins + 2], 1.0, 0f32);
        for (b, optical) in step_by_step(grid, (o, d), (near, step, bins)).enumerate() {
            let alpha = (1.0 - (-optical).exp()).min(placing.opacity_limit);
            depth += optical;
            weight[b + 1] = limited * alpha;
            limited *= 1.0 - alpha;
            if limited < placing.end {
                break;
            }
        }
        let mut mass: Vec<f32> = weight.windows(3).map(|w| w[0].max(w[1]).max(w[2])).collect();
        let total: f32 = mass.iter().sum();
        let share = if total > 0.0 {
            placing.uniform_share + (1.0 - placing.uniform_share) * (-depth).exp()
        } else {
            1.0
        };
        let scale = if total > 0.0 { (1.0 - share) / total } else { 0.0 };
        mass.iter_mut().for_each(|m| *m = *m * scale + share / bins as f32);
        let (last, t) = t.split_last_mut().unwrap();
        *last = far;
        draw(
            &mass,
            near,
            |b| (near + (b as f32 + 1.0) * step).min(far),
            |_| 0.5,
            t.len(),
            |i, at, _| t[i] = at,
        );
    }

    proptest! {
        #[test]
        fn stretches_place_samples_as_single_steps_do(
            origin in origin(), direction in direction(), density in 0.1f32..100.0,
            occupied in proptest::collection::vec(0usize..64 * 64 * 64, 0..1000), placing in placing(),
        ) {
            let cube = UnitCube::new(&BOUNDS);
            let grid = DensityGrid::uniform(&BOUNDS, 64, 0.0);
            // Densities of all kinds beside each other.
            occupied.iter().for_each(|&cell| grid.observe(cell, density * (1 + cell % 7) as f32));
            let (near, far) = cube.clip(origin, direction);
            // A whole number of steps: a last step that is cut short would be denser than the others.
            let steps = ((far - near) / grid.cell_size()).floor();
            let (ray, span) = ((origin, direction), (near, near + (steps - 1e-3).max(0.0) * grid.cell_size()));
            let (mut t, mut plain) = ([0f32; 24], [0f32; 24]);
            place(guide(&grid, &cube), placing, ray, span, None, &mut t);
            guided_step_by_step(&grid, &cube, placing, ray, span, &mut plain);
            let slack = 1e-3 * (span.1 - span.0) + 1e-6;
            prop_assert!(t.iter().zip(&plain).all(|(t, p)| (t - p).abs() <= slack), "{t:?} {plain:?}");
        }

        #[test]
        fn empty_bricks_are_stepped_over_and_no_others(
            (cells, ray) in aimed(), density in 0.5f32..20.0,
        ) {
            let (cube, grid) = (UnitCube::new(&BOUNDS), grid_of(&cells, density));
            let span = cube.clip(ray.0, ray.1);
            let plain = is_clear_cell_by_cell(&grid, &cube, ray, span);
            let clear: Vec<bool> = guide(&grid, &cube).are_clear(iter::once((ray, span))).collect();
            prop_assert_eq!(clear, [plain]);
        }

        #[test]
        fn guided_samples_ascend_inside_the_box_and_their_lengths_tile_it(
            (background, seen) in occupied(), origin in origin(), direction in direction(),
            n in 2usize..64, seed in proptest::option::of(any::<u64>()), placing in placing(),
        ) {
            let grid = DensityGrid::uniform(&BOUNDS, 16, background);
            seen.into_iter().for_each(|(cell, density)| grid.observe(cell, density));
            let cube = UnitCube::new(&BOUNDS);
            let span = cube.clip(origin, direction);
            let mut t = vec![f32::NAN; n];
            let jitter = seed.map(|seed| move |i: usize| Random::new(seed, 0).uniform_at(i as u64));
            let jitter = jitter.as_ref().map(|j| j as &dyn Fn(usize) -> f32);
            place(guide(&grid, &cube), placing, (origin, direction), span, jitter, &mut t);
            assert_ascends(&t, span);
            prop_assert_eq!(t[n - 1], span.1);
            assert_tiles(&t, span);
        }
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
            place(guide(&grid, &cube), &KNOWING, ray, span, None, &mut t);
            let ends = (t[0], t[59]);
            assert!(ends.0 < 2.0 && ends.1 > 30.0 && ends.1 <= 31.0, "density {density}: {ends:?}");
        }
    }

    /// Of a dense slab that is known, nearly all samples lie in its cells or in those beside them. A search spares some for the rest
    /// of the ray.
    #[test]
    fn guided_samples_gather_at_a_dense_slab() {
        let cube = UnitCube::new(&BOUNDS);
        let grid = DensityGrid::uniform(&BOUNDS, 64, 0.0);
        for i in 0..64 * 64 {
            let cell = grid.cell([(i % 64) as f32 / 64.0, (i / 64) as f32 / 64.0, 0.5]);
            grid.observe(cell, 500.0);
        }
        let ray = ([0.1, 0.3, 0.0], [0.0, 0.0, 1.0]);
        let random = Random::new(0, 0);
        let near_slab = |placing: &Placing, jitter: Option<&dyn Fn(usize) -> f32>| {
            let mut t = vec![f32::NAN; 101];
            place(guide(&grid, &cube), placing, ray, (2.0, 4.0), jitter, &mut t);
            // The slab fills 3.0 to 3.03 m.
            t[..100].iter().filter(|t| (2.95..3.1).contains(*t)).count()
        };
        for jitter in [None, Some(&(|i: usize| random.uniform_at(i as u64)) as &dyn Fn(usize) -> f32)] {
            assert!(near_slab(&KNOWING, jitter) >= 95);
            assert!((75..95).contains(&near_slab(&SEARCHING, jitter)));
        }
    }
}
