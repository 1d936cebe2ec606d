//! How samples are placed along a ray: how much is left to chance, how far a ray looks at once, what it finds, and where samples lie then.

use crate::march::draw;

/// Optical depth beyond which nothing passes; libm takes long over exponentials that come out as 0.
const OPAQUE: f32 = 50.0;

/// Optical depth of a cell below which rays that look on, those of pictures, look for nothing in it. Fields keep a haze that thin where few
/// photographs contradict, as between wires, and pictures of such things are nearer to photographs without it.
const HAZE: f32 = 1e-2;

/// How samples are placed.
#[derive(Debug)]
pub struct Placing {
    /// Nothing is looked for in cells of a smaller optical depth.
    pub haze: f32,
    /// Share of them spread evenly, so that what the density grid does not know of is found.
    pub uniform_share: f32,
    /// Largest opacity a cell may claim: some must fall behind a surface that may be wrong.
    pub opacity_limit: f32,
    /// Nothing is looked for where less than this of the limited transmittance is left.
    pub end: f32,
    /// Samples end there too, or at the first void behind which less than this of it is left, instead of at the far side of the box.
    pub look: Option<f32>,
}

/// Where things have to be found.
pub const SEARCHING: Placing =
    Placing { haze: 0.0, uniform_share: 0.15, opacity_limit: 0.5, end: 0.01, look: None };
/// Where things are known: with fewer samples in front, 16 come nearer to what hundreds give.
pub const KNOWING: Placing =
    Placing { haze: 0.0, uniform_share: 0.02, opacity_limit: 0.35, end: 0.06, look: None };
/// Along rays that can look on where they have got through what they met: a look ends early, since what lies behind is left to the next.
pub const LOOKING: Placing =
    Placing { haze: HAZE, uniform_share: 0.01, opacity_limit: 0.4, end: 0.15, look: Some(0.5) };
/// The last time that such a ray looks.
pub const ENDING: Placing = Placing { haze: HAZE, ..KNOWING };

/// `1 - exp(-optical)` for optical depths below 0.7, to 2e-4, by the first terms of its series: libm would take longer than all else that
/// is done for a cell.
#[inline(always)]
pub fn opacity(optical: f32) -> f32 {
    let terms = [5.0, 4.0, 3.0, 2.0].map(|n: f32| optical * (1.0 / n));
    optical * terms.iter().fold(1.0, |rest, term| 1.0 - term * rest)
}

/// Where the samples of a ray are worth placing.
pub struct Places<'a> {
    /// With their masses.
    pub stretches: &'a Stretches,
    /// Where the first begins, metres.
    pub near: f32,
    /// Length of a step, metres.
    pub step: f32,
    /// Where the last of them may be, metres, and whether that is where the ray leaves the box.
    pub end: f32,
    /// See `end`.
    pub leaves: bool,
}

impl Places<'_> {
    /// Draws samples, metres, ascending, sample `i` in its part of the distribution at `jitter(i)` of 0..1; but of a ray that leaves the
    /// box, the last is where it does. `apart[i]` is how far samples as sample `i` are apart.
    pub fn draw(&self, jitter: impl Fn(usize) -> f32, t: &mut [f32], apart: &mut [f32]) {
        let drawn = t.len() - usize::from(self.leaves);
        t[drawn..].fill(self.end);
        apart[drawn..].fill(f32::INFINITY);
        let end =
            |stretch: usize| (self.near + self.stretches.ends[stretch] as f32 * self.step).min(self.end);
        draw(&self.stretches.mass, self.near, end, jitter, drawn, |i, at, distance| {
            (t[i], apart[i]) = (at, distance);
        });
    }
}

/// Stretches of a ray, of one step at which something may be, or of all between two such.
#[derive(Default)]
pub struct Stretches {
    /// Where each ends, counted in steps.
    pub ends: Vec<usize>,
    /// The chance of a sample in each.
    pub mass: Vec<f32>,
}

/// What a ray has found so far.
#[derive(Default)]
pub struct Found {
    /// Number of its way.
    pub way: usize,
    /// Its steps, as far as it has samples, and how many cells each is long.
    pub steps: usize,
    /// See `steps`.
    pub stretch: f32,
    /// Steps at which something may be, ascending, with the chance of a sample there.
    pub occupied: Vec<(usize, f32)>,
    /// Transmittance, cells being no more opaque than they may claim.
    pub limited: f32,
    /// Optical depth.
    pub depth: f32,
}

impl Found {
    /// Raises the chance of a step, which no step before was behind, and of its neighbours: a surface may lie just outside the cell
    /// that knows of it.
    #[inline]
    pub fn raise(&mut self, step: usize, chance: f32) {
        let first = step.saturating_sub(1);
        // Those of the three that steps before have raised.
        let known = self.occupied.last().map_or(0, |&(last, _)| (last + 1).saturating_sub(first));
        let start = self.occupied.len() - known;
        self.occupied[start..].iter_mut().for_each(|(_, raised)| *raised = raised.max(chance));
        self.occupied.extend((first + known..(step + 2).min(self.steps)).map(|step| (step, chance)));
    }

    /// The stretches of the ray: at steps where something may be the chance found, and `uniform_share` of all samples, or more on
    /// rays that may pass, in every step alike.
    #[inline]
    pub fn divide(&self, uniform_share: f32, stretches: &mut Stretches) {
        let total: f32 = self.occupied.iter().map(|(_, chance)| chance).sum();
        let passes = (-self.depth.min(OPAQUE)).exp();
        let uniform = if total > 0.0 { uniform_share + (1.0 - uniform_share) * passes } else { 1.0 };
        let scale = if total > 0.0 { (1.0 - uniform) / total } else { 0.0 };
        let uniform = uniform / self.steps as f32;
        let Stretches { ends, mass } = stretches;
        ends.clear();
        mass.clear();
        let mut start = 0;
        for &(step, chance) in &self.occupied {
            if step > start {
                ends.push(step);
                mass.push((step - start) as f32 * uniform);
            }
            ends.push(step + 1);
            mass.push(chance * scale + uniform);
            start = step + 1;
        }
        if start < self.steps {
            ends.push(self.steps);
            mass.push((self.steps - start) as f32 * uniform);
        }
    }
}

#[cfg(test)]
mod tests {
    use std::iter;

    use super::*;
    use crate::density_grid::DensityGrid;
    use crate::guide::GuideScratch;
    use crate::guide::tests::{guide, place};
    use crate::march::UnitCube;
    use crate::march::tests::{BOUNDS, assert_ascends};

    #[test]
    fn opacities_of_thin_cells_are_nearly_exact() {
        for optical in (0..70).map(|i| i as f32 / 100.0) {
            let exact = 1.0 - (-optical).exp();
            assert!((opacity(optical) - exact).abs() < 2e-4, "{optical}");
        }
    }

    /// Looks of a ray along z, which enters the box at 2 m and leaves it at 4, through slabs of cells: where each ends, whether it leaves,
    /// and its samples.
    fn looks(slabs: &[(usize, usize)], density: f32) -> Vec<(f32, bool, Vec<f32>)> {
        let (cube, grid) = (UnitCube::new(&BOUNDS), DensityGrid::uniform(&BOUNDS, 64, 0.0));
        for z in slabs.iter().flat_map(|&(first, last)| first..=last) {
            grid.observe(grid.cell_at([32, 32, z]), density);
        }
        let origin = cube.unmap([32.5 / 64.0, 32.5 / 64.0, -1.0]);
        let (mut near, mut looks) = (2.0, Vec::<(f32, bool, Vec<f32>)>::new());
        while looks.last().is_none_or(|&(_, leaves, _)| !leaves) {
            let ray = ([origin[0], origin[1], 0.0], [0.0, 0.0, 1.0]);
            let rays = iter::once((ray, (near, 4.0)));
            let scratch = &mut GuideScratch::default();
            guide(&grid, &cube).guided(&LOOKING, rays, scratch, |_, places| {
                let (mut t, mut apart) = (vec![f32::NAN; 40], vec![f32::NAN; 40]);
                places.draw(|_| 0.5, &mut t, &mut apart);
                assert_ascends(&t, (near, places.end));
                assert!(places.end > near && (t[39] == 4.0) == places.leaves);
                looks.push((places.end, places.leaves, t));
            });
            near = looks[looks.len() - 1].0;
        }
        looks
    }

    /// A cell is 1/32 m long here, and two and a half steps.
    #[test]
    fn looks_end_behind_what_may_hide_the_rest() {
        let depth = |cell: usize| 2.0 + cell as f32 / 32.0;
        let looks = looks(&[(10, 10), (40, 40)], 500.0);
        assert_eq!(looks.len(), 2);
        assert!((depth(11) - 0.01..depth(12)).contains(&looks[0].0) && !looks[0].1, "{}", looks[0].0);
        for ((_, _, t), first) in looks.iter().zip([10, 40]) {
            let close = t.iter().filter(|t| (depth(first - 1)..depth(first + 3)).contains(*t)).count();
            assert!(close > 36, "{close}");
        }
        assert_eq!((looks[1].0, looks[1].1), (4.0, true));
    }

    #[test]
    fn pictures_look_for_nothing_in_a_haze() {
        let (cube, grid) = (UnitCube::new(&BOUNDS), DensityGrid::uniform(&BOUNDS, 64, 0.0));
        (0..40).for_each(|z| grid.observe(grid.cell_at([32, 32, z]), 0.006 / grid.cell_size()));
        grid.observe(grid.cell_at([32, 32, 40]), 500.0);
        let origin = cube.unmap([32.5 / 64.0, 32.5 / 64.0, -1.0]);
        let in_haze = |placing: &Placing| {
            let (ray, mut t) = (([origin[0], origin[1], 0.0], [0.0, 0.0, 1.0]), [f32::NAN; 40]);
            place(guide(&grid, &cube), placing, ray, (2.0, 4.0), None, &mut t);
            t.iter().filter(|&&t| t < 2.0 + 39.0 / 32.0).count()
        };
        assert!(in_haze(&LOOKING) <= 1 && in_haze(&ENDING) <= 1);
        assert!(in_haze(&KNOWING) > 5 && in_haze(&SEARCHING) > 5);
    }

    /// What is deep enough for no sample to lie behind it ends a look as well.
    #[test]
    fn looks_end_inside_what_is_deep() {
        let looks = looks(&[(10, 50)], 5000.0);
        assert!(looks.len() > 3 && looks[0].0 < 2.0 + 20.0 / 32.0, "{}", looks.len());
    }

    #[test]
    fn thin_things_share_one_look() {
        let looks = looks(&[(10, 11), (40, 41)], 4.0);
        assert_eq!((looks.len(), looks[0].1), (1, true));
        let close = looks[0].2.iter().filter(|&&t| t < 2.0 + 13.0 / 32.0).count();
        assert!((10..30).contains(&close), "{close}");
    }
}
