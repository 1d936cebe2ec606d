//! Cells of the density grid that no camera has in view.

use relight_cpu::density_grid::DensityGrid;
use relight_cpu::march::UnitCube;
use relight_scene::Bounds;

use crate::common::view;

const BOUNDS: Bounds = Bounds { lo: [-1.0, 0.0, 2.0], hi: [1.0, 0.8, 4.0] };

/// By eight points of each cell or more, and by its middle.
#[test]
fn cells_are_empty_for_ever_if_no_camera_has_any_of_them_in_view() {
    let frusta = [view([3.0, 0.2, 5.0], [0.0, 0.4, 3.0], 0.1), view([0.0, -1.0, 3.0], [0.3, 0.4, 3.5], 0.1)];
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
    grid.hide_unseen(&UnitCube::new(&BOUNDS), &[view([0.0, -9.0, 0.0], [0.0, -10.0, 0.0], 0.1)]);
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
