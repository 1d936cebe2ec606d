//! A grey card on the stage.

use glam::{DVec3, dvec3};

use super::error::RigError;
use super::material::Material;
use super::shapes::quad;
use super::{Model, Part, Stage};

/// Side of the card and its thickness, metres.
const SIDE: f64 = 0.08;
const THICKNESS: f64 = 0.0005;
/// What of the light it throws back.
const GREY: f32 = 0.18;

/// A matt grey card that lies flat on the stage, its middle here, metres.
///
/// # Errors
/// If a length of the stage is out of range.
pub(super) fn grey_card(at: [f64; 3]) -> Result<Model, RigError> {
    let corner = DVec3::from_array(at) + dvec3(-SIDE / 2.0, -SIDE / 2.0, THICKNESS);
    let mesh = quad(corner, DVec3::X * SIDE, DVec3::Y * SIDE);
    let card = Model { parts: vec![Part { mesh, material: Material::matt([GREY; 3]) }] };
    Ok(card.with(Stage::default().model()?))
}
