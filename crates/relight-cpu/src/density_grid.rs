//! A coarse picture of where density is, which decides where samples go (the occupancy grid of Instant-NGP,
//! section 4 of Mueller et al. 2022, holding densities instead of bits).

use rayon::prelude::*;
use relight_scene::Bounds;

/// Cells an axis of a brick.
const BRICK: usize = 8;
/// Cells of a brick.
const BRICK_CELLS: usize = BRICK * BRICK * BRICK;

/// Densities on a regular grid of cells over the field's box.
///
/// Cells are stored brick by brick, so that a ray meets few cache lines, and each brick knows its largest density,
/// so that rays step over empty ones.
pub struct DensityGrid {
    /// Bricks an axis.
    bricks: usize,
    /// Shortest edge of a cell, metres.
    cell_size: f32,
    /// Density per metre; bricks x fastest, and cells within a brick likewise.
    cells: Vec<f32>,
    /// At least the largest density of each brick.
    largest: Vec<f32>,
}

impl DensityGrid {
    /// A grid of `resolution` cells an axis (a multiple of 8) with the same density (per metre) everywhere.
    pub fn uniform(bounds: &Bounds, resolution: usize, density: f32) -> Self {
        let bricks = resolution / BRICK;
        let shortest = (0..3).map(|a| bounds.hi[a] - bounds.lo[a]).fold(f32::INFINITY, f32::min);
        Self {
            bricks,
            cell_size: shortest / (bricks * BRICK) as f32,
            cells: vec![density; bricks.pow(3) * BRICK_CELLS],
            largest: vec![density; bricks.pow(3)],
        }
    }

    /// Shortest edge of a cell, metres.
    pub fn cell_size(&self) -> f32 {
        self.cell_size
    }

    /// All cells, in the order of storage.
    pub fn cells(&self) -> &[f32] {
        &self.cells
    }

    /// Replaces all cells; false if they are not as many.
    pub fn set_cells(&mut self, cells: Vec<f32>) -> bool {
        let fits = cells.len() == self.cells.len();
        if fits {
            self.cells = cells;
            self.find_largest();
        }
        fits
    }

    /// Sets all cells to one density.
    pub fn fill(&mut self, density: f32) {
        self.cells.fill(density);
        self.largest.fill(density);
    }

    /// The cell of a position in the unit cube; positions outside belong to the nearest.
    pub fn cell(&self, unit: [f32; 3]) -> usize {
        let cells = self.bricks * BRICK;
        let [x, y, z] = unit.map(|u| ((u * cells as f32) as usize).min(cells - 1));
        let brick = x / BRICK + self.bricks * (y / BRICK + self.bricks * (z / BRICK));
        brick * BRICK_CELLS + x % BRICK + BRICK * (y % BRICK + BRICK * (z % BRICK))
    }

    /// Density of a cell, or `None` if all of its brick is thinner than `least`.
    pub fn at(&self, cell: usize, least: f32) -> Option<f32> {
        (self.largest[cell / BRICK_CELLS] >= least).then(|| self.cells[cell])
    }

    /// Raises a cell to a density seen in it.
    pub fn observe(&mut self, cell: usize, density: f32) {
        let value = &mut self.cells[cell];
        *value = value.max(density);
        let largest = &mut self.largest[cell / BRICK_CELLS];
        *largest = largest.max(density);
    }

    /// Lets all cells forget: multiplies them by `factor`.
    pub fn decay(&mut self, factor: f32) {
        self.cells.par_chunks_mut(1 << 16).for_each(|chunk| chunk.iter_mut().for_each(|c| *c *= factor));
        self.find_largest();
    }

    fn find_largest(&mut self) {
        self.largest.par_iter_mut().zip(self.cells.par_chunks(BRICK_CELLS)).for_each(|(largest, cells)| {
            *largest = cells.iter().copied().fold(0.0, f32::max);
        });
    }
}
