//! From a scene's training pixels to depths, points and a box.

use std::ops::ControlFlow;

use rayon::prelude::*;
use relight_scene::{Bounds, Intrinsics, PixelStore, Scene};

use crate::consistency::confirmed;
use crate::descriptor::{View, common_lights, describe};
use crate::sweep::{planes, sweep};

/// How depths are looked for.
#[derive(Clone, Copy, Debug)]
pub struct StereoSettings {
    /// Pictures are reduced by a whole factor to at most this many pixels a side.
    pub side: usize,
    /// Depths tried.
    pub planes: usize,
    /// Neighbours that each view is matched with.
    pub neighbours: usize,
    /// Views that must confirm a depth.
    pub confirmations: usize,
}

impl Default for StereoSettings {
    fn default() -> Self {
        Self { side: 200, planes: 128, neighbours: 4, confirmations: 2 }
    }
}

/// Asked whether to go on, from whatever thread is at work.
pub type GoOn<'a> = &'a (dyn Fn() -> ControlFlow<()> + Sync);

/// Depths at which training rays are expected to end.
pub struct DepthPrior {
    pub(crate) maps: Vec<DepthMap>,
    /// World points of all confirmed depths, metres.
    pub points: Vec<[f32; 3]>,
}

/// Depths of one view, laid out like its photographs: lens distortion and all.
pub(crate) struct DepthMap {
    pub(crate) width: usize,
    pub(crate) height: usize,
    /// Photograph pixels a map pixel, both ways.
    pub(crate) ratio: [f32; 2],
    /// Distances along the rays, metres; NaN where unknown.
    pub(crate) distances: Vec<f32>,
}

impl DepthMap {
    /// A map `[width, height]` of photographs through the lens `full`.
    pub(crate) fn new(full: &Intrinsics, [width, height]: [usize; 2], distances: Vec<f32>) -> Self {
        let ratio = [full.width as f32 / width as f32, full.height as f32 / height as f32];
        Self { width, height, ratio, distances }
    }
}

/// The whole factor by which photographs are reduced; `None` if there are none.
pub(crate) fn reduction(scene: &Scene, store: &PixelStore, settings: &StereoSettings) -> Option<usize> {
    let lenses = (0..store.views()).map(|v| &scene.cameras[store.camera(v)].intrinsics);
    Some(factor(lenses.map(|lens| lens.width.max(lens.height) as usize).max()?, settings.side))
}

/// The whole factor that takes the longest side of photographs to at most `side` pixels.
fn factor(longest: usize, side: usize) -> usize {
    longest.div_ceil(side.max(1)).max(1)
}

/// Fewest lights that make a descriptor worth matching.
const LEAST_LIGHTS: usize = 3;
/// Fewest planes among which one can stand out.
const LEAST_PLANES: usize = 3;
/// Share of pixels below which known depths are likelier chance than surfaces, and no box is made of them.
const LEAST_COVERAGE: f64 = 0.01;

impl DepthPrior {
    /// Looks for depths in the box. `None` if the views share too few lights, or are too few, to be matched, if the
    /// settings leave nothing to match, or if `go_on`, which is asked before each view, answers [`ControlFlow::Break`].
    pub fn estimate(
        scene: &Scene,
        store: &PixelStore,
        bounds: &Bounds,
        settings: &StereoSettings,
        go_on: GoOn<'_>,
    ) -> Option<Self> {
        let n = store.views();
        if n < 3 || settings.side == 0 || settings.neighbours == 0 || settings.planes < LEAST_PLANES {
            return None;
        }
        let lights = common_lights(scene, store);
        if lights.len() < LEAST_LIGHTS {
            return None;
        }
        let scale = reduction(scene, store, settings)?;
        // Each view is some work, and none is begun any more once it is not wanted.
        let wanted = || go_on().is_continue().then_some(());
        let views: Vec<View> = (0..n)
            .into_par_iter()
            .map(|v| wanted().map(|()| describe(scene, store, v, &lights, scale)))
            .collect::<Option<_>>()?;
        let centre: [f64; 3] = std::array::from_fn(|a| f64::from(bounds.lo[a] + bounds.hi[a]) / 2.0);
        let nearest: Vec<Vec<usize>> = (0..n).map(|v| neighbours(&views, v, centre)).collect();
        let depths: Vec<Vec<f32>> = (0..n)
            .into_par_iter()
            .map(|v| {
                wanted()?;
                let Some((near, far)) = depth_range(&views[v], bounds) else {
                    return Some(vec![f32::NAN; views[v].width * views[v].height]);
                };
                let matched = &nearest[v][..settings.neighbours.min(n - 1)];
                Some(sweep(&views, v, matched, &planes(near, far, settings.planes)))
            })
            .collect::<Option<_>>()?;
        let points: Vec<Vec<Option<[f64; 3]>>> = (0..n)
            .into_par_iter()
            .map(|v| {
                let others = &nearest[v][..(2 * settings.neighbours).min(n - 1)];
                confirmed(&views, &depths, v, others, settings.confirmations)
            })
            .collect();
        let maps = views
            .iter()
            .zip(&points)
            .enumerate()
            .map(|(v, (view, points))| {
                let eye = view.pose.position();
                let full = &scene.cameras[store.camera(v)].intrinsics;
                let lens = full.resized(view.width as u32, view.height as u32);
                let distance = |p: [f64; 3]| {
                    p.iter().zip(eye).map(|(a, b)| (a - b) * (a - b)).sum::<f64>().sqrt() as f32
                };
                // The view is without distortion, the map has it.
                let known = |pixel: usize| {
                    let seen = lens.unproject((pixel % view.width) as f64, (pixel / view.width) as f64);
                    points[view.pixel(view.project(seen))?].map(distance)
                };
                let distances = (0..points.len()).map(|pixel| known(pixel).unwrap_or(f32::NAN)).collect();
                DepthMap::new(full, [view.width, view.height], distances)
            })
            .collect();
        let points = points.into_iter().flatten().flatten().map(|p| p.map(|v| v as f32)).collect();
        Some(Self { maps, points })
    }

    /// Distance along the ray of photograph pixel `(x, y)` of a view of the pixel store, metres; NaN where unknown.
    pub fn distance(&self, view: usize, x: usize, y: usize) -> f32 {
        let map = &self.maps[view];
        let column = ((x as f32 / map.ratio[0]) as usize).min(map.width - 1);
        let row = ((y as f32 / map.ratio[1]) as usize).min(map.height - 1);
        map.distances[row * map.width + column]
    }

    /// Share of the maps' pixels whose depth is known, 0..1.
    pub fn coverage(&self) -> f64 {
        let all: usize = self.maps.iter().map(|m| m.distances.len()).sum();
        self.points.len() as f64 / all.max(1) as f64
    }

    /// The smallest cube around the points, without the outermost 0.2 % on each side, widened by a tenth; `None` if
    /// hardly any depth is known.
    pub fn bounds(&self) -> Option<Bounds> {
        if self.coverage() < LEAST_COVERAGE {
            return None;
        }
        let range = |axis: usize| {
            let mut values: Vec<f32> = self.points.iter().map(|p| p[axis]).collect();
            let cut = values.len() / 500;
            let mut at = |rank: usize| *values.select_nth_unstable_by(rank, f32::total_cmp).1;
            (at(cut), at(self.points.len() - 1 - cut))
        };
        let ranges = [range(0), range(1), range(2)];
        let half = ranges.iter().map(|(lo, hi)| 0.5 * (hi - lo)).fold(0.0, f32::max) * 1.1;
        let centre = ranges.map(|(lo, hi)| 0.5 * (lo + hi));
        Some(Bounds { lo: centre.map(|c| c - half), hi: centre.map(|c| c + half) })
    }
}

/// Other views, best partners first: seen from the middle of the scene their direction differs enough for depth to
/// show, and little enough for the picture to stay alike.
fn neighbours(views: &[View], index: usize, centre: [f64; 3]) -> Vec<usize> {
    /// Preferred angle between the directions to two cameras, radians.
    const ANGLE: f64 = 0.2;
    let direction = |v: &View| {
        let d: [f64; 3] = std::array::from_fn(|a| v.pose.position()[a] - centre[a]);
        let norm = d.iter().map(|x| x * x).sum::<f64>().sqrt().max(1e-9);
        d.map(|x| x / norm)
    };
    let own = direction(&views[index]);
    let angle = |v: usize| {
        let cos: f64 = own.iter().zip(direction(&views[v])).map(|(a, b)| a * b).sum();
        // As far from the preferred angle, in octaves.
        (cos.clamp(-1.0, 1.0).acos().max(1e-3) / ANGLE).log2().abs()
    };
    let mut others: Vec<usize> = (0..views.len()).filter(|&v| v != index).collect();
    others.sort_by(|&a, &b| angle(a).total_cmp(&angle(b)));
    others
}

/// Depths along the optical axis at which a view sees the box, metres; `None` if the box is behind it.
fn depth_range(view: &View, bounds: &Bounds) -> Option<(f64, f64)> {
    let corners = (0..8).map(|i| {
        let corner: [f64; 3] =
            std::array::from_fn(|a| f64::from(if i >> a & 1 == 0 { bounds.lo[a] } else { bounds.hi[a] }));
        view.pose.inverse_transform(corner)[2]
    });
    let (near, far) = corners.fold((f64::INFINITY, 0f64), |(n, f), z| (n.min(z), f.max(z)));
    // Nearer than a tenth of the way, planes would be wasted on the air before the lens.
    (far > 0.0).then(|| (near.max(0.15 * far), far))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn photographs_are_reduced_by_their_longest_side() {
        for (longest, side, reduced_by) in
            [(320, 200, 2), (200, 200, 1), (201, 200, 2), (16_384, 200, 82), (1, 200, 1), (5, 0, 5)]
        {
            assert_eq!(factor(longest, side), reduced_by, "{longest} to {side}");
        }
    }
}
