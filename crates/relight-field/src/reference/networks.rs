//! Networks: from codes to density, embedding, colour and visibility.

use super::{Field, encode};
use crate::architecture::{EmbeddingEntry, HARMONICS};
use crate::engine::LightPose;
use crate::network::Trace;
use crate::real::Real;

/// Largest density logit: beyond it `exp` would overflow in `f32`, and `exp(60)` is opaque at any length.
const MAX_LOGIT: f64 = 60.0;

/// What `geo` says of a point.
#[derive(Clone, Debug)]
pub(super) struct Geometry<R> {
    /// The forward pass; its output is the density logit, then `e`.
    pub trace: Trace<R>,
    /// Density `sigma = density_scale exp(logit)`, per metre.
    pub sigma: R,
}

impl<R: Real> Geometry<R> {
    /// The embedding `e`.
    pub fn e(&self) -> &[R] {
        &self.trace.output[1..]
    }
}

/// `geo: h(x) -> (sigma, e)`.
pub(super) fn geometry<R: Real>(field: &Field<R>, h: &[R]) -> Geometry<R> {
    let trace = field.parameters.geo.forward(h.to_vec(), &[]);
    let logit = trace.output[0].min(R::from_f64(MAX_LOGIT));
    Geometry { sigma: R::from_f32(field.parameters.config.density_scale) * logit.exp(), trace }
}

/// What colour and visibility networks say of a point seen along `d` under a light.
#[derive(Clone, Debug)]
pub(super) struct Decoded<R> {
    /// Forward pass of `rgb`.
    pub rgb: Trace<R>,
    /// Forward pass of `vis`, where the architecture has it.
    pub vis: Option<Trace<R>>,
    /// Colour `c` before visibility.
    pub reflectance: [R; 3],
    /// Visibility `o`; 1 where the architecture has none.
    pub visibility: R,
}

/// `c = rgb(...)` and `o = vis(h(x), zeta(l))`, for the codes `h`, `e` and `zeta(d)` and the light seen from
/// `position`.
pub(super) fn decode<R: Real>(
    field: &Field<R>,
    h: &[R],
    e: &[R],
    view: &[R; HARMONICS],
    light: &LightPose,
    position: [R; 3],
) -> Decoded<R> {
    let architecture = field.parameters.config.architecture;
    let mut input = view.to_vec();
    input.extend(encode::light(field, light, position));
    if architecture.position_skip {
        input.extend_from_slice(h);
    }
    let late = match architecture.embedding {
        EmbeddingEntry::Layer1 => {
            input.extend_from_slice(e);
            &[]
        }
        EmbeddingEntry::Layer2 => e,
    };
    let rgb = field.parameters.rgb.forward(input, late);
    let vis = field.parameters.vis.as_ref().map(|vis| {
        let mut input = h.to_vec();
        input.extend(encode::light_direction(light, position));
        vis.forward(input, &[])
    });
    Decoded {
        reflectance: std::array::from_fn(|channel| rgb.output[channel].sigmoid()),
        visibility: vis.as_ref().map_or(R::ONE, |vis| vis.output[0].sigmoid()),
        rgb,
        vis,
    }
}
