//! A coarse picture of where density is, which decides where samples go (the occupancy grid of Instant-NGP,
//! section 4 of Mueller et al. 2022, holding densities instead of bits).

use rayon::prelude::*;
use relight_scene::Bounds;

/// Densities on a regular grid of cells over the field's box.
pub struct DensityGrid {
    bounds: Bounds,
    /// Cells an axis.
    resolution: usize,
    /// Density per metre, x fastest.
    cells: Vec<f32>,
}

impl DensityGrid {
    /// A grid with the same density (per metre) everywhere.
    pub fn uniform(bounds: Bounds, resolution: usize, density: f32) -> Self {
        Self { bounds, resolution, cells: vec![density; resolution.pow(3)] }
    }

    /// Cells an axis.
    pub fn resolution(&self) -> usize {
        self.resolution
    }

    /// Shortest edge of a cell, metres.
    pub fn cell_size(&self) -> f32 {
        let extent = |a: usize| self.bounds.hi[a] - self.bounds.lo[a];
        extent(0).min(extent(1)).min(extent(2)) / self.resolution as f32
    }

    /// All cells, x fastest.
    pub fn cells(&self) -> &[f32] {
        &self.cells
    }

    /// All cells, to be changed.
    pub fn cells_mut(&mut self) -> &mut [f32] {
        &mut self.cells
    }

    /// The cell of a position in the unit cube.
    pub fn cell(&self, unit: [f32; 3]) -> usize {
        let n = self.resolution;
        let axis = |x: f32| ((x * n as f32) as usize).min(n - 1);
        axis(unit[0]) + n * (axis(unit[1]) + n * axis(unit[2]))
    }

    /// Density at a position in the unit cube.
    pub fn at(&self, unit: [f32; 3]) -> f32 {
        self.cells[self.cell(unit)]
    }

    /// Raises a cell to a density seen in it.
    pub fn observe(&mut self, cell: usize, density: f32) {
        let value = &mut self.cells[cell];
        *value = value.max(density);
    }

    /// Lets all cells forget: multiplies them by `factor`.
    pub fn decay(&mut self, factor: f32) {
        self.cells.par_chunks_mut(1 << 16).for_each(|chunk| chunk.iter_mut().for_each(|c| *c *= factor));
    }
}
