//! One tile: a few whole rays with all their samples, from features to colours and back.
//!
//! Everything between the hash grid's features and their gradients happens here while it is in cache, by one
//! thread.

use fearless_simd::Level;
use relight_field::architecture::GEO_OUTPUTS;
use relight_field::sampling::Shading;

use crate::composite;
use crate::deferred::Deferred;
use crate::exponential::exponentials;
use crate::march::along;
use crate::mlp::Tape;
use crate::networks::{Gradients, Networks};
use crate::shade::{CodedLight, Point, Shader};
use crate::stages::{Clock, Stage};

/// Samples that weigh less are not shaded (torch-ngp's threshold).
const WEIGHT_THRESHOLD: f32 = 1e-4;
/// Keeps `exp` finite; a density of `exp(60)` is as opaque as any.
const LOGIT_LIMIT: f32 = 60.0;
/// Where torch-ngp's `trunc_exp` stops the derivative from growing, and below its negative from falling.
const DERIVATIVE_LIMIT: f32 = 15.0;

/// The rays of a tile and where their samples lie. Sample `k` of ray `r` is column `r * samples + k`.
#[derive(Clone, Copy)]
pub struct TileRays<'a> {
    /// Origins, metres.
    pub origins: &'a [[f32; 3]],
    /// Unit directions.
    pub directions: &'a [[f32; 3]],
    /// Samples a ray.
    pub samples: usize,
    /// Columns of the tile: at least `rays * samples`, a multiple of 16.
    pub columns: usize,
    /// `[columns]`: distance of each sample along its ray, metres.
    pub t: &'a [f32],
    /// `[columns]`: length of each sample's interval, metres.
    pub lengths: &'a [f32],
    /// `[features][columns]`: `h` at the samples.
    pub features: &'a [f32],
}

/// What a tile is to be punished for beside its colours.
#[derive(Clone, Copy)]
pub struct Regularisers<'a> {
    /// Expected depth of each ray, metres, NaN where unknown; empty if there is none.
    pub depths: &'a [f32],
    /// Weight of the depth penalty, divided by the rays of the batch.
    pub depth_weight: f32,
    /// Its margin, metres.
    pub depth_margin: f32,
    /// Weight of the distortion loss, divided by the rays of the batch.
    pub distortion_weight: f32,
    /// Longest edge of the box, metres.
    pub edge: f32,
}

/// Memory of one thread, reused from tile to tile; after [`Workspace::forward`] it holds the results.
#[derive(Default)]
pub struct Workspace {
    /// Where the time goes.
    pub clock: Clock,
    geo: Tape,
    /// `[columns]`: density times interval length.
    optical: Vec<f32>,
    /// `[columns]`: density, per metre.
    pub density: Vec<f32>,
    /// `[columns]`: what each sample counts in its ray.
    pub weights: Vec<f32>,
    /// Points, their colours and visibilities.
    pub shader: Shader,
    /// `[rays * lights]`: colours.
    pub colours: Vec<[f32; 3]>,
    /// `[rays]`: expected depth, metres.
    pub depths: Vec<f32>,
    weight_gradient: Vec<f32>,
    deferred: Deferred,
    /// For per-sample shading, the column of each point.
    columns_of_points: Vec<usize>,
}

impl Workspace {
    /// Density at every column of `features`, into `density`, and nothing else of `geo` but [`Workspace::hidden_activations`].
    pub fn densities(&mut self, simd: Level, networks: &Networks, features: &[f32], columns: usize) {
        networks.geo.prepare(&mut self.geo, columns, columns);
        networks.geo.forward_to_hidden(simd, features, &mut self.geo);
        self.density.resize(columns, 0.0);
        networks.geo.output_rows(simd, self.geo.hidden_activations(), columns, 0..1, &mut self.density);
        self.activate(simd, networks);
    }

    /// The last hidden activations of `geo` at the columns last given to [`Workspace::densities`], `[hidden_width][columns]`, of which
    /// [`Networks::embeddings`] are made.
    pub fn hidden_activations(&self) -> &[f32] {
        self.geo.hidden_activations()
    }

    /// From logits, in `density`, to densities.
    fn activate(&mut self, simd: Level, networks: &Networks) {
        self.density.iter_mut().for_each(|logit| *logit = logit.min(LOGIT_LIMIT));
        exponentials(simd, &mut self.density);
        self.density.iter_mut().for_each(|density| *density *= networks.density_scale);
    }

    /// Weights of the samples of all rays and where the rays end, into `weights` and `depths`, from densities of the tile's
    /// features.
    pub fn look(&mut self, simd: Level, networks: &Networks, rays: &TileRays<'_>) {
        networks.geo.prepare(&mut self.geo, rays.columns, rays.columns);
        networks.geo.forward(simd, rays.features, &mut self.geo);
        self.density.clear();
        self.density.extend(&self.geo.output()[..rays.columns]);
        self.activate(simd, networks);
        self.clock.lap(Stage::Geometry, networks.geo.forward_operations(rays.columns, rays.columns));
        self.optical.clear();
        self.optical.extend(self.density.iter().zip(rays.lengths).map(|(d, l)| d * l));
        self.weights.clear();
        self.weights.resize(rays.columns, 0.0);
        self.depths.clear();
        for r in 0..rays.origins.len() {
            let span = r * rays.samples..(r + 1) * rays.samples;
            composite::weights(&self.optical[span.clone()], &mut self.weights[span.clone()]);
            let depth = self.weights[span.clone()].iter().zip(&rays.t[span]).map(|(w, t)| w * t).sum();
            self.depths.push(depth);
        }
        self.clock.lap(Stage::Composite, 0);
    }

    /// Colours of all pairs.
    pub fn forward<'a>(
        &mut self,
        simd: Level,
        networks: &Networks,
        shading: Shading,
        rays: &TileRays<'_>,
        lights: usize,
        light: impl Fn(usize, usize) -> &'a CodedLight,
    ) {
        self.look(simd, networks, rays);
        self.shade(simd, networks, shading, rays, lights, light);
    }

    /// Colours of all pairs, after [`Workspace::look`].
    pub fn shade<'a>(
        &mut self,
        simd: Level,
        networks: &Networks,
        shading: Shading,
        rays: &TileRays<'_>,
        lights: usize,
        light: impl Fn(usize, usize) -> &'a CodedLight,
    ) {
        match shading {
            Shading::Deferred => {
                let rows = feature_rows(networks, rays, &self.geo);
                self.deferred.points(rays, &self.weights, rows, &mut self.shader);
            }
            Shading::PerSample => self.select_points(networks, rays),
        }
        self.clock.lap(Stage::Composite, 2 * networks.point_features() * rays.columns);
        self.shader.forward(simd, networks, rays.directions, lights, light);
        self.colours.clear();
        self.colours.resize(rays.origins.len() * lights, [0.0; 3]);
        let (columns, points) = (self.shader.columns(), &self.shader.points);
        for l in 0..lights {
            for (q, point) in points.iter().enumerate() {
                let p = l * points.len() + q;
                let scale = point.weight * self.shader.visibility[p];
                for (channel, value) in self.colours[point.ray * lights + l].iter_mut().enumerate() {
                    *value += scale * self.shader.colour[channel * columns + p];
                }
            }
        }
        let operations = networks.shading_operations(columns, self.shader.wide());
        self.clock.lap(Stage::Shade, operations.0);
    }

    /// The samples that weigh something.
    fn select_points(&mut self, networks: &Networks, rays: &TileRays<'_>) {
        let shader = &mut self.shader;
        shader.points.clear();
        self.columns_of_points.clear();
        for (ray, (&origin, &direction)) in rays.origins.iter().zip(rays.directions).enumerate() {
            for column in ray * rays.samples..(ray + 1) * rays.samples {
                let weight = self.weights[column];
                if weight > WEIGHT_THRESHOLD {
                    let position = along(origin, direction, rays.t[column]);
                    shader.points.push(Point { ray, position, weight });
                    self.columns_of_points.push(column);
                }
            }
        }
        shader.features.clear();
        for row in feature_rows(networks, rays, &self.geo) {
            shader.features.extend(self.columns_of_points.iter().map(|&c| row[c]));
        }
    }

    /// From colour gradients (and the regularisers) to gradients of the networks and of the tile's features,
    /// `[features][columns]`. Returns the sums over rays of the depth penalty and the distortion loss.
    #[allow(clippy::too_many_arguments)]
    pub fn backward(
        &mut self,
        simd: Level,
        networks: &Networks,
        shading: Shading,
        rays: &TileRays<'_>,
        lights: usize,
        colour_gradient: &[[f32; 3]],
        regularisers: &Regularisers<'_>,
        gradients: &mut Gradients,
        feature_gradient: &mut [f32],
    ) -> (f32, f32) {
        let (n, k, columns) = (rays.origins.len(), rays.samples, rays.columns);
        let shader = &mut self.shader;
        shader.backward(simd, networks, lights, |r, l| colour_gradient[r * lights + l], gradients);
        let (pairs, points) = (shader.columns(), shader.wide());
        self.clock.lap(Stage::ShadeBackward, networks.shading_operations(pairs, points).1);
        self.weight_gradient.clear();
        self.weight_gradient.resize(columns, 0.0);
        feature_gradient.fill(0.0);
        let (geo, d_geo) = self.geo.output_and_gradient();
        d_geo.fill(0.0);
        let (d_logit, d_embedding) = d_geo.split_at_mut(columns);
        let sources = rays.features[..networks.features * columns].chunks_exact(columns);
        let sources = sources.chain(geo[columns..].chunks_exact(columns));
        let targets = feature_gradient.chunks_exact_mut(columns).take(networks.features);
        let targets = targets.chain(d_embedding.chunks_exact_mut(columns));
        match shading {
            Shading::PerSample => {
                let by_point = shader.feature_gradients.chunks_exact(shader.points.len().max(1));
                for (target, d_points) in targets.zip(by_point) {
                    for (&column, &d) in self.columns_of_points.iter().zip(d_points) {
                        target[column] = d;
                    }
                }
                for (&column, &d) in self.columns_of_points.iter().zip(&shader.weight_gradients) {
                    self.weight_gradient[column] = d;
                }
            }
            Shading::Deferred => {
                let rows = sources.zip(targets);
                self.deferred.backward(k, &self.weights, shader, rows, &mut self.weight_gradient);
            }
        }
        let (mut penalty, mut spread) = (0.0, 0.0);
        for r in 0..n {
            let span = r * k..(r + 1) * k;
            let (w, t) = (&self.weights[span.clone()], &rays.t[span.clone()]);
            let g = &mut self.weight_gradient[span.clone()];
            let depth = regularisers.depths.get(r).copied().unwrap_or(f32::NAN);
            if regularisers.depth_weight > 0.0 && depth.is_finite() {
                let margin = regularisers.depth_margin;
                penalty += composite::depth_penalty(w, t, depth, margin, regularisers.depth_weight, g);
            }
            if regularisers.distortion_weight > 0.0 {
                let (lengths, scale) = (&rays.lengths[span], regularisers.distortion_weight);
                spread += composite::distortion(w, t, lengths, regularisers.edge, scale, g);
            }
            composite::backward(w, g);
        }
        // d optical / d logit is the optical depth itself, with the derivative of exp limited.
        let [least, limit] = [-DERIVATIVE_LIMIT, DERIVATIVE_LIMIT].map(|l| networks.density_scale * l.exp());
        for (c, d) in d_logit.iter_mut().enumerate().take(n * k) {
            *d = self.weight_gradient[c] * self.density[c].clamp(least, limit) * rays.lengths[c];
        }
        self.clock.lap(Stage::CompositeBackward, 3 * networks.point_features() * columns);
        networks.geo.backward(simd, rays.features, &mut self.geo, &mut gradients.geo, 0..networks.features);
        feature_gradient.iter_mut().zip(self.geo.input_gradient()).for_each(|(a, b)| *a += b);
        let operations = networks.geo.backward_operations(columns, columns, 0..networks.features);
        self.clock.lap(Stage::GeometryBackward, operations);
        (penalty, spread)
    }
}

/// `h` and `e` at the samples of a tile, of which `geo` has the embeddings: rows of `[columns]`.
fn feature_rows<'a>(
    networks: &Networks,
    rays: &TileRays<'a>,
    geo: &'a Tape,
) -> impl Iterator<Item = &'a [f32]> {
    let embeddings = &geo.output()[rays.columns..GEO_OUTPUTS * rays.columns];
    let encoded = rays.features[..networks.features * rays.columns].chunks_exact(rays.columns);
    encoded.chain(embeddings.chunks_exact(rays.columns))
}
