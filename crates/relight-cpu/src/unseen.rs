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
