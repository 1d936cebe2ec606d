//! Closed forms, brute force, and an independent path tracer.

mod board;
mod brute_force;
mod closed_forms;
mod determinism;
mod files;
mod hostile;
mod independent;
mod objects;
mod scattering;

use glam::{DVec3, dvec3};
use relight_scene::{Camera, Intrinsics, Light, Pose};

use super::{Filter, Lamp, LinearImage, Material, Model, Sensor, Settings, VirtualRig, shapes};

/// A camera without distortion, principal point in the middle.
pub fn camera(position: DVec3, target: DVec3, [width, height]: [u32; 2], focal: f64) -> Camera {
    let intrinsics = Intrinsics {
        width,
        height,
        fx: focal,
        fy: focal,
        cx: (f64::from(width) - 1.0) / 2.0,
        cy: (f64::from(height) - 1.0) / 2.0,
        distortion: Vec::new(),
    };
    Camera { label: 0, intrinsics, pose: Pose::look_at(position.to_array(), target.to_array()) }
}

pub fn light(label: usize, position: DVec3) -> Light {
    Light { label, pose: Pose::look_at(position.to_array(), [0.0; 3]) }
}

pub fn white_lamp(radius: f64) -> Lamp {
    Lamp { radius, intensity: [1.0; 3] }
}

pub fn settings(samples: u32) -> Settings {
    Settings { samples, bounce_share: 1, filter: Filter::Box, seed: 0 }
}

pub fn rig(model: &Model, lamp: Lamp, settings: Settings) -> VirtualRig {
    VirtualRig::new(model, lamp, Sensor::noiseless(1.0), settings).unwrap()
}

/// A square floor of a side's length about the origin.
pub fn floor(side: f64, material: Material) -> Model {
    let mut model = Model::default();
    let corner = dvec3(-side / 2.0, side / 2.0, 0.0);
    model.push(shapes::quad(corner, DVec3::X * side, DVec3::NEG_Y * side), material);
    model
}

impl LinearImage {
    fn at(&self, x: u32, y: u32) -> [f64; 3] {
        self.pixels[(y * self.width + x) as usize].map(f64::from)
    }

    fn mean(&self, channel: usize) -> f64 {
        self.pixels.iter().map(|p| f64::from(p[channel])).sum::<f64>() / self.pixels.len() as f64
    }
}
