//! A coarse picture of where density is, which decides where samples go (the occupancy grid of Instant-NGP,
//! section 4 of Mueller et al. 2022, holding densities instead of bits).

use std::sync::atomic::{AtomicU8, Ordering};

use fearless_simd::{Simd, i32x16, prelude::*};
use rayon::prelude::*;
use relight_scene::Bounds;

use crate::huge_pages;
use crate::prefetch::ask;

/// Cells an axis of a brick.
pub const BRICK: usize = 8;
/// Cells of a brick.
pub const BRICK_CELLS: usize = BRICK * BRICK * BRICK;
const _: () = assert!(BRICK.is_power_of_two());
/// Bits of a density that a code does without: its last 20, so that three of the mantissa stay.
const DROPPED_BITS: u32 = 20;
/// What stands for nothing at all, in those bits that stay: 1/64 per metre.
const NOTHING: u32 = (127 - 6) << 3;
/// Code of a cell that stays empty for ever. No density has it, and none is above it: nothing raises such a cell.
pub(crate) const HIDDEN: u8 = 255;

/// Densities on a regular grid of cells over the field's box.
///
/// A cell is one byte, a floating-point number with five bits of exponent and three of mantissa, so that the grid stays in
/// cache, or the mark of one that stays empty for ever; forgetting is subtraction. Any number of threads may show it densities at
/// once: cells only rise, and so come out the same in any order.
/// Cells are stored brick by brick, so that a ray meets few cache lines, and each brick knows how far the nearest brick is in
/// which something is, so that rays step over all that is empty.
pub struct DensityGrid {
    /// Bricks an axis.
    bricks: usize,
    /// Shortest edge of a cell, metres.
    cell_size: f32,
    /// Codes; bricks x fastest, and cells within a brick likewise.
    cells: Vec<AtomicU8>,
    /// Bricks from each brick to the nearest one that is not empty, along the axis on which they are farthest apart: 0 for
    /// those themselves, and at most [`FARTHEST`].
    distance: Vec<AtomicU8>,
    /// Optical depth of a cell's edge, by code; 0 for what is too thin to count.
    optical: [f32; 256],
}

/// Optical depths of a cell below which all rays ignore it; those of pictures ignore more.
const THIN: f32 = 1e-3;
/// Largest distance between bricks that is told from larger ones.
const FARTHEST: u8 = 4;

impl DensityGrid {
    /// A grid of `resolution` cells an axis (a multiple of 8) with the same density (per metre) everywhere.
    pub fn uniform(bounds: &Bounds, resolution: usize, density: f32) -> Self {
        let bricks = resolution / BRICK;
        let shortest = (0..3).map(|a| bounds.hi[a] - bounds.lo[a]).fold(f32::INFINITY, f32::min);
        let cell_size = shortest / (bricks * BRICK) as f32;
        let optical = std::array::from_fn(|code| {
            let depth = f32::from_bits((code as u32 + NOTHING) << DROPPED_BITS) * cell_size;
            if code == 0 || code == usize::from(HIDDEN) || depth < THIN { 0.0 } else { depth }
        });
        let zeros = |n: usize| huge_pages::collect((0..n).map(|_| AtomicU8::new(0)));
        let (cells, distance) = (zeros(bricks.pow(3) * BRICK_CELLS), zeros(bricks.pow(3)));
        let mut grid = Self { bricks, cell_size, cells, distance, optical };
        grid.fill(density);
        grid
    }

    /// Shortest edge of a cell, metres: the step at which rays look at the grid.
    pub fn cell_size(&self) -> f32 {
        self.cell_size
    }

    /// Cells an axis.
    pub fn resolution(&self) -> usize {
        self.bricks * BRICK
    }

    /// All cells, in the order of storage.
    pub fn cells(&self) -> Vec<u8> {
        self.cells.iter().map(get).collect()
    }

    /// Replaces all cells; false if they are not as many.
    pub fn set_cells(&mut self, cells: &[u8]) -> bool {
        let fits = cells.len() == self.cells.len();
        if fits {
            self.cells.iter_mut().zip(cells).for_each(|(mine, &cell)| *mine.get_mut() = cell);
            self.find_distances();
        }
        fits
    }

    /// Sets all cells to one density, but for hidden ones.
    pub fn fill(&mut self, density: f32) {
        let code = code(density);
        let cells = self.cells.iter_mut().map(AtomicU8::get_mut);
        cells.filter(|cell| **cell != HIDDEN).for_each(|cell| *cell = code);
        self.find_distances();
    }

    /// Empties a cell for ever; [`DensityGrid::find_distances`] has to follow.
    pub(crate) fn hide(&self, cell: usize) {
        self.cells[cell].store(HIDDEN, Ordering::Relaxed);
    }

    /// Whether a cell stays empty for ever.
    pub fn is_hidden(&self, cell: usize) -> bool {
        get(&self.cells[cell]) == HIDDEN
    }

    /// The cell of a position in the unit cube; positions outside belong to the nearest.
    pub fn cell(&self, unit: [f32; 3]) -> usize {
        // Signed: processors convert to those at once.
        let cells = self.resolution() as i32;
        self.cell_at(unit.map(|u| ((u * cells as f32) as i32).clamp(0, cells - 1) as usize))
    }

    /// The cell at a place counted in cells along the three axes.
    pub fn cell_at(&self, [x, y, z]: [usize; 3]) -> usize {
        let brick = x / BRICK + self.bricks * (y / BRICK + self.bricks * (z / BRICK));
        brick * BRICK_CELLS + x % BRICK + BRICK * (y % BRICK + BRICK * (z % BRICK))
    }

    /// The same at sixteen places; those outside belong to the nearest cell.
    #[inline(always)]
    pub fn cells_at<S: Simd>(&self, simd: S, place: [i32x16<S>; 3]) -> i32x16<S> {
        let (zero, last) = (i32x16::splat(simd, 0), i32x16::splat(simd, self.resolution() as i32 - 1));
        // One by one: through a closure, vectors would go through memory.
        let [x, y, z] = place;
        let [x, y, z] = [x.max(zero).min(last), y.max(zero).min(last), z.max(zero).min(last)];
        let (bits, low) = (BRICK.trailing_zeros(), i32x16::splat(simd, BRICK as i32 - 1));
        let bricks = i32x16::splat(simd, self.bricks as i32);
        let brick = (x >> bits) + bricks * ((y >> bits) + bricks * (z >> bits));
        let within = (x & low) + (((y & low) + ((z & low) << bits)) << bits);
        (brick << (3 * bits)) + within
    }

    /// The middle of a cell, in the unit cube.
    pub fn middle(&self, cell: usize) -> [f32; 3] {
        let place = |i: usize, n: usize| [i % n, i / n % n, i / (n * n)];
        let (brick, within) = (place(cell / BRICK_CELLS, self.bricks), place(cell % BRICK_CELLS, BRICK));
        let cells = self.resolution() as f32;
        std::array::from_fn(|a| ((BRICK * brick[a] + within[a]) as f32 + 0.5) / cells)
    }

    /// Bricks from that of a cell to the nearest one in which something is thick enough to count, along the axis on which they are
    /// farthest apart; larger distances than a few bricks are not told apart.
    pub fn to_occupied(&self, cell: usize) -> u8 {
        get(&self.distance[cell / BRICK_CELLS])
    }

    /// Optical depth of one step through a cell; 0 where that is too thin to count.
    pub fn optical_depth(&self, cell: usize) -> f32 {
        self.optical[usize::from(get(&self.cells[cell]))]
    }

    /// Asks memory for a cell that will be wanted soon.
    pub fn ask(&self, cell: usize) {
        ask(&self.cells, cell);
    }

    /// Raises a cell to a density (per metre) seen in it, unless it is hidden.
    pub fn observe(&self, cell: usize, density: f32) {
        let code = code(density);
        if code <= get(&self.cells[cell]) {
            return;
        }
        self.cells[cell].fetch_max(code, Ordering::Relaxed);
        let brick = cell / BRICK_CELLS;
        if get(&self.distance[brick]) > 0 && self.counts(code) {
            self.bring_near(brick);
        }
    }

    /// Lets all cells forget: their densities fall by about an eighth of an octave (to 92 %).
    pub fn decay(&mut self) {
        self.lower(1);
    }

    /// Whether a cell of this code is thick enough to count.
    fn counts(&self, code: u8) -> bool {
        self.optical[usize::from(code)] != 0.0
    }

    /// Tells the bricks around that this one is no longer empty.
    fn bring_near(&self, brick: usize) {
        let (n, far) = (self.bricks, usize::from(FARTHEST) - 1);
        let [x, y, z] = [brick % n, brick / n % n, brick / (n * n)];
        let around = |i: usize| i.saturating_sub(far)..(i + far + 1).min(n);
        for near_z in around(z) {
            for near_y in around(y) {
                let apart = near_z.abs_diff(z).max(near_y.abs_diff(y));
                for near_x in around(x) {
                    let distance = &self.distance[near_x + n * (near_y + n * near_z)];
                    distance.fetch_min(apart.max(near_x.abs_diff(x)) as u8, Ordering::Relaxed);
                }
            }
        }
    }

    /// Finds all distances between bricks anew.
    pub(crate) fn find_distances(&mut self) {
        self.lower(0);
    }

    /// Lowers all codes by `codes`, and finds all distances anew: along each axis in turn, the larger of how far to go and
    /// of what is known there.
    fn lower(&mut self, codes: u8) {
        let Self { bricks, cells, distance, optical, .. } = self;
        distance.par_iter_mut().zip(cells.par_chunks_mut(BRICK_CELLS)).for_each(|(distance, cells)| {
            // Not by `get`: compilers make vectors of what nobody else can read meanwhile.
            let lowered = cells.iter_mut().map(|cell| {
                let cell = cell.get_mut();
                let hidden = *cell == HIDDEN;
                *cell = if hidden { HIDDEN } else { cell.saturating_sub(codes) };
                if hidden { 0 } else { *cell }
            });
            let largest = lowered.fold(0, u8::max);
            *distance.get_mut() = if optical[usize::from(largest)] != 0.0 { 0 } else { FARTHEST };
        });
        for stride in [1, *bricks, *bricks * *bricks] {
            let known: Vec<u8> = distance.iter().map(get).collect();
            for (brick, distance) in distance.iter_mut().enumerate() {
                let (at, distance) = (brick / stride % *bricks, distance.get_mut());
                for apart in 1..FARTHEST {
                    let step = usize::from(apart);
                    let before = if at >= step { known[brick - step * stride] } else { FARTHEST };
                    let after = if at + step < *bricks { known[brick + step * stride] } else { FARTHEST };
                    *distance = (*distance).min(apart.max(before.min(after)));
                }
            }
        }
    }
}

fn get(byte: &AtomicU8) -> u8 {
    byte.load(Ordering::Relaxed)
}

/// The code of a density (per metre).
fn code(density: f32) -> u8 {
    // To the nearest. Neither -0.0 nor what is not a number is above zero.
    let density = if density > 0.0 { density } else { 0.0 };
    let kept = (density.to_bits() + (1 << (DROPPED_BITS - 1))) >> DROPPED_BITS;
    kept.saturating_sub(NOTHING).min(u32::from(HIDDEN) - 1) as u8
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const BOUNDS: Bounds = Bounds { lo: [-1.0, 0.0, 2.0], hi: [1.0, 0.8, 4.0] };

    proptest! {
        #[test]
        fn bricks_know_how_far_the_nearest_is_that_is_not_empty(
            occupied in proptest::collection::vec([0usize..8, 0usize..8, 0usize..8], 0..4),
        ) {
            let mut grid = of_bricks(&occupied);
            for brick in (0..512).map(|i| [i % 8, i / 8 % 8, i / 64]) {
                let apart = |o: &[usize; 3]| (0..3).map(|a| o[a].abs_diff(brick[a])).max();
                let nearest = occupied.iter().filter_map(apart).min().unwrap_or(8).min(4);
                let cell = grid.cell_at(brick.map(|b| 8 * b + 5));
                prop_assert_eq!(usize::from(grid.to_occupied(cell)), nearest);
            }
            // Found anew, distances are what they had become one by one.
            let known: Vec<u8> = grid.distance.iter().map(get).collect();
            let cells = grid.cells();
            grid.fill(5.0);
            grid.set_cells(&cells);
            prop_assert_eq!(grid.distance.iter().map(get).collect::<Vec<u8>>(), known);
        }
    }

    /// A grid of eight bricks an axis that is empty but for a cell in each of these.
    fn of_bricks(bricks: &[[usize; 3]]) -> DensityGrid {
        let grid = DensityGrid::uniform(&BOUNDS, 64, 0.0);
        for brick in bricks {
            let cell = grid.cell(brick.map(|b| (b as f32 + 0.6) / 8.0));
            grid.observe(cell, 1000.0);
        }
        grid
    }

    fn grid(density: f32) -> DensityGrid {
        DensityGrid::uniform(&BOUNDS, 16, density)
    }

    /// Middle of the cell `[x, y, z]` of a grid of 16 cells an axis.
    fn middle(cell: [usize; 3]) -> [f32; 3] {
        cell.map(|i| (i as f32 + 0.5) / 16.0)
    }

    /// Density of a cell, per metre.
    fn density(grid: &DensityGrid, cell: usize) -> f32 {
        grid.optical_depth(cell) / grid.cell_size()
    }

    /// Whether a density is another's, as well as a cell can tell.
    fn is(density: f32, expected: f32) -> bool {
        (density / expected - 1.0).abs() <= 0.0626
    }

    #[test]
    fn each_place_has_a_cell_of_its_own() {
        let grid = grid(3.0);
        let mut seen = vec![false; 16 * 16 * 16];
        for i in 0..seen.len() {
            let cell = grid.cell(middle([i % 16, i / 16 % 16, i / 256]));
            assert!(!std::mem::replace(&mut seen[cell], true));
            assert!(is(density(&grid, cell), 3.0));
            assert_eq!(grid.middle(cell), middle([i % 16, i / 16 % 16, i / 256]));
        }
        assert_eq!(grid.cells().len(), seen.len());
        assert_eq!(grid.cell_size(), 0.05);
    }

    #[test]
    fn places_outside_belong_to_the_nearest_cell() {
        let grid = grid(3.0);
        assert_eq!(grid.cell([-5.0, 0.5, 1.0]), grid.cell(middle([0, 8, 15])));
        assert_eq!(grid.cell([1.0, f32::INFINITY, -1e30]), grid.cell(middle([15, 15, 0])));
        assert!(grid.cell([f32::NAN; 3]) < grid.cells().len());
    }

    #[test]
    fn densities_of_all_magnitudes_are_kept_and_extremes_are_harmless() {
        for expected in [0.1, 1.0, 7.3, 500.0, 1e5, 1e7] {
            let grid = grid(0.0);
            grid.observe(9, expected);
            assert!(is(density(&grid, 9), expected), "{expected}");
        }
        for nothing in [0.0, -0.0, -1.0, f32::NAN, 1e-30] {
            let grid = grid(nothing);
            grid.observe(9, nothing);
            assert_eq!(grid.optical_depth(9), 0.0, "{nothing}");
        }
        for opaque in [1e30, f32::INFINITY] {
            let depth = grid(opaque).optical_depth(9);
            assert!(depth.is_finite() && depth > 1e5, "{opaque}");
        }
    }

    #[test]
    fn observing_raises_a_cell_and_never_lowers_it() {
        let grid = grid(3.0);
        let (cell, neighbour) = (grid.cell(middle([3, 4, 5])), grid.cell(middle([4, 4, 5])));
        grid.observe(cell, 2.0);
        assert!(is(density(&grid, cell), 3.0));
        grid.observe(cell, 7.0);
        assert!(is(density(&grid, cell), 7.0) && is(density(&grid, neighbour), 3.0));
    }

    #[test]
    fn cells_forget_until_they_are_empty() {
        let mut grid = grid(3.0);
        let cell = grid.cell(middle([3, 4, 5]));
        grid.observe(cell, 100.0);
        for _ in 0..8 {
            grid.decay();
        }
        // Eight eighths of an octave.
        assert!(is(density(&grid, cell), 50.0) && is(density(&grid, 0), 1.5));
        // The thin cells of a brick do not hide its dense one, and are nothing themselves.
        grid.fill(1e-3);
        grid.observe(cell, 100.0);
        assert!(is(density(&grid, cell), 100.0));
        assert_eq!(grid.optical_depth(grid.cell(middle([7, 7, 7]))), 0.0);
        for _ in 0..256 {
            grid.decay();
        }
        assert_eq!(grid.cells(), [0; 4096]);
        assert_eq!(grid.optical_depth(cell), 0.0);
    }

    #[test]
    fn cells_return_as_they_were() {
        let grid = grid(3.0);
        grid.observe(100, 9.0);
        let mut other = self::grid(0.0);
        assert!(!other.set_cells(&grid.cells()[1..]));
        assert_eq!(other.optical_depth(100), 0.0);
        assert!(other.set_cells(&grid.cells()));
        assert_eq!(other.cells(), grid.cells());
        assert_eq!(other.optical_depth(100), grid.optical_depth(100));
    }
}
