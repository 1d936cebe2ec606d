//! Random rays to learn from.
//!
//! Every pair of a training pixel and one of its lights is equally likely in every step. What a step draws is a
//! function of seed and step alone, whatever the number of threads, so that a resumed run draws what the
//! uninterrupted one would have drawn.

use rayon::prelude::*;
use relight_field::engine::{LightPose, RayBatch};
use relight_field::random::Random;
use relight_scene::{PixelStore, Pose, Scene};
use relight_stereo::DepthPrior;

use crate::TrainError;
use crate::directions::{Directions, TABLES};
use crate::recipe::Recipe;

/// Streams of the seed below this number are left to the engine.
const FIRST_STREAM: u64 = 1 << 62;

/// The streams of the shifts of lights.
const SHIFT_STREAM: u64 = 1 << 63;

/// Lights whose neighbours are looked for, at most.
const MOST_NEIGHBOURHOODS: usize = 1000;

/// Mean distance from a training light to its nearest neighbour, metres; zero for a single light.
fn light_spacing(scene: &Scene, store: &PixelStore) -> f64 {
    let mut lights: Vec<u32> = (0..store.views()).flat_map(|v| store.lights(v)).copied().collect();
    lights.sort_unstable();
    lights.dedup();
    let positions: Vec<[f64; 3]> = lights.iter().map(|&l| scene.lights[l as usize].pose.position()).collect();
    let distance =
        |a: &[f64; 3], b: &[f64; 3]| a.iter().zip(b).map(|(a, b)| (a - b).powi(2)).sum::<f64>().sqrt();
    let nearest = |i: usize| {
        let others = positions.iter().enumerate().filter(|&(j, _)| j != i);
        others.map(|(_, p)| distance(p, &positions[i])).fold(f64::INFINITY, f64::min)
    };
    let every = positions.len().div_ceil(MOST_NEIGHBOURHOODS).max(1);
    let found: Vec<f64> =
        (0..positions.len()).step_by(every).map(nearest).filter(|d| d.is_finite()).collect();
    found.iter().sum::<f64>() / found.len().max(1) as f64
}

/// One probe in so many stands where a photograph was taken that its ray is not compared with, if there is one.
const KNOWN_PROBES: usize = 8;

/// Lights that a ray must be compared under at least, to have probes.
const LEAST_FOR_PROBES: usize = 4;

/// Which lights rays are compared under.
#[derive(Clone, Copy, Debug)]
pub struct LightChoice {
    /// Lights that each ray is compared under.
    pub per_ray: usize,
    /// In every step each light is moved by a random distance of up to this much along each axis, as a share of the
    /// distance between neighbouring lights; 0: none is.
    pub shift: f64,
    /// Probes of each ray, most of which stand where nobody photographed. There are none where a ray is to be compared
    /// under fewer than four lights, or where no view has more than four.
    pub probes: usize,
    /// How far those are moved from lights that were photographed, as lights are; 0: no probes.
    pub probe_reach: f64,
}

impl LightChoice {
    /// The choice of a recipe.
    pub fn of(recipe: &Recipe) -> Self {
        Self {
            per_ray: recipe.lights_per_ray,
            shift: recipe.light_shift,
            probes: recipe.probes_per_ray,
            probe_reach: recipe.probe_reach,
        }
    }
}

/// Where one training view's rays come from.
struct View {
    pose: Pose,
    origin: [f32; 3],
    /// The number of its lens in `BatchSampler::directions`.
    lens: usize,
    /// Pairs of all views up to and including this one.
    pairs_before_next: u64,
}

/// Draws batches of training rays.
pub struct BatchSampler<'a> {
    store: &'a PixelStore,
    depths: Option<&'a DepthPrior>,
    lights: Vec<LightPose>,
    /// Half the width of the cube from which the shift of a light is drawn, metres.
    shift: f32,
    /// The same for probes.
    probe_reach: f32,
    /// Probes of each ray.
    probes: usize,
    views: Vec<View>,
    directions: Directions,
    rays: usize,
    lights_per_ray: usize,
    seed: u64,
}

impl<'a> BatchSampler<'a> {
    /// A sampler of `rays` rays a step. Where no view has as many lights as each is to have, and one more if there are
    /// probes, rays have fewer lights and there are more of them, so that a step compares as many pixels. `depths` are those of the views of `store`.
    ///
    /// # Errors
    /// [`TrainError::Data`] if there is nothing to draw from.
    pub fn new(
        scene: &Scene,
        store: &'a PixelStore,
        depths: Option<&'a DepthPrior>,
        rays: usize,
        lights: LightChoice,
        seed: u64,
    ) -> Result<Self, TrainError> {
        let mut directions = Directions::within(TABLES);
        let mut views = Vec::with_capacity(store.views());
        let mut pairs = 0u64;
        for v in 0..store.views() {
            let camera = &scene.cameras[store.camera(v)];
            pairs += store.pixels(v) as u64 * store.lights(v).len() as u64;
            let origin = camera.pose.position().map(|c| c as f32);
            views.push(View {
                pose: camera.pose,
                origin,
                lens: directions.number(&camera.intrinsics),
                pairs_before_next: pairs,
            });
        }
        let most = (0..store.views()).map(|v| store.lights(v).len()).max().unwrap_or(0);
        if pairs == 0 {
            return Err(TrainError::Data(format!("{}: no training images", scene.root.display())));
        }
        let spacing = light_spacing(scene, store);
        let probe_reach = (lights.probe_reach * spacing) as f32;
        // From fewer photographs nobody could tell what another light would show; and some view must have one left to
        // tell whether that would have been right.
        let enough = lights.per_ray >= LEAST_FOR_PROBES && most > LEAST_FOR_PROBES;
        let probes = if enough && probe_reach > 0.0 { lights.probes } else { 0 };
        let per_ray = lights.per_ray.min(if probes > 0 { most - 1 } else { most });
        Ok(Self {
            store,
            depths,
            shift: (lights.shift * spacing) as f32,
            probe_reach,
            probes,
            lights: scene.lights.iter().map(|l| LightPose(l.pose.row_major_f32())).collect(),
            views,
            directions,
            rays: rays * lights.per_ray / per_ray,
            lights_per_ray: per_ray,
            seed,
        })
    }

    /// Lights that each ray is compared under.
    pub fn lights_per_ray(&self) -> usize {
        self.lights_per_ray
    }

    /// Draws the batch of `step` into `batch`, whose buffers are used again.
    pub fn fill(&self, step: u64, batch: &mut RayBatch) {
        // Inside the pool, threads do not fall asleep between one part and the next.
        rayon::scope(|_| self.draw(step, batch));
    }

    fn draw(&self, step: u64, batch: &mut RayBatch) {
        let (n, k) = (self.rays, self.lights_per_ray);
        batch.lights_per_ray = k;
        self.shift_lights(step, &mut batch.lights);
        batch.rays.origins.resize(n, [0.0; 3]);
        batch.rays.directions.resize(n, [0.0; 3]);
        batch.light_index.resize(n * k, 0);
        batch.colours.resize(n * k, [0.0; 3]);
        batch.depths.resize(if self.depths.is_some() { n } else { 0 }, f32::NAN);

        let random = Random::new(self.seed, FIRST_STREAM + step);
        // View, pixel, lights, and four for each probe.
        let draws = 2 + k as u64 + 4 * self.probes as u64;
        batch
            .rays
            .origins
            .par_iter_mut()
            .zip(&mut batch.rays.directions)
            .zip(batch.light_index.par_chunks_mut(k))
            .zip(batch.colours.par_chunks_mut(k))
            .enumerate()
            .with_min_len(64)
            .for_each(|(ray, (((origin, direction), lights), colours))| {
                let first = ray as u64 * draws;
                let (v, pixel) = self.pixel(random, first);
                let view = &self.views[v];
                *origin = view.origin;
                let [x, y] = self.directions.of(view.lens, pixel);
                *direction = unit(view.pose.rotate([f64::from(x), f64::from(y), 1.0]));
                let (held, pixels) = (self.store.lights(v), self.store.pixel(v, pixel));
                let own = k.min(held.len());
                draw_distinct(held.len() as u32, &mut lights[..own], |i| random.u32_at(first + 2 + i));
                // A view with fewer lights shows them again, all as often.
                for i in own..k {
                    lights[i] = lights[i - own];
                }
                if own < k {
                    let turn = random.u32_at(first + 2);
                    for light in lights.iter_mut() {
                        *light = (*light + turn % own as u32) % own as u32;
                    }
                }
                for (light, colour) in lights.iter_mut().zip(colours) {
                    let slot = *light as usize;
                    *colour = pixels[slot].map(|c| f32::from(c) / 255.0);
                    *light = held[slot];
                }
            });
        self.fill_probes(random, draws, batch);
        if let Some(prior) = self.depths {
            batch.depths.par_iter_mut().with_min_len(64).enumerate().for_each(|(ray, depth)| {
                let (v, pixel) = self.pixel(random, ray as u64 * draws);
                let width = self.directions.width(self.views[v].lens);
                *depth = prior.distance(v, pixel % width, pixel / width);
            });
        }
    }

    /// Each ray's probes: the colour that was photographed under some light, or a place where no light stood.
    fn fill_probes(&self, random: Random, draws: u64, batch: &mut RayBatch) {
        let n = self.rays * self.probes;
        batch.probe_lights.resize(n, LightPose([0.0; 12]));
        batch.probe_colours.resize(n, [f32::NAN; 3]);
        let light_index = &batch.light_index;
        let probes = batch.probe_lights.par_iter_mut().zip(&mut batch.probe_colours);
        probes.enumerate().with_min_len(64).for_each(|(probe, (light, colour))| {
            let (ray, which) = (probe / self.probes, probe % self.probes);
            let first = ray as u64 * draws;
            let (v, pixel) = self.pixel(random, first);
            let own = first + draws - 4 * (which as u64 + 1);
            let held = self.store.lights(v);
            // Photographs that the ray is compared with anyway would say nothing new.
            let taken = &light_index[ray * self.lights_per_ray..][..self.lights_per_ray];
            let left = held.len().saturating_sub(self.lights_per_ray);
            let known = (probe % KNOWN_PROBES == 0 && left > 0)
                .then(|| (0..held.len()).filter(|&slot| !taken.contains(&held[slot])))
                .and_then(|mut untaken| untaken.nth(random.below_at(own, left as u32) as usize));
            if let Some(slot) = known {
                *light = self.lights[held[slot] as usize];
                *colour = self.store.pixel(v, pixel)[slot].map(|c| f32::from(c) / 255.0);
            } else {
                *light = self.lights[held[random.below_at(own, held.len() as u32) as usize] as usize];
                move_light(light, self.probe_reach, |axis| random.uniform_at(own + 1 + axis));
                *colour = [f32::NAN; 3];
            }
        });
    }

    /// The lights of `step`. Moved a little, they teach a field to go evenly from one to the next, and blur the shadows that
    /// photographs show.
    fn shift_lights(&self, step: u64, lights: &mut Vec<LightPose>) {
        lights.clone_from(&self.lights);
        let random = Random::new(self.seed, SHIFT_STREAM + step);
        for (i, light) in lights.iter_mut().enumerate() {
            move_light(light, self.shift, |axis| random.uniform_at(3 * i as u64 + axis));
        }
    }

    /// The view and pixel that draws `first` and `first + 1` of `random` choose.
    fn pixel(&self, random: Random, first: u64) -> (usize, usize) {
        let pairs = self.views.last().map_or(0, |v| v.pairs_before_next);
        // The high half of a 128-bit product maps 64 random bits to 0..pairs.
        let chosen = ((u128::from(random.u64_at(first)) * u128::from(pairs)) >> 64) as u64;
        let v = self.views.partition_point(|view| view.pairs_before_next <= chosen);
        let pixels = self.store.pixels(v) as u32;
        (v, random.below_at(first + 1, pixels) as usize)
    }
}

/// Moves a light by up to `reach` along each axis; `uniform(axis)` is a random number in 0..1.
fn move_light(light: &mut LightPose, reach: f32, uniform: impl Fn(u64) -> f32) {
    // Column 3 of the pose is the position.
    for (axis, number) in [3, 7, 11].into_iter().enumerate() {
        light.0[number] += (2.0 * uniform(axis as u64) - 1.0) * reach;
    }
}

fn unit(v: [f64; 3]) -> [f32; 3] {
    let norm = (v[0] * v[0] + v[1] * v[1] + v[2] * v[2]).sqrt();
    v.map(|c| (c / norm) as f32)
}

/// Fills `out` with distinct numbers below `n`, every subset equally likely (Floyd's algorithm); `bits(i)` is the
/// `i`-th 32-bit random number. `out` must not be longer than `n`.
fn draw_distinct(n: u32, out: &mut [u32], bits: impl Fn(u64) -> u32) {
    let k = out.len() as u32;
    for i in 0..k {
        let top = n - k + i;
        let candidate = ((u64::from(bits(u64::from(i))) * u64::from(top + 1)) >> 32) as u32;
        out[i as usize] = if out[..i as usize].contains(&candidate) { top } else { candidate };
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn distinct_draws_are_distinct_and_even() {
        let random = Random::new(3, 1);
        let mut counts = [0usize; 10];
        for trial in 0..20_000u64 {
            let mut out = [0u32; 4];
            draw_distinct(10, &mut out, |i| random.u32_at(trial * 4 + i));
            let mut sorted = out;
            sorted.sort_unstable();
            assert!(sorted.windows(2).all(|w| w[0] < w[1]) && sorted[3] < 10, "{out:?}");
            out.iter().for_each(|&i| counts[i as usize] += 1);
        }
        // 8000 each, standard deviation 69.
        assert!(counts.iter().all(|c| c.abs_diff(8000) < 350), "{counts:?}");
        let mut all = [0u32; 5];
        draw_distinct(5, &mut all, |i| random.u32_at(i));
        all.sort_unstable();
        assert_eq!(all, [0, 1, 2, 3, 4]);
    }
}
