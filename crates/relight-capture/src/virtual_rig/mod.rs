//! A rig that is not there: a path tracer for one-light-at-a-time captures.
//!
//! A [`VirtualRig`] holds a [`Model`] (meshes and [`Material`]s: one of the built-in [`objects`], or a file, on a [`stage`]),
//! a [`Lamp`] and a [`Sensor`], and photographs it from any [`Camera`] under any lights. Light goes from the lamp to what the
//! camera sees, or by way of one other surface. Camera paths are shared by all lights of a view, so forty pictures cost little
//! more than their shadow rays: ask for all lights of a view together.
//!
//! Pictures depend on the rig and its seed, on the camera (its label included) and on the light (likewise) and on nothing
//! else: not on the number of threads, nor on which lights are photographed together.

use glam::Vec3A;
use rayon::prelude::*;
use relight_scene::{Camera, Image, Light};

mod board;
mod board_capture;
mod board_truth;
mod bsdf;
mod capture_rig;
mod card;
mod error;
mod geometry;
mod gltf_file;
mod lamp;
mod material;
mod mesh;
mod microfacet;
mod model_file;
mod obj_file;
pub mod objects;
mod occlusion;
mod random;
mod raw_frames;
mod sensor;
mod settings;
pub mod shapes;
mod solid;
pub mod stage;
mod texture;
mod transport;
mod virtual_capture;
mod virtual_eye;
mod weave;

pub use board::{PrintedBoard, charuco_board};
pub use board_capture::{BoardCapture, BoardCaptureError, MOST_TOUCHES};
pub use board_truth::TRUTH;
pub use capture_rig::CaptureRig;
pub use error::RigError;
pub use lamp::Lamp;
pub use material::Material;
pub use mesh::Mesh;
pub use model_file::read_model;
pub use sensor::Sensor;
pub use settings::{Filter, Settings};
pub use solid::{Pattern, Solid};
pub use stage::Stage;
pub use texture::{Raster, Texture};
pub use virtual_capture::{VirtualCapture, VirtualCaptureError};
pub use virtual_eye::VirtualEye;
pub use weave::Weave;

use geometry::Geometry;
use lamp::AimTable;
use material::Surface;
use sensor::Shot;
use transport::{Paths, Room};

/// A mesh and what it is made of.
#[derive(Clone, Debug)]
pub struct Part {
    /// Its shape, in the world.
    pub mesh: Mesh,
    /// Its material.
    pub material: Material,
}

/// What stands before the camera.
#[derive(Clone, Debug, Default)]
pub struct Model {
    /// Its parts.
    pub parts: Vec<Part>,
}

impl Model {
    /// Adds a part.
    pub fn push(&mut self, mesh: Mesh, material: Material) {
        self.parts.push(Part { mesh, material });
    }

    /// The model with another beside it.
    pub fn with(mut self, other: Model) -> Self {
        self.parts.extend(other.parts);
        self
    }
}

/// A picture in linear light: radiance, in the units of the lamp's intensity a square metre.
#[derive(Clone, Debug, PartialEq)]
pub struct LinearImage {
    /// Pixels a row.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// Red, green and blue of each pixel, row-major from the top left.
    pub pixels: Vec<[f32; 3]>,
}

/// A scene, a lamp and a sensor, ready to photograph.
pub struct VirtualRig {
    geometry: Geometry,
    surfaces: Vec<Surface>,
    lamp: Lamp,
    intensity: Vec3A,
    sensor: Sensor,
    settings: Settings,
    aims: AimTable,
}

impl VirtualRig {
    /// Sets up a rig.
    ///
    /// # Errors
    /// If the model holds no triangles or damaged meshes, or a number of material, lamp, sensor or settings is out of range.
    pub fn new(model: &Model, lamp: Lamp, sensor: Sensor, settings: Settings) -> Result<Self, RigError> {
        lamp.check()?;
        sensor.check()?;
        settings.check()?;
        let meshes: Vec<&Mesh> = model.parts.iter().map(|part| &part.mesh).collect();
        Ok(Self {
            geometry: Geometry::new(&meshes)?,
            surfaces: model
                .parts
                .iter()
                .map(|part| Surface::new(&part.material))
                .collect::<Result<_, _>>()?,
            lamp,
            intensity: Vec3A::from_array(lamp.intensity.map(|i| i as f32)),
            sensor,
            settings,
            aims: AimTable::new(settings.samples as usize),
        })
    }

    /// The same lamp and camera before something else.
    fn before(&self, model: &Model) -> Result<Self, RigError> {
        Self::new(model, self.lamp, self.sensor, self.settings)
    }

    /// Photographs a view under each of some lights: one 8-bit sRGB picture a light, in their order.
    pub fn photograph(&self, camera: &Camera, lights: &[Light]) -> Vec<Image> {
        let [width, height] = [camera.intrinsics.width, camera.intrinsics.height];
        let bytes = self.develop(camera, lights, |radiance, pixel, shot| {
            sensor::to_bytes(self.sensor.signal(radiance, pixel, shot))
        });
        bytes.into_iter().map(|picture| Image { width, height, data: picture.into_flattened() }).collect()
    }

    /// What the sensor reports before rounding: `exposure` times radiance with noise, full at 1 and not clipped. One picture
    /// a light.
    pub fn signals(&self, camera: &Camera, lights: &[Light]) -> Vec<LinearImage> {
        self.linear(camera, lights, |radiance, pixel, shot| {
            self.sensor.signal(radiance, pixel, shot).map(|s| s as f32)
        })
    }

    /// The radiance that arrives, without sensor or noise. One picture a light.
    pub fn radiance(&self, camera: &Camera, lights: &[Light]) -> Vec<LinearImage> {
        self.linear(camera, lights, |radiance, _, _| radiance)
    }

    fn linear(
        &self,
        camera: &Camera,
        lights: &[Light],
        finish: impl Fn([f32; 3], usize, Shot) -> [f32; 3] + Sync,
    ) -> Vec<LinearImage> {
        let [width, height] = [camera.intrinsics.width, camera.intrinsics.height];
        let pictures = self.develop(camera, lights, finish);
        pictures.into_iter().map(|pixels| LinearImage { width, height, pixels }).collect()
    }

    /// Traces all pixels, rows side by side, and finishes each as soon as it is known.
    fn develop<T: Copy + Default + Send>(
        &self,
        camera: &Camera,
        lights: &[Light],
        finish: impl Fn([f32; 3], usize, Shot) -> T + Sync,
    ) -> Vec<Vec<T>> {
        let [width, height] = [camera.intrinsics.width as usize, camera.intrinsics.height as usize];
        let mut pictures = vec![vec![T::default(); width * height]; lights.len()];
        let mut rows: Vec<Vec<&mut [T]>> = (0..height).map(|_| Vec::with_capacity(lights.len())).collect();
        for picture in &mut pictures {
            for (row, line) in rows.iter_mut().zip(picture.chunks_mut(width.max(1))) {
                row.push(line);
            }
        }
        let paths = Paths::new(self, camera, lights);
        rows.into_par_iter().enumerate().for_each_init(
            || (Room::default(), vec![Vec3A::ZERO; lights.len()]),
            |(room, sums), (y, mut lines)| {
                for x in 0..width {
                    paths.pixel([x as u32, y as u32], sums, room);
                    for ((sum, light), line) in sums.iter().zip(lights).zip(&mut lines) {
                        let shot =
                            Shot { seed: self.settings.seed, camera: camera.label, light: light.label };
                        line[x] = finish(sum.to_array(), y * width + x, shot);
                    }
                }
            },
        );
        pictures
    }
}

#[cfg(test)]
mod tests;
