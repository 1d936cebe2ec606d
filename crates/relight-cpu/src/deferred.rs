//! Deferred shading: a ray's colour is decoded for what it meets inside the box, and once more for what lies beyond where
//! that shows ([`Shading::Deferred`](relight_field::sampling::Shading::Deferred)): its last sample, for guided samples the
//! box's face.
//!
//! The two are kept apart since their features have nothing in common. Were they averaged as well, a ray half through a
//! surface would be decoded from features that are neither's, and its gradient would say nothing of how dense the surface
//! should be: holes would grow.

use relight_field::sampling;

use crate::march::along;
use crate::shade::{Point, Shader};
use crate::tile::TileRays;

/// [`sampling::NEGLIGIBLE`] in single precision.
pub const NEGLIGIBLE: f32 = sampling::NEGLIGIBLE as f32;

/// What counts in a ray's colour of what it meets inside the box, and of what lies beyond, by their weights.
pub fn shares(inside: f32, beyond: f32) -> (f32, f32) {
    if inside <= NEGLIGIBLE {
        (0.0, 1.0)
    } else if beyond <= NEGLIGIBLE {
        (1.0, 0.0)
    } else {
        (inside, beyond)
    }
}

/// Which points the rays of a tile have: each its first, in order, then some a second.
#[derive(Default)]
pub struct Deferred {
    /// `[rays]`: weight of all that is met inside the box, 0..1; 0 where the first point is the last sample.
    inside: Vec<f32>,
    /// The rays whose second point is that.
    faces: Vec<usize>,
}

impl Deferred {
    /// Gives `shader` the points of a tile's rays, and their features: averages of `rows`, each `[columns]`, under the
    /// samples' `weights`.
    pub fn points<'a>(
        &mut self,
        rays: &TileRays<'_>,
        weights: &[f32],
        rows: impl Iterator<Item = &'a [f32]>,
        shader: &mut Shader,
    ) {
        let (n, k) = (rays.origins.len(), rays.samples);
        let last = |ray: usize| (ray + 1) * k - 1;
        let point = |ray: usize, t, weight| Point {
            ray,
            position: along(rays.origins[ray], rays.directions[ray], t),
            weight,
        };
        shader.points.clear();
        self.inside.clear();
        self.faces.clear();
        for ray in 0..n {
            let (w, t) = (&weights[ray * k..last(ray)], &rays.t[ray * k..last(ray)]);
            let inside: f32 = w.iter().sum();
            let (inner, outer) = shares(inside, weights[last(ray)]);
            if inner == 0.0 {
                self.inside.push(0.0);
                shader.points.push(point(ray, rays.t[last(ray)], outer));
                continue;
            }
            let depth = w.iter().zip(t).map(|(w, t)| w * t).sum::<f32>() / inside;
            self.inside.push(inside);
            shader.points.push(point(ray, depth, inner));
            if outer > 0.0 {
                self.faces.push(ray);
            }
        }
        let faces = self.faces.iter();
        shader.points.extend(faces.map(|&ray| point(ray, rays.t[last(ray)], weights[last(ray)])));
        shader.features.clear();
        for row in rows {
            let samples = row.chunks_exact(k).zip(weights.chunks_exact(k));
            shader.features.extend(samples.zip(&self.inside).map(|((f, w), &inside)| {
                if inside == 0.0 {
                    f[k - 1]
                } else {
                    f[..k - 1].iter().zip(w).map(|(f, w)| f * w).sum::<f32>() / inside
                }
            }));
            shader.features.extend(self.faces.iter().map(|&ray| row[last(ray)]));
        }
    }

    /// From the gradients of the points of `shader` to those of the samples, `samples` a ray: of their features, into the
    /// second of each pair of `rows` (the first are the features), and of their `weights`, added to `weight_gradient`.
    pub fn backward<'a>(
        &self,
        samples: usize,
        weights: &[f32],
        shader: &Shader,
        rows: impl Iterator<Item = (&'a [f32], &'a mut [f32])>,
        weight_gradient: &mut [f32],
    ) {
        let (n, points, k) = (self.inside.len(), shader.points.len(), samples);
        let by_point =
            shader.features.chunks_exact(points).zip(shader.feature_gradients.chunks_exact(points));
        for ((source, target), (means, d_points)) in rows.zip(by_point) {
            let rays = self.inside.iter().zip(means.iter().zip(d_points));
            for (ray, (&inside, (mean, d))) in rays.enumerate() {
                let (span, last) = (ray * k..(ray + 1) * k - 1, (ray + 1) * k - 1);
                if inside == 0.0 {
                    target[last] = *d;
                    continue;
                }
                let d = d / inside;
                let places = source[span.clone()].iter().zip(&mut target[span.clone()]);
                let places = places.zip(weights[span.clone()].iter().zip(&mut weight_gradient[span]));
                for ((source, target), (w, dw)) in places {
                    *target = w * d;
                    *dw += (source - mean) * d;
                }
            }
            for (&ray, &d) in self.faces.iter().zip(&d_points[n..]) {
                target[(ray + 1) * k - 1] = d;
            }
        }
        let (of_rays, of_faces) = shader.weight_gradients.split_at(n);
        for (&ray, beyond) in self.faces.iter().zip(of_faces) {
            let last = (ray + 1) * k - 1;
            weight_gradient[ray * k..last].iter_mut().for_each(|d| *d += of_rays[ray]);
            weight_gradient[last] += beyond;
        }
    }
}
