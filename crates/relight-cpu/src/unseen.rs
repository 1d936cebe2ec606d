//! What no camera has in view: cells of the density grid that stay empty for ever (as those of instant-ngp's
//! `mark_untrained_density_grid`).
//!
//! No photograph says anything of them. What the field holds there by chance would cast shadows all the same, and probes would
//! learn those.

use rayon::prelude::*;
use relight_scene::Frustum;

use crate::density_grid::{BRICK, BRICK_CELLS, DensityGrid};
use crate::march::UnitCube;

impl DensityGrid {
    /// Empties for ever all cells of `cube`, its box, of which nothing lies in any of `frusta`.
    pub fn hide_unseen(&mut self, cube: &UnitCube, frusta: &[Frustum]) {
        let place = |unit: [f32; 3]| cube.unmap(unit).map(f64::from);
        let corner = place([0.5 / self.resolution() as f32; 3]);
        let radius = place([0.0; 3]).iter().zip(corner).map(|(o, c)| (c - o).powi(2)).sum::<f64>().sqrt();
        let brick_radius = BRICK as f64 * radius;
        let bricks = self.resolution().pow(3) / BRICK_CELLS;
        (0..bricks).into_par_iter().for_each_init(Vec::new, |near, brick| {
            let cells = brick * BRICK_CELLS..(brick + 1) * BRICK_CELLS;
            // Half way from the first cell's middle to the last one's.
            let [first, last] = [cells.start, cells.end - 1].map(|cell| self.middle(cell));
            let middle = place([0, 1, 2].map(|a| 0.5 * (first[a] + last[a])));
            near.clear();
            for frustum in frusta {
                let depth = frustum.depth_of(middle);
                if depth >= brick_radius {
                    return;
                }
                if depth > -brick_radius {
                    near.push(frustum);
                }
            }
            for cell in cells {
                let middle = place(self.middle(cell));
                if near.iter().all(|frustum| frustum.depth_of(middle) <= -radius) {
                    self.hide(cell);
                }
            }
        });
        self.find_distances();
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use relight_scene::{Bounds, Camera, Intrinsics, Pose};

    const BOUNDS: Bounds = Bounds { lo: [-1.0, 0.0, 2.0], hi: [1.0, 0.8, 4.0] };

    fn frustum(position: [f64; 3], target: [f64; 3]) -> Frustum {
        let intrinsics = Intrinsics {
            width: 40,
            height: 30,
            fx: 150.0,
            fy: 150.0,
            cx: 19.5,
            cy: 14.5,
            distortion: Vec::new(),
        };
        Frustum::of(&Camera { label: 0, intrinsics, pose: Pose::look_at(position, target) })
    }

    /// By eight points of each cell or more, and by its middle.
    #[test]
    fn cells_are_empty_for_ever_if_no_camera_has_any_of_them_in_view() {
        let frusta = [frustum([3.0, 0.2, 5.0], [0.0, 0.4, 3.0]), frustum([0.0, -1.0, 3.0], [0.3, 0.4, 3.5])];
        let cube = UnitCube::new(&BOUNDS);
        let mut grid = DensityGrid::uniform(&BOUNDS, 32, 50.0);
        grid.hide_unseen(&cube, &frusta);
        let n = 32f32;
        // A sphere around a cell reaches beyond it by no more than this.
        let slack = 0.5 * (2f64.powi(2) + 0.8f64.powi(2) + 2f64.powi(2)).sqrt() / f64::from(n);
        let (mut hidden, mut seen) = (0, 0);
        for cell in 0..32 * 32 * 32 {
            let middle = grid.middle(cell);
            let depth = |unit: [f32; 3]| {
                let point = cube.unmap(unit).map(f64::from);
                frusta.iter().map(|frustum| frustum.depth_of(point)).fold(f64::NEG_INFINITY, f64::max)
            };
            let corners = (0..8).map(|i| [0, 1, 2].map(|a| middle[a] + (((i >> a) & 1) as f32 - 0.5) / n));
            let any = corners.chain([middle]).any(|point| depth(point) >= 0.0);
            if grid.is_hidden(cell) {
                hidden += 1;
                assert!(!any, "cell {cell} is in view");
                assert_eq!(grid.optical_depth(cell), 0.0);
            } else {
                seen += 1;
                assert!(depth(middle) > -slack, "cell {cell} is nowhere near what is in view");
                assert!(grid.optical_depth(cell) > 0.0);
            }
        }
        assert!(hidden > 10_000 && seen > 5_000, "{hidden} {seen}");
    }

    #[test]
    fn nothing_fills_hidden_cells() {
        let mut grid = DensityGrid::uniform(&BOUNDS, 16, 50.0);
        grid.hide_unseen(&UnitCube::new(&BOUNDS), &[frustum([0.0, -9.0, 0.0], [0.0, -10.0, 0.0])]);
        let empty = |grid: &DensityGrid| {
            (0..16 * 16 * 16).all(|cell| grid.is_hidden(cell) && grid.optical_depth(cell) == 0.0)
                && grid.to_occupied(0) > 0
        };
        assert!(empty(&grid));
        grid.observe(7, f32::INFINITY);
        grid.fill(1e9);
        grid.decay();
        assert!(empty(&grid));
        let mut other = DensityGrid::uniform(&BOUNDS, 16, 3.0);
        assert!(other.set_cells(&grid.cells()) && empty(&other));
    }
}
