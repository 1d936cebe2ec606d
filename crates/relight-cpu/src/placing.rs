//! How samples are placed along a ray: how much is left to chance, how far a ray looks at once, what it finds, and where samples lie then.

use crate::march::draw;

/// Optical depth beyond which nothing passes; libm takes long over exponentials that come out as 0.
const OPAQUE: f32 = 50.0;

/// How samples are placed.
#[derive(Debug)]
pub struct Placing {
    /// Share of them spread evenly, so that what the density grid does not know of is found.
    pub uniform_share: f32,
    /// Largest opacity a cell may claim: some must fall behind a surface that may be wrong.
    pub opacity_limit: f32,
    /// Nothing is looked for where less than this of the limited transmittance is left.
    pub end: f32,
    /// Samples end there too, or at the first void behind which less than this of it is left, instead of at the far side of the box.
    pub look: Option<f32>,
}

/// Where things have to be found.
pub const SEARCHING: Placing = Placing { uniform_share: 0.15, opacity_limit: 0.5, end: 0.01, look: None };
/// Where things are known: with fewer samples in front, 16 come nearer to what hundreds give.
pub const KNOWING: Placing = Placing { uniform_share: 0.02, opacity_limit: 0.35, end: 0.06, look: None };
/// Along rays that can look on, where they have got through what they met: what may hide more than the rest is left to the next look.
pub const LOOKING: Placing = Placing { uniform_share: 0.01, opacity_limit: 0.4, end: 0.15, look: Some(0.5) };

/// Where the samples of a ray are worth placing.
pub struct Places<'a> {
    /// With their masses.
    pub stretches: &'a Stretches,
    /// Where the first begins, metres.
    pub near: f32,
    /// Length of a step, metres.
    pub step: f32,
    /// Where the last of them may be, metres, and whether that is where the ray leaves the box.
    pub end: f32,
    /// See `end`.
    pub leaves: bool,
}

impl Places<'_> {
    /// Draws samples, metres, ascending, sample `i` in its part of the distribution at `jitter(i)` of 0..1; but of a ray that leaves the
    /// box, the last is where it does. `apart[i]` is how far samples as sample `i` are apart.
    pub fn draw(&self, jitter: impl Fn(usize) -> f32, t: &mut [f32], apart: &mut [f32]) {
        let drawn = t.len() - usize::from(self.leaves);
        t[drawn..].fill(self.end);
        apart[drawn..].fill(f32::INFINITY);
        let end =
            |stretch: usize| (self.near + self.stretches.ends[stretch] as f32 * self.step).min(self.end);
        draw(&self.stretches.mass, self.near, end, jitter, drawn, |i, at, distance| {
            (t[i], apart[i]) = (at, distance);
        });
    }
}

/// Stretches of a ray, of one step at which something may be, or of all between two such.
#[derive(Default)]
pub struct Stretches {
    /// Where each ends, counted in steps.
    pub ends: Vec<usize>,
    /// The chance of a sample in each.
    pub mass: Vec<f32>,
}

/// What a ray has found so far.
#[derive(Default)]
pub struct Found {
    /// Number of its way.
    pub way: usize,
    /// Its steps, as far as it has samples, and how many cells each is long.
    pub steps: usize,
    /// See `steps`.
    pub stretch: f32,
    /// Steps at which something may be, ascending, with the chance of a sample there.
    pub occupied: Vec<(usize, f32)>,
    /// Transmittance, cells being no more opaque than they may claim.
    pub limited: f32,
    /// Optical depth.
    pub depth: f32,
}

impl Found {
    /// Raises the chance of a step, which no step before was behind, and of its neighbours: a surface may lie just outside the cell
    /// that knows of it.
    #[inline]
    pub fn raise(&mut self, step: usize, chance: f32) {
        let first = step.saturating_sub(1);
        // Those of the three that steps before have raised.
        let known = self.occupied.last().map_or(0, |&(last, _)| (last + 1).saturating_sub(first));
        let start = self.occupied.len() - known;
        self.occupied[start..].iter_mut().for_each(|(_, raised)| *raised = raised.max(chance));
        self.occupied.extend((first + known..(step + 2).min(self.steps)).map(|step| (step, chance)));
    }

    /// The stretches of the ray: at steps where something may be the chance found, and `uniform_share` of all samples, or more on
    /// rays that may pass, in every step alike.
    #[inline]
    pub fn divide(&self, uniform_share: f32, stretches: &mut Stretches) {
        let total: f32 = self.occupied.iter().map(|(_, chance)| chance).sum();
        let passes = (-self.depth.min(OPAQUE)).exp();
        let uniform = if total > 0.0 { uniform_share + (1.0 - uniform_share) * passes } else { 1.0 };
        let scale = if total > 0.0 { (1.0 - uniform) / total } else { 0.0 };
        let uniform = uniform / self.steps as f32;
        let Stretches { ends, mass } = stretches;
        ends.clear();
        mass.clear();
        let mut start = 0;
        for &(step, chance) in &self.occupied {
            if step > start {
                ends.push(step);
                mass.push((step - start) as f32 * uniform);
            }
            ends.push(step + 1);
            mass.push(chance * scale + uniform);
            start = step + 1;
        }
        if start < self.steps {
            ends.push(self.steps);
            mass.push((self.steps - start) as f32 * uniform);
        }
    }
}
