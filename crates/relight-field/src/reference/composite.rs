//! Composite: from the samples of a ray to one colour a light.

use super::Field;
use super::encode::{self, Encoded};
use super::march::{Ray, RaySamples};
use super::networks::{self, Decoded, Geometry};
use crate::architecture::HARMONICS;
use crate::compositing::{self, Weights};
use crate::encoding::spherical_harmonics;
use crate::engine::LightPose;
use crate::real::Real;
use crate::sampling::Shading;

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
    let every = |i: usize, weight| Site {
        weight,
        h: encoded[i].h.clone(),
        e: geometry[i].e().to_vec(),
        position: positions[i],
    };
    let weight = &weights.weight;
    let sites = match shading {
        Shading::PerSample => weight.iter().enumerate().map(|(i, &w)| every(i, w)).collect(),
        Shading::Deferred => vec![Site {
            weight: R::ONE,
            h: average(weight, encoded.iter().map(|x| &x.h[..])),
            e: average(weight, geometry.iter().map(Geometry::e)),
            position: std::array::from_fn(|a| weight.iter().zip(&positions).map(|(&w, x)| w * x[a]).sum()),
        }],
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
