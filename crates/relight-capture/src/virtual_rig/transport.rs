//! How light reaches one pixel: camera paths of one bounce, shared by all lights.
//!
//! A sample is a camera ray and one bounce drawn from the scattering of what it meets. Both surfaces are then joined to
//! every light; only these last steps cost anything for each light. What a light gives does not depend on which other lights
//! are asked for.

use fearless_simd::Level;
use glam::Vec3A;
use relight_scene::{Camera, Light};

use super::VirtualRig;
use super::bsdf::{Bsdf, Facing};
use super::geometry::Hit;
use super::lamp::Aims;
use super::occlusion::{LANES, Packet, Stack};
use super::random::{hash, stratified, uniform};
use super::settings::Filter;

/// How far rays start from the surface that they leave, metres: some hundred times what rounding moves a hit.
const STEP: f32 = 2e-5;
/// Neighbouring lights (by label) that a bounce is joined to together.
const LIGHTS_A_BLOCK: usize = LANES;

/// Purposes of random numbers.
mod stream {
    pub const PIXEL: u64 = 1;
    pub const BOUNCE: u64 = 2;
    pub const CHOICE: u64 = 3;
    pub const AIM: u64 = 4;
    pub const AIM_AFTER_BOUNCE: u64 = 5;
    pub const BLOCK: u64 = 6;
}

/// A place that light may reach, and the share of it that the pixel receives.
struct Vertex<'a> {
    position: Vec3A,
    facing: Facing,
    bsdf: Bsdf<'a>,
    throughput: Vec3A,
    sample: u32,
}

/// A light, ready for tracing.
struct Source {
    position: [f32; 3],
    label: usize,
}

/// Paths of one camera under some lights.
pub(super) struct Paths<'a> {
    rig: &'a VirtualRig,
    camera: &'a Camera,
    sources: Vec<Source>,
    level: Level,
}

/// What a pixel's work needs room for; kept from pixel to pixel.
#[derive(Default)]
pub(super) struct Room<'a> {
    seen: Vec<Vertex<'a>>,
    bounced: Vec<Vertex<'a>>,
    chosen: Vec<usize>,
    stack: Stack,
}

impl<'a> Paths<'a> {
    pub(super) fn new(rig: &'a VirtualRig, camera: &'a Camera, lights: &[Light]) -> Self {
        let source =
            |light: &Light| Source { position: light.pose.position().map(|v| v as f32), label: light.label };
        Self { rig, camera, sources: lights.iter().map(source).collect(), level: Level::new() }
    }

    /// Radiance of the lights' shares of pixel (x, y), one sum a light, into `sums`.
    pub(super) fn pixel(&self, [x, y]: [u32; 2], sums: &mut [Vec3A], room: &mut Room<'a>) {
        sums.fill(Vec3A::ZERO);
        let pixel = u64::from(y) << 32 | u64::from(x);
        let seed = hash(&[self.rig.settings.seed, self.camera.label as u64, pixel]);
        self.trace([x, y], seed, room);
        for chunk in room.seen.chunks(LANES) {
            for (source, sum) in self.sources.iter().zip(sums.iter_mut()) {
                let aims = self.rig.aims.set(hash(&[seed, stream::AIM, source.label as u64]));
                let lane = |i: usize| (&chunk[i], source, aims);
                self.join(chunk.len(), lane, &mut room.stack, |_, light| *sum += light);
            }
        }
        // Each bounce is joined to one in `share` blocks of lights, in turn.
        let share = self.rig.settings.bounce_share as usize;
        let turn = hash(&[seed, stream::BLOCK]) as usize % share;
        for vertex in &room.bounced {
            let is_due =
                |s: &Source| (s.label / LIGHTS_A_BLOCK + vertex.sample as usize + turn).is_multiple_of(share);
            room.chosen.clear();
            room.chosen.extend((0..self.sources.len()).filter(|&l| is_due(&self.sources[l])));
            for chosen in room.chosen.chunks(LANES) {
                let lane = |i: usize| {
                    let source = &self.sources[chosen[i]];
                    let aims = hash(&[seed, stream::AIM_AFTER_BOUNCE, source.label as u64]);
                    (vertex, source, self.rig.aims.set(aims))
                };
                let add = |i: usize, light: Vec3A| sums[chosen[i]] += light * share as f32;
                self.join(chosen.len(), lane, &mut room.stack, add);
            }
        }
        let scale = self.rig.intensity / self.rig.settings.samples as f32;
        sums.iter_mut().for_each(|sum| *sum *= scale);
    }

    /// Camera rays and their bounces.
    fn trace(&self, [x, y]: [u32; 2], seed: u64, room: &mut Room<'a>) {
        room.seen.clear();
        room.bounced.clear();
        let lens = PixelLens::new(self.camera, f64::from(x), f64::from(y));
        let origin = Vec3A::from_array(self.camera.pose.position().map(|v| v as f32));
        for sample in 0..self.rig.settings.samples {
            let offset = self.rig.settings.filter.offset(stratified(sample, hash(&[seed, stream::PIXEL])));
            let direction =
                Vec3A::from_array(self.camera.pose.rotate(lens.ray(offset)).map(|v| v as f32)).normalize();
            let Some(seen) = self.vertex(origin, direction, Vec3A::ONE, sample, false) else { continue };
            let point = stratified(sample, hash(&[seed, stream::BOUNCE]));
            let choice = uniform(hash(&[seed, stream::CHOICE, u64::from(sample)]));
            if let Some(bounce) = seen.bsdf.sample(&seen.facing, point, choice) {
                let start = seen.leave(bounce.direction);
                room.bounced.extend(self.vertex(start, bounce.direction, bounce.weight, sample, true));
            }
            room.seen.push(seen);
        }
    }

    fn vertex(
        &self,
        origin: Vec3A,
        direction: Vec3A,
        throughput: Vec3A,
        sample: u32,
        after_a_bounce: bool,
    ) -> Option<Vertex<'a>> {
        let Hit { position, geometric, shading, uv, surface } =
            self.rig.geometry.first_hit(origin, direction)?;
        let bsdf = self.rig.surfaces.get(surface as usize)?.bsdf(uv, position, after_a_bounce);
        Some(Vertex {
            position,
            facing: Facing::towards(-direction, geometric, shading),
            bsdf,
            throughput,
            sample,
        })
    }

    /// Joins up to sixteen vertices to one light each, and hands on the light that arrives, for unit intensity.
    fn join<'v>(
        &self,
        lanes: usize,
        lane: impl Fn(usize) -> (&'v Vertex<'a>, &'v Source, &'v [[f32; 2]]),
        stack: &mut Stack,
        mut add: impl FnMut(usize, Vec3A),
    ) where
        'a: 'v,
    {
        let mut aims = Aims { point: [[0.0; LANES]; 3], lamp: [[1.0; LANES]; 3], disc: [[0.0; LANES]; 2] };
        for i in 0..lanes {
            let (vertex, source, set) = lane(i);
            for k in 0..3 {
                aims.point[k][i] = vertex.position[k];
                aims.lamp[k][i] = source.position[k];
            }
            let disc = set[vertex.sample as usize];
            (aims.disc[0][i], aims.disc[1][i]) = (disc[0], disc[1]);
        }
        let sight = aims.sight(self.level, self.rig.lamp.radius as f32);
        let mut packet =
            Packet { origin: aims.point, direction: sight.direction, length: sight.length, asked: 0 };
        let mut light = [Vec3A::ZERO; LANES];
        for (i, light) in light.iter_mut().enumerate().take(lanes) {
            let (vertex, ..) = lane(i);
            let direction = Vec3A::from_array([0, 1, 2].map(|k| sight.direction[k][i]));
            *light = vertex.throughput * vertex.bsdf.eval(&vertex.facing, direction) * sight.weight[i];
            if light.max_element() > 0.0 {
                packet.asked |= 1 << i;
                let start = vertex.leave(direction);
                (0..3).for_each(|k| packet.origin[k][i] = start[k]);
            }
        }
        let occluded = self.rig.geometry.occluded(self.level, &packet, stack);
        let reached = packet.asked & !occluded;
        for (i, light) in light.into_iter().enumerate().take(lanes).filter(|(i, _)| reached >> i & 1 == 1) {
            add(i, light);
        }
    }
}

impl Vertex<'_> {
    /// Where a ray along a direction starts: just off the surface, on the ray's side.
    fn leave(&self, direction: Vec3A) -> Vec3A {
        let side = STEP.copysign(self.facing.geometric.dot(direction));
        self.position + self.facing.geometric * side
    }
}

/// The lens around one pixel, straightened: the ray of the centre and how it changes. Over a pixel, distortion is as good as
/// linear.
struct PixelLens {
    centre: [f64; 3],
    across: [f64; 2],
    down: [f64; 2],
}

impl PixelLens {
    fn new(camera: &Camera, x: f64, y: f64) -> Self {
        let ray = |dx: f64, dy: f64| camera.intrinsics.unproject(x + dx, y + dy);
        let slope = |a: [f64; 3], b: [f64; 3]| [a[0] - b[0], a[1] - b[1]];
        Self {
            centre: ray(0.0, 0.0),
            across: slope(ray(0.5, 0.0), ray(-0.5, 0.0)),
            down: slope(ray(0.0, 0.5), ray(0.0, -0.5)),
        }
    }

    fn ray(&self, [dx, dy]: [f64; 2]) -> [f64; 3] {
        let along = |k: usize| self.centre[k] + dx * self.across[k] + dy * self.down[k];
        [along(0), along(1), self.centre[2]]
    }
}

impl Filter {
    /// Offset from the pixel's centre, pixels, for a point of the unit square.
    fn offset(self, [u, v]: [f32; 2]) -> [f64; 2] {
        let warp = |t: f64| match self {
            Filter::Box => t - 0.5,
            // The tent's distribution, turned round.
            Filter::Tent if t < 0.5 => (2.0 * t).sqrt() - 1.0,
            Filter::Tent => 1.0 - (2.0 - 2.0 * t).sqrt(),
        };
        [warp(f64::from(u)), warp(f64::from(v))]
    }
}
