//! Backward: the loss of a batch and its derivatives, phase by phase in reverse.

use super::Field;
use super::composite::{self, RayTrace, Shaded};
use super::march::{Ray, RaySamples};
use crate::architecture::{EMBEDDING, EmbeddingEntry};
use crate::compositing;
use crate::engine::{EngineError, RayBatch, StepSettings};
use crate::parameters::Parameters;
use crate::real::Real;
use crate::sampling::Shading;

/// The density's derivative takes the exponential of a logit held within this, as torch-ngp's truncated exponential
/// does, lest one opaque sample outweigh all others.
const MAX_GRADIENT_LOGIT: f64 = 15.0;

/// A batch's loss and its derivatives.
#[derive(Clone, Debug)]
pub struct Evaluation<R> {
    /// Mean squared error over pairs and channels.
    pub colour: R,
    /// Mean over rays of the depth penalty; a ray without an expected depth counts as zero.
    pub depth: R,
    /// Mean over rays of the distortion loss, with distances in units of the box's longest edge.
    pub distortion: R,
    /// `colour + depth_weight depth + distortion_weight distortion`.
    pub total: R,
    /// Derivatives of `total`.
    pub gradient: Parameters<R>,
    /// Mean over rays of the standard deviation of depth under the ray's weights, metres.
    pub depth_spread: R,
}

/// Derivatives of the loss by what a site was made of.
#[derive(Clone)]
struct SiteGradient<R> {
    weight: R,
    h: Vec<R>,
    e: Vec<R>,
}

/// The loss of `batch` and its derivatives, for given samples of every ray. The last sample of a ray is opaque.
///
/// # Errors
/// [`EngineError::Shape`] if the batch contradicts itself, or if a ray has no samples or `t` and `delta` that differ
/// in length.
pub fn loss_and_gradient<R: Real>(
    field: &Field<R>,
    shading: Shading,
    batch: &RayBatch,
    samples: &[RaySamples<R>],
    settings: &StepSettings,
) -> Result<Evaluation<R>, EngineError> {
    check(batch, settings)?;
    let rays = batch.rays.origins.len();
    if samples.len() != rays || samples.iter().any(|s| s.t.is_empty() || s.t.len() != s.delta.len()) {
        return Err(EngineError::Shape("every ray needs samples, and every sample t and delta".to_owned()));
    }
    let bounds = &field.parameters.config.bounds;
    let edge = (0..3).map(|a| R::from_f32(bounds.hi[a] - bounds.lo[a])).fold(R::ZERO, R::max);
    let per_ray = R::ONE / R::from_f64(rays.max(1) as f64);
    let per_pair = per_ray / R::from_f64(3.0 * batch.lights_per_ray.max(1) as f64);
    let depth_weight = R::from_f32(settings.depth_weight);
    let distortion_weight = R::from_f32(settings.distortion_weight);

    let mut result = Evaluation {
        colour: R::ZERO,
        depth: R::ZERO,
        distortion: R::ZERO,
        total: R::ZERO,
        gradient: field.parameters.map(|_| R::ZERO),
        depth_spread: R::ZERO,
    };
    for (r, samples) in samples.iter().enumerate() {
        let ray = Ray::new(batch.rays.origins[r], batch.rays.directions[r]);
        let trace = composite::trace(field, shading, &ray, samples);
        let weight = &trace.weights.weight;

        let none = |site: &composite::Site<R>| SiteGradient {
            weight: R::ZERO,
            h: vec![R::ZERO; site.h.len()],
            e: vec![R::ZERO; EMBEDDING],
        };
        let mut d_sites: Vec<_> = trace.sites.iter().map(none).collect();
        for pair in r * batch.lights_per_ray..(r + 1) * batch.lights_per_ray {
            let light = &batch.lights[batch.light_index[pair] as usize];
            let shaded = composite::shade(field, &trace, light);
            let error: [R; 3] =
                std::array::from_fn(|c| shaded.colour[c] - R::from_f32(batch.colours[pair][c]));
            result.colour += per_pair * error.iter().map(|&e| e * e).sum();
            let d_colour = error.map(|e| R::from_f64(2.0) * per_pair * e);
            shade_backward(field, &trace, &shaded, d_colour, &mut d_sites, &mut result.gradient);
        }

        let mut d_weight = vec![R::ZERO; weight.len()];
        let expected = batch.depths.get(r).copied().filter(|d| !d.is_nan() && settings.depth_weight != 0.0);
        if let Some(depth) = expected {
            let (depth, margin) = (R::from_f32(depth), R::from_f32(settings.depth_margin));
            let (penalty, by_weight) = compositing::depth_penalty(weight, &samples.t, depth, margin);
            result.depth += per_ray * penalty;
            add_scaled(&mut d_weight, depth_weight * per_ray, &by_weight);
        }
        if settings.distortion_weight != 0.0 {
            let (loss, by_weight) = compositing::distortion(weight, &samples.t, &samples.delta);
            result.distortion += per_ray * loss / edge;
            add_scaled(&mut d_weight, distortion_weight * per_ray / edge, &by_weight);
        }
        trace_backward(field, &trace, samples, &d_sites, d_weight, &mut result.gradient);

        let mean: R = weight.iter().zip(&samples.t).map(|(&w, &t)| w * t).sum();
        let variance: R = weight.iter().zip(&samples.t).map(|(&w, &t)| w * (t - mean) * (t - mean)).sum();
        result.depth_spread += per_ray * variance.sqrt();
    }
    result.total = result.colour + depth_weight * result.depth + distortion_weight * result.distortion;
    Ok(result)
}

/// Refuses a batch that contradicts itself.
fn check(batch: &RayBatch, settings: &StepSettings) -> Result<(), EngineError> {
    let n = batch.rays.origins.len();
    let pairs = n.saturating_mul(batch.lights_per_ray);
    let fault = if batch.rays.directions.len() != n {
        format!("{n} ray origins but {} directions", batch.rays.directions.len())
    } else if n == 0 || batch.lights_per_ray == 0 {
        "a batch needs at least one ray and one light a ray".to_owned()
    } else if batch.light_index.len() != pairs || batch.colours.len() != pairs {
        let (lights, colours) = (batch.light_index.len(), batch.colours.len());
        format!("{n} rays of {} pairs, but {lights} lights and {colours} colours", batch.lights_per_ray)
    } else if let Some(&light) = batch.light_index.iter().find(|&&l| l as usize >= batch.lights.len()) {
        format!("light {light} of a pair, but there are {}", batch.lights.len())
    } else if !batch.depths.is_empty() && batch.depths.len() != n {
        format!("{n} rays but {} expected depths", batch.depths.len())
    } else if settings.depth_weight != 0.0 && settings.depth_margin.is_nan() | (settings.depth_margin <= 0.0)
    {
        format!("a depth margin of {} metres; it must be positive", settings.depth_margin)
    } else {
        return Ok(());
    };
    Err(EngineError::Shape(fault))
}

/// Backward of [`composite::shade`]: adds to the gradients of the sites and of the decoding networks.
fn shade_backward<R: Real>(
    field: &Field<R>,
    trace: &RayTrace<R>,
    shaded: &Shaded<R>,
    d_colour: [R; 3],
    d_sites: &mut [SiteGradient<R>],
    gradient: &mut Parameters<R>,
) {
    let parameters = &field.parameters;
    let architecture = parameters.config.architecture;
    let features = parameters.config.grid.outputs();
    for ((site, decoded), d_site) in trace.sites.iter().zip(&shaded.decoded).zip(d_sites) {
        let (o, c) = (decoded.visibility, decoded.reflectance);
        let d_radiance: R = (0..3).map(|k| d_colour[k] * c[k]).sum();
        d_site.weight += o * d_radiance;

        // A sigmoid s has the derivative s (1 - s).
        let d_rgb: [R; 3] = std::array::from_fn(|k| site.weight * o * d_colour[k] * c[k] * (R::ONE - c[k]));
        let d = parameters.rgb.backward(&decoded.rgb, &d_rgb, &mut gradient.rgb);
        let mut at = trace.view.len() + architecture.light_inputs();
        if architecture.position_skip {
            add_scaled(&mut d_site.h, R::ONE, &d.input[at..at + features]);
            at += features;
        }
        let d_e = match architecture.embedding {
            EmbeddingEntry::Layer1 => &d.input[at..],
            EmbeddingEntry::Layer2 => &d.late[..],
        };
        add_scaled(&mut d_site.e, R::ONE, d_e);

        if let (Some(vis), Some(trace), Some(gradient)) = (&parameters.vis, &decoded.vis, &mut gradient.vis) {
            let d_vis = site.weight * d_radiance * o * (R::ONE - o);
            let d = vis.backward(trace, &[d_vis], gradient);
            add_scaled(&mut d_site.h, R::ONE, &d.input[..features]);
        }
    }
}

/// Backward of [`composite::trace`]: from the sites and the samples' weights to densities, to `geo` and to the table.
fn trace_backward<R: Real>(
    field: &Field<R>,
    trace: &RayTrace<R>,
    samples: &RaySamples<R>,
    d_sites: &[SiteGradient<R>],
    mut d_weight: Vec<R>,
    gradient: &mut Parameters<R>,
) {
    let (n, parameters) = (samples.t.len(), &field.parameters);
    let mut d_h = vec![vec![R::ZERO; parameters.config.grid.outputs()]; n];
    let mut d_e = vec![vec![R::ZERO; EMBEDDING]; n];
    for (site, d_site) in trace.sites.iter().zip(d_sites) {
        let samples = site.first..site.first + site.shares.len();
        let by_share = |i: usize| dot(&d_site.h, &trace.encoded[i].h) + dot(&d_site.e, trace.geometry[i].e());
        // Shares are weights over their sum.
        let d_shares: Vec<R> = samples.clone().map(by_share).collect();
        let mean = dot(&site.shares, &d_shares);
        for ((i, &share), &d_share) in samples.zip(&site.shares).zip(&d_shares) {
            add_scaled(&mut d_h[i], share, &d_site.h);
            add_scaled(&mut d_e[i], share, &d_site.e);
            if site.shares.len() > 1 {
                d_weight[i] += (d_share - mean) / site.total;
            }
            if !site.alone {
                d_weight[i] += d_site.weight;
            }
        }
    }
    let d_sigma = compositing::weights_backward(&trace.weights, &samples.delta, &d_weight);
    let limit = R::from_f64(MAX_GRADIENT_LOGIT);
    for i in 0..n {
        let geometry = &trace.geometry[i];
        let logit = geometry.trace.output[0].max(-limit).min(limit);
        let mut d_output = vec![d_sigma[i] * R::from_f32(parameters.config.density_scale) * logit.exp()];
        d_output.extend_from_slice(&d_e[i]);
        let d = parameters.geo.backward(&geometry.trace, &d_output, &mut gradient.geo);
        add_scaled(&mut d_h[i], R::ONE, &d.input);
        field.grid.backward(trace.encoded[i].x, &d_h[i], &mut gradient.table);
    }
}

/// `sum += factor values`.
fn add_scaled<R: Real>(sum: &mut [R], factor: R, values: &[R]) {
    for (sum, &v) in sum.iter_mut().zip(values) {
        *sum += factor * v;
    }
}

/// `sum_i a_i b_i`.
fn dot<R: Real>(a: &[R], b: &[R]) -> R {
    a.iter().zip(b).map(|(&a, &b)| a * b).sum()
}
