//! From rays to samples.
//!
//! A ray is cut into intervals that tile its way through the box; each holds one sample. The last sample is opaque.

use relight_scene::Bounds;

use crate::density_grid::DensityGrid;

/// Share of guided samples spread evenly, so that what the density grid does not know of is found (training).
const UNIFORM_SHARE: f32 = 0.15;
/// The same when drawing pictures.
const UNIFORM_SHARE_DRAWING: f32 = 0.02;
/// Largest opacity a cell may claim when samples are placed: some must fall behind a surface that may be wrong.
const OPACITY_LIMIT: f32 = 0.5;
/// Placing ends where less than this of the limited transmittance is left.
const TRANSMITTANCE_END: f32 = 0.01;

/// Maps the world box to the unit cube.
#[derive(Clone, Copy, Debug)]
pub struct UnitCube {
    lo: [f32; 3],
    inverse_extent: [f32; 3],
    /// Longest edge of the box, metres.
    pub edge: f32,
}

impl UnitCube {
    /// The cube of a box.
    pub fn new(bounds: &Bounds) -> Self {
        let extent: [f32; 3] = std::array::from_fn(|a| bounds.hi[a] - bounds.lo[a]);
        Self {
            lo: bounds.lo,
            inverse_extent: extent.map(|e| 1.0 / e),
            edge: extent.into_iter().fold(0.0, f32::max),
        }
    }

    /// World position to unit cube.
    pub fn map(&self, p: [f32; 3]) -> [f32; 3] {
        std::array::from_fn(|a| (p[a] - self.lo[a]) * self.inverse_extent[a])
    }

    /// Unit cube to world position.
    pub fn unmap(&self, u: [f32; 3]) -> [f32; 3] {
        std::array::from_fn(|a| self.lo[a] + u[a] / self.inverse_extent[a])
    }

    /// Distances along a ray at which it enters and leaves the box; the same number twice where it misses.
    pub fn clip(&self, origin: [f32; 3], direction: [f32; 3]) -> (f32, f32) {
        let (mut near, mut far) = (0f32, f32::INFINITY);
        let (o, d) = (self.map(origin), direction);
        for a in 0..3 {
            let inverse = 1.0 / (d[a] * self.inverse_extent[a]);
            let (t0, t1) = ((0.0 - o[a]) * inverse, (1.0 - o[a]) * inverse);
            // A ray along a face gives NaN, which min and max ignore.
            near = near.max(t0.min(t1));
            far = far.min(t0.max(t1));
        }
        if far > near && far.is_finite() { (near, far) } else { (near.min(1e3), near.min(1e3)) }
    }
}

/// `origin + t * direction`.
pub fn along(origin: [f32; 3], direction: [f32; 3], t: f32) -> [f32; 3] {
    std::array::from_fn(|a| t * direction[a] + origin[a])
}

/// Lengths of the intervals that sorted samples stand for: cut halfway between neighbours, and at `near` and `far`.
pub fn interval_lengths(t: &[f32], (near, far): (f32, f32), lengths: &mut [f32]) {
    let mut start = near;
    for (i, length) in lengths[..t.len()].iter_mut().enumerate() {
        let end = if i + 1 < t.len() { 0.5 * (t[i] + t[i + 1]) } else { far };
        *length = (end - start).max(0.0);
        start = end;
    }
}

/// One sample in each of `t.len()` equal parts of the ray; `jitter(i)` in 0..1 says where in part `i`.
pub fn stratified((near, far): (f32, f32), jitter: impl Fn(usize) -> f32, t: &mut [f32]) {
    let part = (far - near) / t.len() as f32;
    for (i, t) in t.iter_mut().enumerate() {
        *t = near + (i as f32 + jitter(i)) * part;
    }
}

/// Draws `t.len()` sorted samples from a density that is constant on bins: bin `b` ends at `end(b)` and holds
/// `mass[b]`, the first begins at `near`.
pub fn draw(
    mass: &[f32],
    near: f32,
    end: impl Fn(usize) -> f32,
    jitter: impl Fn(usize) -> f32,
    t: &mut [f32],
) {
    let total: f32 = mass.iter().sum();
    let step = total / t.len() as f32;
    let (mut bin, mut before, mut start) = (0, 0.0, near);
    for (i, t) in t.iter_mut().enumerate() {
        let target = (i as f32 + jitter(i)) * step;
        while bin + 1 < mass.len() && before + mass[bin] < target {
            before += mass[bin];
            start = end(bin);
            bin += 1;
        }
        let share = if mass[bin] > 0.0 { ((target - before) / mass[bin]).clamp(0.0, 1.0) } else { 0.5 };
        *t = start + share * (end(bin) - start);
    }
}

/// Memory for [`guided`], reused from ray to ray.
#[derive(Default)]
pub struct GuideScratch {
    weight: Vec<f32>,
    mass: Vec<f32>,
}

/// Places samples where the density grid says that something is: `t.len() - 1` of them inside, the last where the
/// ray leaves the box.
pub fn guided(
    grid: &DensityGrid,
    cube: &UnitCube,
    (origin, direction): ([f32; 3], [f32; 3]),
    (near, far): (f32, f32),
    jitter: Option<&dyn Fn(usize) -> f32>,
    scratch: &mut GuideScratch,
    t: &mut [f32],
) {
    let Some((last, t)) = t.split_last_mut() else { return };
    *last = far;
    let bins = (((far - near) / grid.cell_size()).ceil() as usize).clamp(1, 2048);
    let step = (far - near) / bins as f32;
    let weight = &mut scratch.weight;
    weight.clear();
    weight.resize(bins + 2, 0.0);
    let (o, mut limited, mut depth) = (cube.map(origin), 1f32, 0f32);
    let d: [f32; 3] = std::array::from_fn(|a| direction[a] * cube.inverse_extent[a]);
    let thin = 1e-4 / step;
    for b in 0..bins {
        let cell = grid.cell(along(o, d, near + (b as f32 + 0.5) * step));
        let Some(density) = grid.at(cell, thin) else { continue };
        let optical = density * step;
        depth += optical;
        let alpha = (1.0 - (-optical).exp()).min(OPACITY_LIMIT);
        weight[b + 1] = limited * alpha;
        limited *= 1.0 - alpha;
        if limited < TRANSMITTANCE_END {
            break;
        }
    }
    // A surface may lie just outside the cell that knows of it.
    let mass = &mut scratch.mass;
    mass.clear();
    mass.extend(weight.windows(3).map(|w| w[0].max(w[1]).max(w[2])));
    let total: f32 = mass.iter().sum();
    let least = if jitter.is_some() { UNIFORM_SHARE } else { UNIFORM_SHARE_DRAWING };
    let uniform = if total > 0.0 { least + (1.0 - least) * (-depth).exp() } else { 1.0 };
    let scale = if total > 0.0 { (1.0 - uniform) / total } else { 0.0 };
    for m in mass.iter_mut() {
        *m = *m * scale + uniform / bins as f32;
    }
    let end = |b: usize| near + (b as f32 + 1.0) * step;
    match jitter {
        Some(jitter) => draw(mass, near, end, jitter, t),
        None => draw(mass, near, end, |_| 0.5, t),
    }
}
