//! What the density grid tells rays: where samples are worth placing, and whether anything is in the way.
//!
//! A ray looks at the grid in steps of a cell. Bricks in which nothing is are stepped over.

use fearless_simd::{Level, Simd, dispatch};

use crate::density_grid::DensityGrid;
use crate::march::{UnitCube, draw};
use crate::walk::Walk;

/// Share of guided samples spread evenly, so that what the density grid does not know of is found (training).
const UNIFORM_SHARE: f32 = 0.15;
/// The same when drawing pictures.
const UNIFORM_SHARE_DRAWING: f32 = 0.02;
/// Largest opacity a cell may claim when samples are placed: some must fall behind a surface that may be wrong.
const OPACITY_LIMIT: f32 = 0.5;
/// The same when drawing pictures: with fewer samples in front, 16 come nearer to what hundreds give.
const OPACITY_LIMIT_DRAWING: f32 = 0.35;
/// Optical depth, by the density grid, below which a shadow ray counts as clear.
const SHADING: f32 = 0.05;
/// Cells that a ray looks at, at most; a ray through a cubic box meets fewer.
const MOST_BINS: usize = 2048;
/// Placing ends where less than this of the limited transmittance is left.
const TRANSMITTANCE_END: f32 = 0.01;

/// Memory for [`Guide::guided`], reused from ray to ray.
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

impl Guide<'_> {
    /// Whether the density grid knows of nothing between two distances that could shade what lies behind.
    pub fn is_clear(&self, (origin, direction): ([f32; 3], [f32; 3]), (near, far): (f32, f32)) -> bool {
        let step = self.density.cell_size().max((far - near) / MOST_BINS as f32);
        let stretch = step / self.density.cell_size();
        let (o, mut depth) = (self.cube.map(origin), 0.0);
        let d = self.cube.map_direction(direction);
        let bins = ((far - near) / step).ceil() as usize;
        dispatch!(self.simd, simd => simd.vectorize(
            #[inline(always)]
            || {
                Walk::new(simd, self.density, (o, d), (near, step, bins)).all(|(_, optical)| {
                    depth += optical * stretch;
                    depth <= SHADING
                })
            },
        ))
    }

    /// Places samples where the density grid says that something is: `t.len() - 1` of them inside, the last where the
    /// ray leaves the box.
    pub fn guided(
        &self,
        (origin, direction): ([f32; 3], [f32; 3]),
        (near, far): (f32, f32),
        jitter: Option<&dyn Fn(usize) -> f32>,
        scratch: &mut GuideScratch,
        t: &mut [f32],
    ) {
        let Some((last, t)) = t.split_last_mut() else { return };
        *last = far;
        // Cells as long as the shortest side of the box allows, unless that makes too many of them.
        let step = self.density.cell_size().max((far - near) / MOST_BINS as f32);
        let stretch = step / self.density.cell_size();
        let bins = (((far - near) / step).ceil() as usize).clamp(1, MOST_BINS);
        scratch.occupied.clear();
        let (o, mut limited, mut depth) = (self.cube.map(origin), 1f32, 0f32);
        let d = self.cube.map_direction(direction);
        let (least, limit) = match jitter {
            Some(_) => (UNIFORM_SHARE, OPACITY_LIMIT),
            None => (UNIFORM_SHARE_DRAWING, OPACITY_LIMIT_DRAWING),
        };
        dispatch!(self.simd, simd => simd.vectorize(
            #[inline(always)]
            || {
                for (b, optical) in Walk::new(simd, self.density, (o, d), (near, step, bins)) {
                    let optical = optical * stretch;
                    if optical == 0.0 {
                        continue;
                    }
                    depth += optical;
                    let alpha = (1.0 - (-optical).exp()).min(limit);
                    // A surface may lie just outside the cell that knows of it.
                    for near_by in b.saturating_sub(1)..(b + 2).min(bins) {
                        scratch.raise(near_by, limited * alpha);
                    }
                    limited *= 1.0 - alpha;
                    if limited < TRANSMITTANCE_END {
                        break;
                    }
                }
            },
        ));
        let total: f32 = scratch.occupied.iter().map(|(_, chance)| chance).sum();
        let uniform = if total > 0.0 { least + (1.0 - least) * (-depth).exp() } else { 1.0 };
        let scale = if total > 0.0 { (1.0 - uniform) / total } else { 0.0 };
        scratch.divide(bins, scale, uniform / bins as f32);
        let end = |stretch: usize| (near + scratch.ends[stretch] as f32 * step).min(far);
        match jitter {
            Some(jitter) => draw(&scratch.mass, near, end, jitter, t),
            None => draw(&scratch.mass, near, end, |_| 0.5, t),
        }
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use crate::march::tests::{BOUNDS, assert_ascends, assert_tiles, direction, origin};
    use crate::walk::tests::{aimed, grid_of, step_by_step};
    use proptest::prelude::*;
    use relight_field::random::Random;
    use relight_scene::Bounds;

    pub(crate) fn guide<'a>(density: &'a DensityGrid, &cube: &UnitCube) -> Guide<'a> {
        Guide { simd: Level::new(), density, cube }
    }

    /// Density of the background and of some cells.
    fn occupied() -> impl Strategy<Value = (f32, Vec<(usize, f32)>)> {
        let seen = proptest::collection::vec((0usize..4096, 0f32..2000.0), 0..20);
        (prop_oneof![Just(0f32), Just(1.0), Just(1e30)], seen)
    }

    /// [`Guide::is_clear`], looking at every cell.
    fn is_clear_cell_by_cell(
        grid: &DensityGrid,
        cube: &UnitCube,
        ray: ([f32; 3], [f32; 3]),
        span: (f32, f32),
    ) -> bool {
        let steps = ((span.1 - span.0) / grid.cell_size()).ceil() as usize;
        let ray = (cube.map(ray.0), cube.map_direction(ray.1));
        step_by_step(grid, ray, (span.0, grid.cell_size(), steps)).sum::<f32>() <= SHADING
    }

    /// [`Guide::guided`], with every step an entry of the distribution, and the middle of each part drawn.
    fn guided_step_by_step(
        grid: &DensityGrid,
        cube: &UnitCube,
        (origin, direction): ([f32; 3], [f32; 3]),
        (near, far): (f32, f32),
        t: &mut [f32],
    ) {
        let (step, o) = (grid.cell_size(), cube.map(origin));
        let d = cube.map_direction(direction);
        let bins = (((far - near) / step).ceil() as usize).max(1);
        let (mut weight, mut limited, mut depth) = (vec![0f32; bins + 2], 1.0, 0f32);
        for (b, optical) in step_by_step(grid, (o, d), (near, step, bins)).enumerate() {
            let alpha = (1.0 - (-optical).exp()).min(OPACITY_LIMIT);
            depth += optical;
            weight[b + 1] = limited * alpha;
            limited *= 1.0 - alpha;
            if limited < TRANSMITTANCE_END {
                break;
            }
        }
        let mut mass: Vec<f32> = weight.windows(3).map(|w| w[0].max(w[1]).max(w[2])).collect();
        let total: f32 = mass.iter().sum();
        let share = if total > 0.0 { UNIFORM_SHARE + (1.0 - UNIFORM_SHARE) * (-depth).exp() } else { 1.0 };
        let scale = if total > 0.0 { (1.0 - share) / total } else { 0.0 };
        mass.iter_mut().for_each(|m| *m = *m * scale + share / bins as f32);
        let (last, t) = t.split_last_mut().unwrap();
        *last = far;
        draw(&mass, near, |b| (near + (b as f32 + 1.0) * step).min(far), |_| 0.5, t);
    }

    proptest! {
        #[test]
        fn stretches_place_samples_as_single_steps_do(
            origin in origin(), direction in direction(), density in 0.1f32..100.0,
            occupied in proptest::collection::vec(0usize..64 * 64 * 64, 0..1000),
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
            guide(&grid, &cube).guided(ray, span, Some(&|_| 0.5), &mut GuideScratch::default(), &mut t);
            guided_step_by_step(&grid, &cube, ray, span, &mut plain);
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
            prop_assert_eq!(guide(&grid, &cube).is_clear(ray, span), plain);
        }

        #[test]
        fn guided_samples_ascend_inside_the_box_and_their_lengths_tile_it(
            (background, seen) in occupied(), origin in origin(), direction in direction(),
            n in 2usize..64, seed in proptest::option::of(any::<u64>()),
        ) {
            let grid = DensityGrid::uniform(&BOUNDS, 16, background);
            seen.into_iter().for_each(|(cell, density)| grid.observe(cell, density));
            let cube = UnitCube::new(&BOUNDS);
            let span = cube.clip(origin, direction);
            let mut t = vec![f32::NAN; n];
            let jitter = seed.map(|seed| move |i: usize| Random::new(seed, 0).uniform_at(i as u64));
            let jitter = jitter.as_ref().map(|j| j as &dyn Fn(usize) -> f32);
            guide(&grid, &cube).guided((origin, direction), span, jitter, &mut GuideScratch::default(), &mut t);
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
            guide(&grid, &cube).guided(ray, span, None, &mut GuideScratch::default(), &mut t);
            let ends = (t[0], t[59]);
            assert!(ends.0 < 2.0 && ends.1 > 30.0 && ends.1 <= 31.0, "density {density}: {ends:?}");
        }
    }

    /// Drawing a picture of a dense slab: nearly all samples lie in its cells or in those beside them. Training
    /// spares some for the rest of the ray.
    #[test]
    fn guided_samples_gather_at_a_dense_slab() {
        let cube = UnitCube::new(&BOUNDS);
        let grid = DensityGrid::uniform(&BOUNDS, 64, 0.0);
        for i in 0..64 * 64 {
            let cell = grid.cell([(i % 64) as f32 / 64.0, (i / 64) as f32 / 64.0, 0.5]);
            grid.observe(cell, 500.0);
        }
        let ray = ([0.1, 0.3, 0.0], [0.0, 0.0, 1.0]);
        let near_slab = |jitter: Option<&dyn Fn(usize) -> f32>| {
            let mut t = vec![f32::NAN; 101];
            guide(&grid, &cube).guided(ray, (2.0, 4.0), jitter, &mut GuideScratch::default(), &mut t);
            // The slab fills 3.0 to 3.03 m.
            t[..100].iter().filter(|t| (2.95..3.1).contains(*t)).count()
        };
        let random = Random::new(0, 0);
        assert!(near_slab(None) >= 95);
        assert!((75..95).contains(&near_slab(Some(&|i| random.uniform_at(i as u64)))));
    }
}
