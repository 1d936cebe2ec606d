//! A ray's way through the density grid, a step at a time, over all bricks in which nothing is: empty-space skipping.

use fearless_simd::{Simd, f32x4, i32x4, prelude::*};

use crate::density_grid::{BRICK, DensityGrid};

/// The steps of a ray at which something may be: each with the optical depth of the cell that the ray meets in its middle, as long
/// as a cell's edge. The three axes, and one that stands still, are the lanes of vectors.
pub struct Walk<'a, S: Simd> {
    simd: S,
    grid: &'a DensityGrid,
    /// Where the ray is at distance 0, in cells.
    origin: f32x4<S>,
    /// How far it goes a metre, in cells.
    direction: f32x4<S>,
    /// Distances from one face of a brick to the opposite one, metres; a huge number for faces that the ray runs along.
    crossing: f32x4<S>,
    /// Of a brick, the share that the ray has before it is `offset + sign * (share at lower coordinates)`: 1 where it goes to
    /// higher ones, else 0.
    offset: f32x4<S>,
    /// -1 where the ray goes to higher coordinates, else 1.
    sign: f32x4<S>,
    /// Where the first step begins, metres.
    near: f32,
    /// Length of a step, metres, and its inverse.
    step: f32,
    steps_a_metre: f32,
    /// The step that is looked at next, of all steps.
    next: usize,
    steps: usize,
}

impl<'a, S: Simd> Walk<'a, S> {
    /// `steps` steps of length `step` from `near` on, metres, of the ray from `origin` along `direction` (a metre) in the unit
    /// cube.
    #[inline(always)]
    pub fn new(
        simd: S,
        grid: &'a DensityGrid,
        (origin, direction): ([f32; 3], [f32; 3]),
        (near, step, steps): (f32, f32, usize),
    ) -> Self {
        let lanes = |[x, y, z]: [f32; 3], rest| f32x4::simd_from(simd, [x, y, z, rest]);
        let cells = f32x4::splat(simd, grid.resolution() as f32);
        let direction = lanes(direction, 0.0) * cells;
        let [zero, one] = [0.0, 1.0].map(|v| f32x4::splat(simd, v));
        let forward = direction.simd_ge(zero);
        let length = direction.max(zero - direction);
        let crossing = f32x4::splat(simd, BRICK as f32) / length;
        Self {
            simd,
            grid,
            origin: lanes(origin, 0.0) * cells,
            direction,
            crossing: crossing.min(f32x4::splat(simd, f32::MAX)),
            offset: forward.select(one, zero),
            sign: forward.select(zero - one, one),
            near,
            step,
            steps_a_metre: 1.0 / step,
            next: 0,
            steps,
        }
    }
}

impl<S: Simd> Iterator for Walk<'_, S> {
    type Item = (usize, f32);

    #[inline(always)]
    fn next(&mut self) -> Option<(usize, f32)> {
        let (simd, last) = (self.simd, self.grid.resolution() as i32 - 1);
        while self.next < self.steps {
            let at = self.near + (self.next as f32 + 0.5) * self.step;
            let place = self.direction.mul_add(f32x4::splat(simd, at), self.origin);
            // Only a ray that misses the box may be beyond what 32 bits hold, and to that any cell will do.
            let cell = place.to_int::<i32x4<S>>();
            let cell = cell.max(i32x4::splat(simd, 0)).min(i32x4::splat(simd, last));
            let [x, y, z, _]: [i32; 4] = cell.into();
            let cell = self.grid.cell_at([x, y, z].map(|c| c as usize));
            let distance = self.grid.to_occupied(cell);
            if distance == 0 {
                self.next += 1;
                return Some((self.next - 1, self.grid.optical_depth(cell)));
            }
            // All bricks nearer than that are empty as well.
            let around = f32x4::splat(simd, f32::from(distance - 1));
            let bricks = place * f32x4::splat(simd, 1.0 / BRICK as f32);
            let within = bricks - bricks.trunc();
            let ahead = (self.sign.mul_add(within, self.offset) + around) * self.crossing;
            let [x, y, z, _]: [f32; 4] = ahead.into();
            let nearer = |a: f32, b: f32| if a < b { a } else { b };
            let steps = nearer(nearer(x, y), z) * self.steps_a_metre;
            self.next = self.next.saturating_add((steps as usize).max(1));
        }
        None
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use crate::dense::tests::levels;
    use crate::march::UnitCube;
    use crate::march::tests::{BOUNDS, origin};
    use fearless_simd::{Level, dispatch};
    use proptest::prelude::*;

    /// An origin and a direction.
    pub(crate) type Ray = ([f32; 3], [f32; 3]);

    fn walk(level: Level, grid: &DensityGrid, ray: Ray, steps: (f32, f32, usize)) -> Vec<(usize, f32)> {
        dispatch!(level, simd => Walk::new(simd, grid, ray, steps).collect())
    }

    /// The depth of each step, one axis after the other and without stepping over anything.
    pub(crate) fn step_by_step(
        grid: &DensityGrid,
        (o, d): Ray,
        (near, step, steps): (f32, f32, usize),
    ) -> impl Iterator<Item = f32> {
        let cells = grid.resolution() as f32;
        (0..steps).map(move |i| {
            let at = near + (i as f32 + 0.5) * step;
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
                let met = walk(level, &grid, (o, d), (near, step, steps));
                prop_assert!(met.iter().any(|&(_, depth)| depth > 0.0));
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

    /// Rays along each axis, both ways, through one occupied brick of eight.
    #[test]
    fn whole_bricks_are_stepped_over() {
        let rays = (0..3).flat_map(|axis| [(axis, false), (axis, true)]);
        for (level, (axis, backward)) in rays.flat_map(|ray| levels().into_iter().map(move |l| (l, ray))) {
            let at = |coordinate| {
                let mut place = [0.5; 3];
                place[axis] = coordinate;
                place
            };
            let grid = DensityGrid::uniform(&BOUNDS, 64, 0.0);
            grid.observe(grid.cell(at(0.3)), 500.0);
            let mut direction = [0.0; 3];
            direction[axis] = if backward { -1.0 } else { 1.0 };
            let ray = (at(if backward { 1.0 } else { 0.0 }), direction);
            let met = walk(level, &grid, ray, (0.0, 1.0 / 64.0, 64));
            let brick = if backward { 40..48 } else { 16..24 };
            assert!(met.into_iter().map(|(step, _)| step).eq(brick), "{level:?}, axis {axis}, {backward}");
        }
    }
}
