//! Composite: from the samples of a ray to one colour a light.

use std::ops::Range;

use super::Field;
use super::encode::{self, Encoded};
use super::march::{Ray, RaySamples};
use super::networks::{self, Decoded, Geometry};
use crate::architecture::HARMONICS;
use crate::compositing::{self, Weights};
use crate::encoding::spherical_harmonics;
use crate::engine::LightPose;
use crate::real::Real;
use crate::sampling::{NEGLIGIBLE, Shading};

/// All that a ray's lights share.
pub(super) struct RayTrace<R> {
    /// Position code of every sample.
    pub encoded: Vec<Encoded<R>>,
    /// Density and embedding of every sample.
    pub geometry: Vec<Geometry<R>>,
    /// Weights of the samples.
    pub weights: Weights<R>,
    /// `zeta(d)`.
    pub view: [R; HARMONICS],
    /// Where colour is decoded.
    pub sites: Vec<Site<R>>,
}

/// A place where colour is decoded, and its share in the ray's colour.
pub(super) struct Site<R> {
    /// Where the samples begin whose features it averages.
    pub first: usize,
    /// What each of them counts in it: together one.
    pub shares: Vec<R>,
    /// Sum of their weights.
    pub total: R,
    /// Whether it is all that the ray shows.
    pub alone: bool,
    /// What it counts in the ray: that sum, or one where it is alone.
    pub weight: R,
    pub h: Vec<R>,
    pub e: Vec<R>,
    /// World frame, metres.
    pub position: [R; 3],
}

/// Encodes the samples of a ray, and finds their densities, their weights and where colour is to be decoded.
pub(super) fn trace<R: Real>(
    field: &Field<R>,
    shading: Shading,
    ray: &Ray<R>,
    samples: &RaySamples<R>,
) -> RayTrace<R> {
    let positions: Vec<[R; 3]> = samples.t.iter().map(|&t| ray.at(t)).collect();
    let encoded: Vec<_> = positions.iter().map(|&x| encode::position(field, x)).collect();
    let geometry: Vec<_> = encoded.iter().map(|x| networks::geometry(field, &x.h)).collect();
    let sigma: Vec<R> = geometry.iter().map(|g| g.sigma).collect();
    let weights = compositing::weights(&sigma, &samples.delta);
    let weight = &weights.weight;
    let site = |samples: Range<usize>, alone: bool| {
        let total: R = weight[samples.clone()].iter().copied().sum();
        let shares = match samples.len() {
            1 => vec![R::ONE],
            _ => weight[samples.clone()].iter().map(|&w| w / total).collect(),
        };
        Site {
            first: samples.start,
            h: average(&shares, encoded[samples.clone()].iter().map(|x| &x.h[..])),
            e: average(&shares, geometry[samples.clone()].iter().map(Geometry::e)),
            position: std::array::from_fn(|a| {
                shares.iter().zip(&positions[samples.clone()]).map(|(&share, x)| share * x[a]).sum()
            }),
            shares,
            total,
            alone,
            weight: if alone { R::ONE } else { total },
        }
    };
    let last = weight.len() - 1;
    let inside: R = weight[..last].iter().copied().sum();
    let negligible = R::from_f64(NEGLIGIBLE);
    let sites = match shading {
        Shading::PerSample => (0..=last).map(|i| site(i..i + 1, false)).collect(),
        Shading::Deferred if weight[last] <= negligible => vec![site(0..last, true)],
        Shading::Deferred if inside <= negligible => vec![site(last..last + 1, true)],
        Shading::Deferred => vec![site(0..last, false), site(last..last + 1, false)],
    };
    RayTrace { view: spherical_harmonics::encode(ray.direction), encoded, geometry, weights, sites }
}

/// `sum_i w_i v_i`.
fn average<'a, R: Real>(weight: &[R], vectors: impl Iterator<Item = &'a [R]>) -> Vec<R> {
    let mut mean = Vec::new();
    for (&w, v) in weight.iter().zip(vectors) {
        mean.resize(v.len(), R::ZERO);
        for (mean, &v) in mean.iter_mut().zip(v) {
            *mean += w * v;
        }
    }
    mean
}

/// A ray under one light.
pub(super) struct Shaded<R> {
    /// What was decoded at every site.
    pub decoded: Vec<Decoded<R>>,
    /// `sum_i w_i o_i c_i`.
    pub colour: [R; 3],
    /// `sum_i w_i c_i`.
    pub reflectance: [R; 3],
    /// `sum_i w_i o_i`.
    pub visibility: R,
}

/// Decodes the sites of a ray under a light and sums them up.
pub(super) fn shade<R: Real>(field: &Field<R>, trace: &RayTrace<R>, light: &LightPose) -> Shaded<R> {
    let mut shaded = Shaded {
        decoded: Vec::with_capacity(trace.sites.len()),
        colour: [R::ZERO; 3],
        reflectance: [R::ZERO; 3],
        visibility: R::ZERO,
    };
    for site in &trace.sites {
        let decoded = networks::decode(field, &site.h, &site.e, &trace.view, light, site.position);
        for channel in 0..3 {
            let reflected = site.weight * decoded.reflectance[channel];
            shaded.reflectance[channel] += reflected;
            shaded.colour[channel] += decoded.visibility * reflected;
        }
        shaded.visibility += site.weight * decoded.visibility;
        shaded.decoded.push(decoded);
    }
    shaded
}
