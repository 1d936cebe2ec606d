//! Surveys: the density grid is shown what the field holds where no ray looks (occupancy grids are updated so: Mueller et al. 2022,
//! appendix E.2).
//!
//! Rays show the grid what lies where it sends their samples. What it has forgotten it would hardly learn again, and of what no
//! photograph shows it would know nothing, though the field continues there and pictures may show it.

use rayon::prelude::*;
use relight_field::engine::StageCost;
use relight_field::random::Random;

use crate::aligned::Aligned;
use crate::hash_grid::{TiledPositions, set_position};
use crate::samples::Marcher;
use crate::tile::Workspace;

/// Cells that are looked at together: those of a brick, in a survey of all.
const TOGETHER: usize = 512;

impl Marcher<'_> {
    /// Shows the density grid the density in the middle of one cell, which `random` draws, of each `of` that follow each other in its
    /// order of storage, `of` being a power of two up to a brick. Returns what that cost, but for the time.
    pub fn survey(&self, of: usize, random: Random) -> StageCost {
        debug_assert!(of.is_power_of_two() && of <= TOGETHER);
        let looks = self.density.resolution().pow(3) / of;
        (0..looks.div_ceil(TOGETHER)).into_par_iter().for_each_init(
            || (vec![0.5; 3 * TOGETHER], Aligned::default()),
            |(positions, features), part| {
                let cell = |look: usize| look * of + random.u64_at(look as u64) as usize % of;
                let cells = (part * TOGETHER..looks.min((part + 1) * TOGETHER)).map(cell);
                for (column, cell) in cells.clone().enumerate() {
                    set_position(positions, column, self.density.middle(cell));
                }
                features.resize(self.networks.features * TOGETHER);
                let tile = TiledPositions { data: positions, columns: TOGETHER };
                self.grid.encode(self.simd, tile, features);
                self.workspaces.with(Workspace::default, |workspace| {
                    workspace.densities(self.simd, self.networks, features, TOGETHER);
                    cells
                        .zip(&workspace.density)
                        .for_each(|(cell, &density)| self.density.observe(cell, density));
                });
            },
        );
        let mut cost = self.grid.encode_cost(looks);
        cost.operations += self.networks.geo.density_operations(looks) as f64;
        StageCost { updates: looks as f64, ..cost }
    }
}
