//! Ways of rays through the density grid, a step at a time, over all bricks in which nothing is: empty-space skipping.
//!
//! Where a step begins is known only after the one before, so sixteen rays go beside each other, in the lanes of vectors; when one
//! is at its end, the next ray takes its lane.

use fearless_simd::{Level, Simd, dispatch, f32x16, i32x16, prelude::*};

use crate::density_grid::{BRICK, DensityGrid};

/// Rays that go beside each other.
pub const LANES: usize = 16;
/// Steps of a way, at most: as many as single precision tells apart with a half added.
const MOST_STEPS: usize = 1 << 23;

/// The way of a ray in the unit cube.
#[derive(Clone, Copy, Debug)]
pub struct Way {
    /// Where the ray is at distance 0.
    pub origin: [f32; 3],
    /// How far it goes a metre.
    pub direction: [f32; 3],
    /// Where the first step begins, metres.
    pub near: f32,
    /// Length of a step, metres.
    pub step: f32,
    /// Steps, at most 2^23.
    pub steps: usize,
}

/// What rays do on their ways.
pub trait Walker {
    /// The way of this number begins, in a lane that is free.
    fn begin(&mut self, lane: usize, way: usize);

    /// The ray in `lane` takes a step at which something is: `optical` is the optical depth, above 0, of the cell that it meets in
    /// the step's middle, as long as the cell's edge. Whether the ray goes on.
    fn meet(&mut self, lane: usize, step: usize, optical: f32) -> bool;

    /// The ray in `lane` is at its end, and the lane is free.
    fn end(&mut self, lane: usize);
}

/// Rays on their ways, a number a lane.
#[derive(Default)]
#[repr(align(64))]
struct Lanes {
    /// Where the ray is at distance 0, in cells.
    origin: [[f32; LANES]; 3],
    /// How far it goes a metre, in cells.
    direction: [[f32; LANES]; 3],
    /// Distances from one face of a brick to the opposite one, metres; a huge number for faces that the ray runs along.
    crossing: [[f32; LANES]; 3],
    /// 0 where the ray goes to lower coordinates, else 1 (where it runs along the faces too, lest none of the brick lie before it):
    /// less the share of a brick that lies at lower coordinates, and without sign, it is the share that lies before the ray.
    upward: [[f32; LANES]; 3],
    /// See [`Way::near`].
    near: [f32; LANES],
    /// See [`Way::step`].
    step: [f32; LANES],
    steps_a_metre: [f32; LANES],
    /// The step that is looked at next, of `steps`.
    next: [i32; LANES],
    steps: [i32; LANES],
    /// A bit for each lane with a ray.
    taken: u32,
}

impl Lanes {
    /// Lets the next ray of `waiting` that has a way to go take a lane, through a grid of so many cells an axis.
    fn take<'a>(
        &mut self,
        lane: usize,
        cells: f32,
        waiting: &mut impl Iterator<Item = (usize, &'a Way)>,
        walker: &mut impl Walker,
    ) {
        self.taken &= !(1 << lane);
        for (number, way) in waiting {
            walker.begin(lane, number);
            if way.steps > 0 {
                self.set(lane, cells, way);
                return;
            }
            walker.end(lane);
        }
    }

    /// Puts a ray at the beginning of its way.
    fn set(&mut self, lane: usize, cells: f32, way: &Way) {
        for axis in 0..3 {
            let direction = way.direction[axis] * cells;
            self.origin[axis][lane] = way.origin[axis] * cells;
            self.direction[axis][lane] = direction;
            self.crossing[axis][lane] = (BRICK as f32 / direction.abs()).min(f32::MAX);
            self.upward[axis][lane] = if direction >= 0.0 { 1.0 } else { 0.0 };
        }
        (self.near[lane], self.step[lane], self.steps_a_metre[lane]) = (way.near, way.step, 1.0 / way.step);
        (self.next[lane], self.steps[lane]) = (0, way.steps.min(MOST_STEPS) as i32);
        self.taken |= 1 << lane;
    }

    /// Where the rays are along an axis at these distances, in cells.
    #[inline(always)]
    fn place<S: Simd>(&self, simd: S, axis: usize, at: f32x16<S>) -> f32x16<S> {
        let origin = f32x16::from_slice(simd, &self.origin[axis]);
        f32x16::from_slice(simd, &self.direction[axis]).mul_add(at, origin)
    }

    /// Distances to the face of a brick, along an axis, that rays meet after so many bricks, metres, from these places in cells.
    #[inline(always)]
    fn ahead<S: Simd>(&self, simd: S, axis: usize, place: f32x16<S>, around: f32x16<S>) -> f32x16<S> {
        let bricks = place * f32x16::splat(simd, 1.0 / BRICK as f32);
        let within = bricks - bricks.trunc();
        let before = (f32x16::from_slice(simd, &self.upward[axis]) - within).abs();
        (before + around) * f32x16::from_slice(simd, &self.crossing[axis])
    }
}

/// Sends rays along all `ways`.
pub fn walk(level: Level, grid: &DensityGrid, ways: &[Way], walker: &mut impl Walker) {
    dispatch!(level, simd => simd.vectorize(
        #[inline(always)]
        || walk_simd(simd, grid, ways, walker),
    ));
}

#[inline(always)]
fn walk_simd<S: Simd>(simd: S, grid: &DensityGrid, ways: &[Way], walker: &mut impl Walker) {
    let cells = grid.resolution() as f32;
    let (mut lanes, mut waiting) = (Lanes::default(), ways.iter().enumerate());
    (0..LANES).for_each(|lane| lanes.take(lane, cells, &mut waiting, walker));
    let [half, most] = [f32x16::splat(simd, 0.5), f32x16::splat(simd, MOST_STEPS as f32)];
    let [zero, one] = [i32x16::splat(simd, 0), i32x16::splat(simd, 1)];
    while lanes.taken != 0 {
        let next = i32x16::from_slice(simd, &lanes.next);
        let at = next.to_float::<f32x16<S>>() + half;
        let at = at.mul_add(f32x16::from_slice(simd, &lanes.step), f32x16::from_slice(simd, &lanes.near));
        let [x, y, z] = [lanes.place(simd, 0, at), lanes.place(simd, 1, at), lanes.place(simd, 2, at)];
        // Only rays that miss the box, and lanes without one, may be beyond what 32 bits hold, and to those any cell will do.
        let cell = grid.cells_at(simd, [x.to_int(), y.to_int(), z.to_int()]);
        let mut index = [0; LANES];
        cell.store_slice(&mut index);
        let mut away = [0; LANES];
        for (away, &cell) in away.iter_mut().zip(&index) {
            *away = i32::from(grid.to_occupied(cell as usize));
        }
        let away = i32x16::from_slice(simd, &away);
        let occupied = away.simd_eq(zero);
        // All bricks nearer than that are empty as well.
        let around = (away - one).to_float::<f32x16<S>>();
        let nearest = lanes.ahead(simd, 0, x, around).min(lanes.ahead(simd, 1, y, around));
        let nearest = nearest.min(lanes.ahead(simd, 2, z, around));
        let steps = nearest * f32x16::from_slice(simd, &lanes.steps_a_metre);
        let steps = steps.min(most).to_int::<i32x16<S>>().max(one);
        let after = next + occupied.select(one, steps);
        let here: [i32; LANES] = next.into();
        after.store_slice(&mut lanes.next);
        // Cells of empty bricks are not worth waiting for.
        occupied.select(cell, zero).store_slice(&mut index);
        let mut optical = [0.0; LANES];
        for (optical, &cell) in optical.iter_mut().zip(&index) {
            *optical = grid.optical_depth(cell as usize);
        }
        let something = f32x16::from_slice(simd, &optical).simd_gt(f32x16::splat(simd, 0.0)) & occupied;
        for lane in bits(something.to_bitmask() as u32 & lanes.taken) {
            if !walker.meet(lane, here[lane] as usize, optical[lane]) {
                lanes.next[lane] = lanes.steps[lane];
            }
        }
        let through = i32x16::from_slice(simd, &lanes.next).simd_ge(i32x16::from_slice(simd, &lanes.steps));
        for lane in bits(through.to_bitmask() as u32 & lanes.taken) {
            walker.end(lane);
            lanes.take(lane, cells, &mut waiting, walker);
        }
    }
}

/// Places of the bits of a number.
#[inline(always)]
fn bits(mut left: u32) -> impl Iterator<Item = usize> {
    std::iter::from_fn(move || {
        (left != 0).then(|| {
            let lowest = left.trailing_zeros() as usize;
            left &= left - 1;
            lowest
        })
    })
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use crate::dense::tests::levels;
    use crate::guide::Ray;
    use crate::march::UnitCube;
    use crate::march::tests::{BOUNDS, origin};
    use proptest::prelude::*;
    use relight_field::random::Random;

    fn way((origin, direction): Ray, (near, step, steps): (f32, f32, usize)) -> Way {
        Way { origin, direction, near, step, steps }
    }

    /// Notes what all ways meet, and that each begins and ends once.
    struct Notes {
        lanes: [Option<usize>; LANES],
        met: Vec<Vec<(usize, f32)>>,
        ended: Vec<bool>,
        /// Meetings after which a ray does not go on.
        most: usize,
    }

    impl Walker for Notes {
        fn begin(&mut self, lane: usize, way: usize) {
            assert_eq!(self.lanes[lane].replace(way), None);
        }

        fn meet(&mut self, lane: usize, step: usize, optical: f32) -> bool {
            let way = self.lanes[lane].unwrap();
            self.met[way].push((step, optical));
            self.met[way].len() < self.most
        }

        fn end(&mut self, lane: usize) {
            let way = self.lanes[lane].take().unwrap();
            assert!(!std::mem::replace(&mut self.ended[way], true));
        }
    }

    /// What all ways meet, until they have met `most` steps at which something is.
    fn met(level: Level, grid: &DensityGrid, ways: &[Way], most: usize) -> Vec<Vec<(usize, f32)>> {
        let n = ways.len();
        let mut notes = Notes { lanes: [None; LANES], met: vec![Vec::new(); n], ended: vec![false; n], most };
        walk(level, grid, ways, &mut notes);
        assert!(notes.ended.iter().all(|&ended| ended));
        notes.met
    }

    /// The depth of each step, one axis after the other and without stepping over anything.
    pub(crate) fn step_by_step(
        grid: &DensityGrid,
        (o, d): Ray,
        (near, step, steps): (f32, f32, usize),
    ) -> impl Iterator<Item = f32> {
        let cells = grid.resolution() as f32;
        (0..steps).map(move |i| {
            let at = (i as f32 + 0.5).mul_add(step, near);
            let place: [f32; 3] = std::array::from_fn(|a| (d[a] * cells).mul_add(at, o[a] * cells));
            let cell = place.map(|c| (c as i32).clamp(0, grid.resolution() as i32 - 1) as usize);
            grid.optical_depth(grid.cell_at(cell))
        })
    }

    /// Some cells of a grid of 64 an axis, and a ray through the middle of the first: from anywhere, and along some axes not at
    /// all.
    pub(crate) fn aimed() -> impl Strategy<Value = (Vec<[usize; 3]>, Ray)> {
        let cells = proptest::collection::vec([0usize..64, 0usize..64, 0usize..64], 1..40);
        (cells, origin(), any::<[bool; 3]>()).prop_filter_map("a direction", |(cells, mut origin, flat)| {
            let target = UnitCube::new(&BOUNDS).unmap(cells[0].map(|c| (c as f32 + 0.5) / 64.0));
            (0..3).filter(|&a| flat[a]).for_each(|a| origin[a] = target[a]);
            let way: [f32; 3] = std::array::from_fn(|a| target[a] - origin[a]);
            let length = way.iter().map(|c| c * c).sum::<f32>().sqrt();
            (length > 0.1).then(|| (cells, (origin, way.map(|c| c / length))))
        })
    }

    /// A grid that is empty but for some cells of a density.
    pub(crate) fn grid_of(cells: &[[usize; 3]], density: f32) -> DensityGrid {
        let grid = DensityGrid::uniform(&BOUNDS, 64, 0.0);
        cells.iter().for_each(|&cell| grid.observe(grid.cell_at(cell), density));
        grid
    }

    proptest! {
        #[test]
        fn what_is_stepped_over_is_empty((cells, (origin, direction)) in aimed()) {
            let (cube, grid) = (UnitCube::new(&BOUNDS), grid_of(&cells, 500.0));
            let (near, far) = cube.clip(origin, direction);
            let (o, d, step) = (cube.map(origin), cube.map_direction(direction), 0.7 * grid.cell_size());
            let steps = ((far - near) / step).ceil() as usize;
            for level in levels() {
                let met = met(level, &grid, &[way((o, d), (near, step, steps))], usize::MAX).remove(0);
                prop_assert!(!met.is_empty() && met.iter().all(|&(_, depth)| depth > 0.0));
                let mut met = met.into_iter().peekable();
                for i in 0..steps {
                    let at = near + (i as f32 + 0.5) * step;
                    let place: [f32; 3] = std::array::from_fn(|a| o[a] + at * d[a]);
                    // On the face between two cells, either is right.
                    let cells = place.map(|u| [u - 1e-5, u + 1e-5]);
                    let around = (0..8).map(|i| [0, 1, 2].map(|a| cells[a][i >> a & 1]));
                    let depths: Vec<f32> = around.map(|u| grid.optical_depth(grid.cell(u))).collect();
                    let depth = met.next_if(|&(step, _)| step == i).map_or(0.0, |(_, depth)| depth);
                    prop_assert!(depths.contains(&depth), "{}: {} is none of {:?}", i, depth, depths);
                }
                prop_assert_eq!(met.next(), None);
            }
        }
    }

    /// More rays than lanes, of many lengths, some of no step, some along an axis and some from beyond the box, through a grid of which
    /// most bricks are empty.
    #[test]
    fn each_of_many_rays_goes_its_own_way() {
        let random = Random::new(7, 0);
        let number = |i: u64| random.uniform_at(i);
        let grid = DensityGrid::uniform(&BOUNDS, 64, 0.0);
        for i in 0..100 {
            let brick = [0, 1, 2].map(|a| 8 * (8.0 * number(3 * i + a)) as usize);
            for k in 0..300 {
                let within = [0, 1, 2].map(|a| (8.0 * number(1000 * (i + 1) + 3 * k + a)) as usize);
                let density = [0.0, 10.0, 500.0][(3.0 * number(1_000_000 + 300 * i + k)) as usize];
                grid.observe(grid.cell_at([0, 1, 2].map(|a| brick[a] + within[a])), density);
            }
        }
        let ways: Vec<Way> = (0..200)
            .map(|i| {
                let place = |k: u64| [0, 1, 2].map(|a| 1.6 * number(2_000_000 + 8 * i + k + a) - 0.3);
                let (origin, mut target) = (place(0), place(3));
                (0..3)
                    .filter(|a| i % 7 == 0 && i % 3 != *a)
                    .for_each(|a| target[a as usize] = origin[a as usize]);
                let steps = [0, 1, 37, 64, 90][(i % 5) as usize];
                way((origin, [0, 1, 2].map(|a| target[a] - origin[a])), (0.0, 1.0 / 90.0, steps))
            })
            .collect();
        for (level, most) in levels().into_iter().flat_map(|level| [(level, usize::MAX), (level, 3)]) {
            let met = met(level, &grid, &ways, most);
            assert!(met.iter().filter(|met| met.len() >= most.min(4)).count() > 20);
            for (way, met) in ways.iter().zip(met) {
                let ray = (way.origin, way.direction);
                let depths = step_by_step(&grid, ray, (way.near, way.step, way.steps)).enumerate();
                let plain: Vec<(usize, f32)> = depths.filter(|(_, depth)| *depth > 0.0).take(most).collect();
                assert_eq!(met, plain, "{level:?}, {way:?}");
            }
        }
    }
}
