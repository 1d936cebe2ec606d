//! Ray packets (Wald et al. 2001): what the density grid tells one ray, it tells those close beside it.
//!
//! Rays of neighbouring pixels go through the same cells nearly all the way. Where samples are not random, in pictures and
//! the scores of pictures, the first ray of a packet looks at the grid and the others take their samples where it does.

use relight_field::engine::Rays;

use crate::guide::Span;

/// Cells of the density grid that a ray may be away from the first of its packet.
const WIDTH: f32 = 0.5;

/// The first ray of the packet of each of `looking`, rays by number, into `firsts`, in a grid of cells of `cell` metres; `spans` are the
/// distances between which all rays look.
pub fn first_rays(
    rays: &Rays,
    looking: impl Iterator<Item = usize>,
    spans: &[Span],
    cell: f32,
    firsts: &mut Vec<usize>,
) {
    firsts.clear();
    let mut first = None;
    firsts.extend(looking.map(|ray| {
        let close = first.filter(|&first| are_close(rays, spans, (first, ray), cell));
        *first.insert(close.unwrap_or(ray))
    }));
}

/// Whether two rays stay close to each other all the way through the box, and begin to look and leave it together.
fn are_close(rays: &Rays, spans: &[Span], (a, b): (usize, usize), cell: f32) -> bool {
    let directions = rays.directions[a].iter().zip(rays.directions[b]);
    let apart = directions.map(|(a, b)| (a - b).powi(2)).sum::<f32>().sqrt();
    let ends = [(spans[a].0, spans[b].0), (spans[a].1, spans[b].1)];
    rays.origins[a] == rays.origins[b]
        && apart * spans[b].1 <= WIDTH * cell
        && ends.iter().all(|(a, b)| (a - b).abs() <= cell)
}

/// The samples of a ray, `t`, from those of its packet's first ray, all of them distances in metres; the last is at `far` if it `leaves` the
/// box there.
pub fn take_places((near, far): Span, leaves: bool, t: &mut [f32]) {
    t.iter_mut().for_each(|t| *t = t.clamp(near, far));
    if let Some(last) = t.last_mut().filter(|_| leaves) {
        *last = far;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::density_grid::DensityGrid;
    use crate::guide::Ray;
    use crate::guide::tests::{guide, place};
    use crate::march::UnitCube;
    use crate::march::tests::{BOUNDS, assert_ascends, assert_tiles};
    use crate::placing::KNOWING;
    use relight_field::random::Random;

    const SAMPLES: usize = 16;

    /// Samples of each of these rays, in one packet after the other; and of each by itself.
    fn place_all(grid: &DensityGrid, rays: &[Ray]) -> Vec<([f32; 16], [f32; 16])> {
        let (cube, mut firsts) = (UnitCube::new(&BOUNDS), Vec::new());
        let spans: Vec<Span> = rays.iter().map(|ray| cube.clip(ray.0, ray.1)).collect();
        let (origins, directions) = rays.iter().copied().unzip();
        first_rays(&Rays { origins, directions }, 0..rays.len(), &spans, grid.cell_size(), &mut firsts);
        let alone = rays.iter().zip(&spans).map(|(&ray, &span)| {
            let mut t = [f32::NAN; SAMPLES];
            place(guide(grid, &cube), &KNOWING, ray, span, None, &mut t);
            t
        });
        let alone: Vec<_> = alone.collect();
        let one = |ray: usize| {
            assert!(firsts[ray] <= ray && firsts[firsts[ray]] == firsts[ray]);
            let mut t = alone[firsts[ray]];
            if firsts[ray] != ray {
                take_places(spans[ray], true, &mut t);
            }
            assert_ascends(&t, spans[ray]);
            assert_tiles(&t, spans[ray]);
            assert_eq!(t[SAMPLES - 1], spans[ray].1);
            (t, alone[ray])
        };
        (0..rays.len()).map(one).collect()
    }

    fn unit(d: [f32; 3]) -> [f32; 3] {
        let norm = d.iter().map(|c| c * c).sum::<f32>().sqrt();
        d.map(|c| c / norm)
    }

    #[test]
    fn rays_take_the_samples_of_the_first_as_long_as_they_are_close() {
        let grid = DensityGrid::uniform(&BOUNDS, 64, 0.0);
        let random = Random::new(3, 0);
        (0..3000).for_each(|i| grid.observe((random.u64_at(i) % (64 * 64 * 64)) as usize, 400.0));
        let rays: Vec<_> = (0..60).map(|i| ([0.1, 0.4, -1.0], unit([0.0004 * i as f32, 0.0, 1.0]))).collect();
        let (mut first, mut firsts) = (0, 0);
        let placed = place_all(&grid, &rays);
        for (i, (t, alone)) in placed.iter().enumerate() {
            // They leave the box 5 m away.
            let apart = (rays[i].1[0] - rays[first].1[0]) * 5.0;
            if i == 0 || apart > 0.5 * grid.cell_size() {
                (first, firsts) = (i, firsts + 1);
                assert_eq!(t, alone);
            } else {
                assert!(t.iter().zip(&placed[first].0).all(|(a, b)| (a - b).abs() < 1e-3), "{i}");
            }
        }
        assert!((5..30).contains(&firsts), "{firsts}");
    }

    /// Two rays beside each other, of which one misses the box, or leaves it early.
    #[test]
    fn rays_that_enter_or_leave_elsewhere_are_rays_by_themselves() {
        let grid = DensityGrid::uniform(&BOUNDS, 64, 0.0);
        grid.observe(grid.cell([0.999, 0.5, 0.9]), 400.0);
        let hair = 0.1 * grid.cell_size();
        // Along the face x = 1, outside and in; then inside and out.
        for (x, slope) in [(1.0 + hair, -0.5 * hair), (1.0 - hair, 0.7 * hair)] {
            let origin = [x, 0.4, 1.0];
            for (t, alone) in
                place_all(&grid, &[(origin, [0.0, 0.0, 1.0]), (origin, unit([slope, 0.0, 1.0]))])
            {
                assert_eq!(t, alone);
            }
        }
    }

    #[test]
    fn rays_from_elsewhere_are_rays_by_themselves() {
        let grid = DensityGrid::uniform(&BOUNDS, 64, 0.0);
        grid.observe(grid.cell([0.5, 0.5, 0.5]), 400.0);
        let rays = [0.0, 1e-3, 0.0].map(|x| ([x, 0.4, 0.0], [0.0, 0.0, 1.0]));
        for (t, alone) in place_all(&grid, &rays) {
            assert_eq!(t, alone);
        }
    }
}
