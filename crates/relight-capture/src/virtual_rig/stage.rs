//! The stage that objects stand on: a woven floor and two woven walls, in a dim room.
//!
//! The paper found such a stage necessary: it gives shadows a place to fall on, and texture for every view.

use std::sync::Arc;

use glam::{DVec2, DVec3, dvec3};

use super::error::{RigError, within};
use super::material::Material;
use super::mesh::Mesh;
use super::shapes::{cuboid, quad};
use super::texture::Texture;
use super::weave::Weave;
use super::{Model, Part};
use crate::trajectory::ObjectBox;

/// Half the length of the box in which objects stand, metres: -0.11 to 0.11 along x and y.
pub const OBJECT_HALF: f64 = 0.11;
/// Height of that box.
pub const OBJECT_HEIGHT: f64 = 0.2;

/// How far floor and walls reach to the open sides, metres from the origin.
const FLOOR_REACH: f64 = 0.95;
const WALL_REACH: f64 = 0.85;
/// How thick the walls are behind what is seen of them, metres.
const WALL_THICKNESS: f64 = 0.01;

/// Floor at z = 0 and walls at `x = -wall_x` and `y = wall_y`, open towards +x and -y.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Stage {
    /// Distance of the wall across the x axis from the origin, metres.
    pub wall_x: f64,
    /// Distance of the wall across the y axis from the origin, metres.
    pub wall_y: f64,
    /// Height of the walls, metres.
    pub wall_height: f64,
    /// What covers floor and walls.
    pub weave: Weave,
    /// How far the floor's weave is turned, radians.
    pub turn: f64,
    /// Reflectance of the room around, of which only fill light is seen.
    pub room: [f64; 3],
}

impl Default for Stage {
    /// Warm cane over a pale board, the walls well outside a dome of lights of 0.4 m radius: a lamp close to a wall lights a
    /// spot there so brightly that its reflection is mostly noise.
    fn default() -> Self {
        Self {
            wall_x: 0.46,
            wall_y: 0.42,
            wall_height: 0.32,
            weave: Weave {
                strand: [0.72, 0.48, 0.18],
                edge: [0.22, 0.12, 0.035],
                board: [0.78, 0.74, 0.68],
                cell: 0.0118,
                seed: 1,
            },
            turn: 0.17,
            room: [0.30, 0.30, 0.29],
        }
    }
}

impl Stage {
    /// The stage as a model, to stand others on.
    ///
    /// # Errors
    /// If a length is out of range.
    pub fn model(&self) -> Result<Model, RigError> {
        for (name, value) in [
            ("the distance of a wall", self.wall_x),
            ("the distance of a wall", self.wall_y),
            ("the height of the walls", self.wall_height),
        ] {
            within(name, value, [0.05, 5.0], "0.05 to 5 m")?;
        }
        within("the cell of the weave", self.weave.cell, [1e-4, 1.0], "0.0001 to 1 m")?;
        let cane = Material::Lambert { reflectance: Texture::Raster(Arc::new(self.weave.raster()?)) };
        let sheets = self.sheets();
        let mut parts: Vec<Part> =
            sheets.into_iter().map(|mesh| Part { mesh, material: cane.clone() }).collect();
        let around = 1.0 + self.wall_x.max(self.wall_y);
        let room =
            cuboid(dvec3(-around, -around, -0.3), dvec3(around, around, 1.6f64.max(2.0 * self.wall_height)));
        parts.push(Part { mesh: room, material: Material::matt(self.room.map(|c| c as f32)) });
        Ok(Model { parts })
    }

    /// The walls as boxes, which arms must not meet.
    pub fn walls(&self) -> [ObjectBox; 2] {
        let Self { wall_x, wall_y, wall_height, .. } = *self;
        [
            ObjectBox {
                lo: [-wall_x - WALL_THICKNESS, -WALL_REACH, 0.0],
                hi: [-wall_x, wall_y, wall_height],
            },
            ObjectBox { lo: [-wall_x, wall_y, 0.0], hi: [WALL_REACH, wall_y + WALL_THICKNESS, wall_height] },
        ]
    }

    fn sheets(&self) -> [Mesh; 3] {
        let Self { wall_x, wall_y, wall_height, turn, .. } = *self;
        let corner = dvec3(-wall_x, wall_y, 0.0);
        let sheet = |corner: DVec3, across: DVec3, down: DVec3, turn: f64, offset: f64| {
            let mut mesh = quad(corner, across, down);
            let size = DVec2::new(across.length(), down.length());
            for uv in &mut mesh.uvs {
                *uv = DVec2::from_angle(turn).rotate(*uv * size) / self.weave.period() + offset;
            }
            mesh
        };
        [
            sheet(
                dvec3(-wall_x, -FLOOR_REACH, 0.0),
                DVec3::X * (wall_x + FLOOR_REACH),
                DVec3::Y * (wall_y + FLOOR_REACH),
                turn,
                0.0,
            ),
            sheet(corner, DVec3::NEG_Y * (wall_y + WALL_REACH), DVec3::Z * wall_height, 0.0, 0.31),
            sheet(corner, DVec3::X * (wall_x + WALL_REACH), DVec3::Z * wall_height, 0.0, 0.62),
        ]
    }
}
