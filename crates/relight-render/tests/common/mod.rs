//! A field that needs no training: a grey ball before nothing.
#![allow(dead_code)] // Each test file uses a part.

use relight_field::engine::{
    Engine, EngineError, EngineState, FieldValues, LightPose, Outputs, Points, RayBatch, Rays,
    RenderSettings, Samples, StepSettings, StepStats,
};
use relight_field::parameters::Parameters;
use relight_scene::{Intrinsics, Pose};

/// Radius of the ball about the origin, metres.
pub const RADIUS: f32 = 0.2;

/// An engine that knows the ball by its equation.
#[derive(Default)]
pub struct Ball {
    /// Rays at the start of a batch that it forgets to answer.
    pub loses: usize,
}

fn dot(a: [f32; 3], b: [f32; 3]) -> f32 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

impl Engine for Ball {
    fn render(
        &self,
        rays: &Rays,
        light: &LightPose,
        outputs: Outputs,
        _: &RenderSettings,
    ) -> Result<Samples, EngineError> {
        let mut samples = Samples::default();
        for (&o, &d) in rays.origins.iter().zip(&rays.directions).skip(self.loses) {
            let b = dot(o, d);
            let discriminant = b * b - dot(o, o) + RADIUS * RADIUS;
            let hit = discriminant >= 0.0;
            let depth = if hit { -b - discriminant.sqrt() } else { 2.0 };
            let p: [f32; 3] = std::array::from_fn(|i| o[i] + depth * d[i]);
            let l: [f32; 3] = std::array::from_fn(|i| light.position()[i] - p[i]);
            let lit = if hit { (dot(p, l) / (RADIUS * dot(l, l).sqrt())).max(0.0) } else { 0.0 };
            let albedo = if hit { [0.9, 0.6, 0.3] } else { [0.0; 3] };
            samples.colour.push(albedo.map(|c| c * lit));
            samples.depth.push(depth);
            samples.opacity.push(if hit { 1.0 } else { 0.0 });
            if outputs.visibility {
                samples.visibility.push(lit);
            }
            if outputs.reflectance {
                samples.reflectance.push(albedo);
            }
        }
        Ok(samples)
    }

    fn train_step(&mut self, _: &RayBatch, _: &StepSettings) -> Result<StepStats, EngineError> {
        unreachable!("nothing here trains")
    }

    fn query(&self, _: &Points) -> Result<FieldValues, EngineError> {
        unreachable!("nothing here queries")
    }

    fn parameters(&self) -> Result<Parameters, EngineError> {
        unreachable!("a ball has none")
    }

    fn state(&self) -> Result<EngineState, EngineError> {
        unreachable!("a ball has none")
    }

    fn restore(&mut self, _: &Parameters, _: &EngineState) -> Result<(), EngineError> {
        unreachable!("a ball has none")
    }
}

/// A lens with a principal point well off centre.
pub fn lens(width: u32, height: u32) -> Intrinsics {
    let (w, h) = (f64::from(width), f64::from(height));
    Intrinsics { width, height, fx: 1.6 * w, fy: 1.65 * w, cx: 0.6 * w, cy: 0.42 * h, distortion: vec![] }
}

/// A point at a distance, azimuth and elevation (radians) from the origin.
pub fn polar(distance: f64, azimuth: f64, elevation: f64) -> [f64; 3] {
    let flat = distance * elevation.cos();
    [flat * azimuth.cos(), flat * azimuth.sin(), distance * elevation.sin()]
}

/// A pose there that looks at the origin.
pub fn looking(distance: f64, azimuth: f64, elevation: f64) -> Pose {
    Pose::look_at(polar(distance, azimuth, elevation), [0.0; 3])
}
