//! How fine a field has to be for the images that it is learnt from.

use relight_field::parameters::GridConfig;
use relight_scene::{Bounds, Camera};

/// Cells of the finest level to a pixel's width on the scene; the nearest power of two is taken.
const CELLS_A_PIXEL: f64 = 2.0;
/// Base-2 logarithms of the coarsest and finest resolution taken: the latter is torch-ngp's.
const RESOLUTIONS: [u32; 2] = [8, 11];
/// Levels: with four features each they give as many numbers of a position as torch-ngp's 16 of two, for half as many lookups.
const LEVELS: usize = 8;
/// Features an entry.
const FEATURES: usize = 4;
/// Doubling the resolution makes four times as many cells of a surface, half of which find room in twice the table:
/// 2^20 entries at 2048 cells, twice those of torch-ngp, since a level stands for two of its.
const TABLE: u32 = 9;

/// A grid for a field in the box `bounds`: as fine as the pixels of most cameras are there, and no finer, since every
/// level and every entry costs time. Where nothing can be told, torch-ngp's.
pub fn fitting_grid(cameras: &[Camera], bounds: &Bounds) -> GridConfig {
    let middle: [f64; 3] = std::array::from_fn(|a| f64::from(bounds.lo[a] + bounds.hi[a]) / 2.0);
    let mut widths: Vec<f64> = cameras
        .iter()
        .map(|camera| {
            let position = camera.pose.position();
            let distance = (0..3).map(|a| (position[a] - middle[a]).powi(2)).sum::<f64>().sqrt();
            distance / camera.intrinsics.fx.max(camera.intrinsics.fy)
        })
        .filter(|width| width.is_finite() && *width > 0.0)
        .collect();
    widths.sort_by(f64::total_cmp);
    let Some(width) = widths.get(widths.len() / 2) else { return GridConfig::default() };
    let cells = CELLS_A_PIXEL * f64::from(bounds.longest_edge()) / width;
    let resolution = (cells.log2().round().max(0.0) as u32).clamp(RESOLUTIONS[0], RESOLUTIONS[1]);
    GridConfig {
        levels: LEVELS,
        features: FEATURES,
        log2_table: resolution + TABLE,
        base: 8,
        finest: 1 << resolution,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use relight_scene::{Intrinsics, Pose};

    /// Cameras half a metre from the middle of a box of edge `edge`, with pictures of focal length `focal`.
    fn grid(edge: f32, focal: f64) -> GridConfig {
        let lens = Intrinsics {
            width: 320,
            height: 240,
            fx: focal,
            fy: focal,
            cx: 159.5,
            cy: 119.5,
            distortion: vec![],
        };
        let pose = Pose([[1.0, 0.0, 0.0, 0.5], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0]]);
        let camera = Camera { label: 0, intrinsics: lens, pose };
        fitting_grid(&[camera], &Bounds { lo: [-edge / 2.0; 3], hi: [edge / 2.0; 3] })
    }

    #[test]
    fn finer_pixels_ask_for_finer_grids_within_limits() {
        let sizes = |focal| {
            let grid = grid(0.6, focal);
            grid.validate().unwrap();
            (grid.finest, grid.log2_table, grid.outputs())
        };
        assert_eq!(sizes(500.0), (1024, 19, 32));
        assert_eq!(sizes(250.0), (512, 18, 32));
        assert_eq!(sizes(10.0), (256, 17, 32));
        assert_eq!(sizes(1000.0), (2048, 20, 32));
        assert_eq!(sizes(1e9), (2048, 20, 32));
        // Twice the box at the same distance: twice the cells.
        assert_eq!(grid(1.2, 250.0).finest, 1024);
        assert_eq!(grid(0.6, f64::NAN), GridConfig::default());
    }
}
