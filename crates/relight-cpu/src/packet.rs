//! Ray packets (Wald et al. 2001): what the density grid tells one ray, it tells those close beside it.
//!
//! Rays of neighbouring pixels go through the same cells nearly all the way. Where samples are not random, in pictures and
//! the scores of pictures, the first ray of a packet looks at the grid and the others take their samples where it does.

use crate::guide::{Guide, GuideScratch};

/// Cells of the density grid that a ray may be away from the first of its packet.
const WIDTH: f32 = 0.5;

/// The first ray of the packet at hand, and memory for the next.
#[derive(Default)]
pub struct Packet {
    first: Option<First>,
    /// The first ray's samples, metres.
    t: Vec<f32>,
    scratch: GuideScratch,
}

struct First {
    origin: [f32; 3],
    direction: [f32; 3],
    /// Where it enters and leaves the box, metres.
    span: (f32, f32),
}

impl Packet {
    /// Begins anew: other rays, or another field.
    pub fn clear(&mut self) {
        self.first = None;
    }

    /// Places the samples `t` (metres, ascending) of the next ray, of an origin and a unit direction: as [`Guide::guided`] does, or
    /// where those of its packet's first ray are.
    pub fn place(
        &mut self,
        guide: Guide<'_>,
        (origin, direction): ([f32; 3], [f32; 3]),
        span: (f32, f32),
        jitter: Option<&dyn Fn(usize) -> f32>,
        t: &mut [f32],
    ) {
        let first = First { origin, direction, span };
        let is_close = |other: &First| other.is_close(&first, guide.density.cell_size());
        if jitter.is_none() && self.first.as_ref().is_some_and(is_close) && self.t.len() == t.len() {
            t.iter_mut().zip(&self.t).for_each(|(t, first)| *t = first.clamp(span.0, span.1));
            if let Some(last) = t.last_mut() {
                *last = span.1;
            }
            return;
        }
        guide.guided((origin, direction), span, jitter, &mut self.scratch, t);
        self.first = jitter.is_none().then_some(first);
        self.t.clear();
        self.t.extend_from_slice(t);
    }
}

impl First {
    /// Whether another ray stays close to this one all the way through the box, and enters and leaves it where this one does.
    fn is_close(&self, other: &Self, cell: f32) -> bool {
        let apart =
            self.direction.iter().zip(other.direction).map(|(a, b)| (a - b).powi(2)).sum::<f32>().sqrt();
        let ends = [(self.span.0, other.span.0), (self.span.1, other.span.1)];
        self.origin == other.origin
            && apart * other.span.1 <= WIDTH * cell
            && ends.iter().all(|(a, b)| (a - b).abs() <= cell)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::density_grid::DensityGrid;
    use crate::guide::tests::guide;
    use crate::march::UnitCube;
    use crate::march::tests::{BOUNDS, assert_ascends, assert_tiles};
    use relight_field::random::Random;

    const SAMPLES: usize = 16;

    /// Samples of each of these rays, all from `origin`, in one packet after the other; and of each by itself.
    fn place(grid: &DensityGrid, origin: [f32; 3], directions: &[[f32; 3]]) -> Vec<([f32; 16], [f32; 16])> {
        let (cube, mut packet) = (UnitCube::new(&BOUNDS), Packet::default());
        let guide = guide(grid, &cube);
        let one = |&direction: &[f32; 3]| {
            let span = cube.clip(origin, direction);
            let (mut t, mut alone) = ([f32::NAN; SAMPLES], [f32::NAN; SAMPLES]);
            packet.place(guide, (origin, direction), span, None, &mut t);
            let (ray, mut scratch) = ((origin, direction), GuideScratch::default());
            guide.guided(ray, span, None, &mut scratch, &mut alone);
            assert_ascends(&t, span);
            assert_tiles(&t, span);
            assert_eq!(t[SAMPLES - 1], span.1);
            (t, alone)
        };
        directions.iter().map(one).collect()
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
        let origin = [0.1, 0.4, -1.0];
        let directions: Vec<_> = (0..60).map(|i| unit([0.0004 * i as f32, 0.0, 1.0])).collect();
        let (mut first, mut firsts) = (0, 0);
        let placed = place(&grid, origin, &directions);
        for (i, (t, alone)) in placed.iter().enumerate() {
            // They leave the box 5 m away.
            let apart = (directions[i][0] - directions[first][0]) * 5.0;
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
            for (t, alone) in place(&grid, [x, 0.4, 1.0], &[[0.0, 0.0, 1.0], unit([slope, 0.0, 1.0])]) {
                assert_eq!(t, alone);
            }
        }
    }

    #[test]
    fn other_origins_and_random_samples_are_rays_by_themselves() {
        let (cube, grid) = (UnitCube::new(&BOUNDS), DensityGrid::uniform(&BOUNDS, 64, 0.0));
        grid.observe(grid.cell([0.5, 0.5, 0.5]), 400.0);
        let (guide, mut packet) = (guide(&grid, &cube), Packet::default());
        let draw = |k: usize| k as f32 / SAMPLES as f32;
        let draw: Option<&dyn Fn(usize) -> f32> = Some(&draw);
        let rays = [([0.0, 0.4, 0.0], None), ([1e-3, 0.4, 0.0], None), ([1e-3, 0.4, 0.0], draw)];
        for (origin, jitter) in rays.into_iter().chain([rays[1]]) {
            let ray = (origin, [0.0, 0.0, 1.0]);
            let span = cube.clip(origin, ray.1);
            let (mut t, mut own) = ([f32::NAN; SAMPLES], [f32::NAN; SAMPLES]);
            packet.place(guide, ray, span, jitter, &mut t);
            guide.guided(ray, span, jitter, &mut GuideScratch::default(), &mut own);
            assert_eq!(t, own);
        }
    }
}
