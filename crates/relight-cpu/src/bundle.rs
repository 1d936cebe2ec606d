//! Bundles of rays: what the density grid tells one ray, it tells those close beside it.
//!
//! Rays of neighbouring pixels go through the same cells nearly all the way. Where pictures are drawn, which need no random
//! samples, the first of a bundle looks at the grid and the others take their samples where it does.

use crate::density_grid::DensityGrid;
use crate::guide::{GuideScratch, guided};
use crate::march::UnitCube;

/// Cells of the density grid that a ray may be away from the first of its bundle.
const WIDTH: f32 = 0.5;

/// The ray that was looked along last, and memory for the next.
#[derive(Default)]
pub struct Bundle {
    /// Origin and direction; `None` before the first ray.
    first: Option<([f32; 3], [f32; 3])>,
    /// Its samples, metres.
    t: Vec<f32>,
    scratch: GuideScratch,
}

impl Bundle {
    /// Begins anew: other rays, or another field.
    pub fn clear(&mut self) {
        self.first = None;
    }

    /// Places the samples of the next ray, as [`guided`] does, or where those of its bundle's first ray are.
    pub fn place(
        &mut self,
        grid: &DensityGrid,
        cube: &UnitCube,
        ray: ([f32; 3], [f32; 3]),
        span: (f32, f32),
        jitter: Option<&dyn Fn(usize) -> f32>,
        t: &mut [f32],
    ) {
        if jitter.is_none() && self.holds(ray, span.1, grid.cell_size()) && self.t.len() == t.len() {
            t.iter_mut().zip(&self.t).for_each(|(t, first)| *t = first.clamp(span.0, span.1));
            if let Some(last) = t.last_mut() {
                *last = span.1;
            }
            return;
        }
        guided(grid, cube, ray, span, jitter, &mut self.scratch, t);
        self.first = Some(ray);
        self.t.clear();
        self.t.extend_from_slice(t);
    }

    /// Whether a ray stays close to the first of the bundle for `far` metres.
    fn holds(&self, (origin, direction): ([f32; 3], [f32; 3]), far: f32, cell: f32) -> bool {
        self.first.is_some_and(|(first_origin, first_direction)| {
            let apart =
                direction.iter().zip(first_direction).map(|(a, b)| (a - b).powi(2)).sum::<f32>().sqrt();
            origin == first_origin && apart * far <= WIDTH * cell
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::march::tests::{BOUNDS, assert_ascends, assert_tiles};
    use relight_field::random::Random;

    /// Samples of a ray by itself.
    fn alone(grid: &DensityGrid, ray: ([f32; 3], [f32; 3]), span: (f32, f32), n: usize) -> Vec<f32> {
        let mut t = vec![f32::NAN; n];
        Bundle::default().place(grid, &UnitCube::new(&BOUNDS), ray, span, None, &mut t);
        t
    }

    #[test]
    fn rays_take_the_samples_of_the_first_as_long_as_they_are_close() {
        let (cube, grid) = (UnitCube::new(&BOUNDS), DensityGrid::uniform(&BOUNDS, 64, 0.0));
        let random = Random::new(3, 0);
        (0..3000).for_each(|i| grid.observe((random.u64_at(i) % (64 * 64 * 64)) as usize, 400.0));
        let origin = [0.1, 0.4, -1.0];
        let ray = |i: usize| {
            let d = [0.0004 * i as f32, 0.0, 1.0];
            (origin, d.map(|c| c / (d[0] * d[0] + 1.0).sqrt()))
        };
        let (mut bundle, mut first, mut firsts) = (Bundle::default(), 0, 0);
        for i in 0..60 {
            let span = cube.clip(origin, ray(i).1);
            let mut t = vec![f32::NAN; 16];
            bundle.place(&grid, &cube, ray(i), span, None, &mut t);
            assert_ascends(&t, span);
            assert_tiles(&t, span);
            assert_eq!(t[15], span.1);
            let apart = (ray(i).1[0] - ray(first).1[0]) * span.1;
            if i == 0 || apart > 0.5 * grid.cell_size() {
                (first, firsts) = (i, firsts + 1);
                assert_eq!(t, alone(&grid, ray(i), span, 16));
            } else {
                let of_first = alone(&grid, ray(first), cube.clip(origin, ray(first).1), 16);
                assert!(t[..15].iter().zip(&of_first).all(|(a, b)| (a - b).abs() < 1e-3), "{i}");
            }
        }
        assert!((5..30).contains(&firsts), "{firsts}");
    }

    #[test]
    fn other_origins_and_random_samples_are_rays_by_themselves() {
        let (cube, grid) = (UnitCube::new(&BOUNDS), DensityGrid::uniform(&BOUNDS, 64, 0.0));
        grid.observe(grid.cell([0.5, 0.5, 0.5]), 400.0);
        let mut bundle = Bundle::default();
        let draw = |k: usize| k as f32 / 16.0;
        let draw: Option<&dyn Fn(usize) -> f32> = Some(&draw);
        for (origin, jitter) in [([0.0, 0.4, 0.0], None), ([1e-3, 0.4, 0.0], None), ([1e-3, 0.4, 0.0], draw)]
        {
            let ray = (origin, [0.0, 0.0, 1.0]);
            let span = cube.clip(origin, ray.1);
            let (mut t, mut own) = (vec![f32::NAN; 16], vec![f32::NAN; 16]);
            bundle.place(&grid, &cube, ray, span, jitter, &mut t);
            guided(&grid, &cube, ray, span, jitter, &mut GuideScratch::default(), &mut own);
            assert_eq!(t, own);
        }
    }
}
