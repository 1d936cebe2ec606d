//! A ray's way through the density grid, a step at a time, over all bricks in which nothing is.

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
    /// The share of a brick before the ray: this, and so many times the share at lower coordinates.
    ahead: f32x4<S>,
    within: f32x4<S>,
    near: f32,
    step: f32,
    steps_a_metre: f32,
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
            ahead: forward.select(one, zero),
            within: forward.select(zero - one, one),
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
            let ahead = (self.within.mul_add(within, self.ahead) + around) * self.crossing;
            let [x, y, z, _]: [f32; 4] = ahead.into();
            let nearer = |a: f32, b: f32| if a < b { a } else { b };
            let steps = nearer(nearer(x, y), z) * self.steps_a_metre;
            self.next = self.next.saturating_add((steps as usize).max(1));
        }
        None
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dense::tests::levels;
    use crate::march::UnitCube;
    use crate::march::tests::{BOUNDS, direction, origin};
    use fearless_simd::{Level, dispatch};
    use proptest::prelude::*;

    fn walk(
        level: Level,
        grid: &DensityGrid,
        ray: ([f32; 3], [f32; 3]),
        steps: (f32, f32, usize),
    ) -> Vec<(usize, f32)> {
        dispatch!(level, simd => Walk::new(simd, grid, ray, steps).collect())
    }

    proptest! {
        #[test]
        fn what_is_stepped_over_is_empty(
            origin in origin(), direction in direction(),
            occupied in proptest::collection::vec(0usize..64 * 64 * 64, 0..40), flat in any::<[bool; 3]>(),
        ) {
            let (cube, grid) = (UnitCube::new(&BOUNDS), DensityGrid::uniform(&BOUNDS, 64, 0.0));
            occupied.iter().for_each(|&cell| grid.observe(cell, 500.0));
            let direction = [0, 1, 2].map(|a| if flat[a] { 0.0 } else { direction[a] });
            let (near, far) = cube.clip(origin, direction);
            let (o, d, step) = (cube.map(origin), cube.map_direction(direction), 0.7 * grid.cell_size());
            let steps = ((far - near) / step).ceil() as usize;
            for level in levels() {
                let mut met = walk(level, &grid, (o, d), (near, step, steps)).into_iter().peekable();
                for i in 0..steps {
                    let at = near + (i as f32 + 0.5) * step;
                    let place: [f32; 3] = std::array::from_fn(|a| o[a] + at * d[a]);
                    // On the face between two cells, either is right.
                    let cells = place.map(|u| [u - 1e-5, u + 1e-5]);
                    let around = (0..8).map(|i| [0, 1, 2].map(|a| cells[a][i >> a & 1]));
                    let depths: Vec<f32> = around.map(|u| grid.optical_depth(grid.cell(u))).collect();
                    let depth = met.next_if(|&(step, _)| step == i).map_or(0.0, |(_, depth)| depth);
                    prop_assert!(depths.contains(&depth), "{i}: {depth} is none of {depths:?}");
                }
                prop_assert_eq!(met.next(), None);
            }
        }
    }

    /// A ray along x through one occupied brick of eight.
    #[test]
    fn whole_bricks_are_stepped_over() {
        let grid = DensityGrid::uniform(&BOUNDS, 64, 0.0);
        grid.observe(grid.cell([0.3, 0.5, 0.5]), 500.0);
        for (level, backward) in levels().into_iter().flat_map(|l| [(l, false), (l, true)]) {
            let ray = if backward {
                ([1.0, 0.5, 0.5], [-1.0, 0.0, 0.0])
            } else {
                ([0.0, 0.5, 0.5], [1.0, 0.0, 0.0])
            };
            let met: Vec<usize> =
                walk(level, &grid, ray, (0.0, 1.0 / 64.0, 64)).into_iter().map(|(step, _)| step).collect();
            let brick = if backward { 40..48 } else { 16..24 };
            assert_eq!(met, brick.collect::<Vec<_>>(), "{level:?}");
        }
    }
}
