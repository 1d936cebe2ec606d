//! Encode: from points, view directions and lights to what the networks take.

use super::Field;
use crate::architecture::LightInput;
use crate::encoding::{fourier, hash_grid, spherical_harmonics};
use crate::engine::LightPose;
use crate::real::Real;

/// A point's position code.
#[derive(Clone, Debug)]
pub(super) struct Encoded<R> {
    /// The point in the unit cube.
    pub x: [R; 3],
    /// `h(x)`.
    pub h: Vec<R>,
}

/// `h(x)` of a world point.
pub(super) fn position<R: Real>(field: &Field<R>, position: [R; 3]) -> Encoded<R> {
    let x = hash_grid::unit(&field.parameters.config.bounds, position);
    Encoded { x, h: field.grid.encode(&field.parameters.table, x) }
}

/// `zeta(l)`, `l = (t - x) / |t - x|`, of a light as seen from a world point.
pub(super) fn light_direction<R: Real>(light: &LightPose, position: [R; 3]) -> Vec<R> {
    let t = light.position().map(R::from_f32);
    let to_light: [R; 3] = std::array::from_fn(|a| t[a] - position[a]);
    let square: R = to_light.iter().map(|&v| v * v).sum();
    // A point on the light itself sees it in no direction.
    let norm = square.sqrt().max(R::from_f64(1e-12));
    spherical_harmonics::encode(to_light.map(|v| v / norm)).to_vec()
}

/// What the colour network is told about the light at a world point.
pub(super) fn light<R: Real>(field: &Field<R>, light: &LightPose, position: [R; 3]) -> Vec<R> {
    match field.parameters.config.architecture.light {
        LightInput::None => Vec::new(),
        LightInput::Pose => fourier::encode(&light.0.map(R::from_f32)).to_vec(),
        LightInput::Direction => light_direction(light, position),
    }
}
