//! Surveys: the density grid is shown what the field holds where no ray looks (occupancy grids are updated so: Mueller et al. 2022,
//! appendix E.2).
//!
//! Rays show the grid what lies where it sends their samples. What it has forgotten it would hardly learn again, as corners that few
//! photographs show.

use std::ops::Range;

use rayon::prelude::*;
use relight_field::engine::StageCost;
use relight_field::random::Random;

use crate::aligned::Aligned;
use crate::dense::padded;
use crate::hash_grid::{TiledPositions, set_position};
use crate::samples::Marcher;
use crate::tile::Workspace;

/// Cells that are looked at together: those of a brick, in a survey of all.
const TOGETHER: usize = 512;

impl Marcher<'_> {
    /// Shows the density grid the density in the middle of one cell, which `random` draws, of each `of` that follow each other in its
    /// order of storage, `of` being a power of two up to a brick, but for hidden ones. Returns what that cost, but for the time.
    pub fn survey(&self, of: usize, random: Random) -> StageCost {
        debug_assert!(of.is_power_of_two() && of <= TOGETHER);
        let parts = self.density.resolution().pow(3) / of;
        let look_at = |(cells, positions, features): &mut (Vec<_>, Vec<_>, Aligned), range: Range<usize>| {
            cells.clear();
            cells.extend(range.map(|part| part * of + random.u64_at(part as u64) as usize % of));
            cells.retain(|&cell| !self.density.is_hidden(cell));
            if cells.is_empty() {
                return 0;
            }
            let columns = padded(cells.len());
            positions.clear();
            positions.resize(3 * columns, 0.5);
            for (column, &cell) in cells.iter().enumerate() {
                set_position(positions, column, self.density.middle(cell));
            }
            features.resize(self.networks.features * columns);
            self.grid.encode(self.simd, TiledPositions { data: positions, columns }, features);
            self.workspaces.with(Workspace::default, |workspace| {
                workspace.densities(self.simd, self.networks, features, columns);
                let looks = cells.iter().zip(&workspace.density);
                looks.for_each(|(&cell, &density)| self.density.observe(cell, density));
            });
            cells.len()
        };
        let looked_at =
            (0..parts.div_ceil(TOGETHER)).into_par_iter().map_init(Default::default, |memory, i| {
                look_at(memory, i * TOGETHER..parts.min((i + 1) * TOGETHER))
            });
        let looks = looked_at.sum();
        let mut cost = self.grid.encode_cost(looks);
        cost.operations += self.networks.geo.density_operations(looks) as f64;
        StageCost { updates: looks as f64, ..cost }
    }
}
