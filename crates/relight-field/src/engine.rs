//! The seam between those who want pictures and the machines that make them.
//!
//! Callers ask for training steps, pictures and field values. Where samples lie along a ray and how kernels run is
//! the engine's own affair. Every ray ends in an opaque sample where it leaves the field's box or just before, so what
//! lies beyond the box is painted on its faces and weights along a ray always sum to one.

use std::collections::BTreeMap;

use relight_scene::Frustum;

use crate::parameters::Parameters;

/// Rays in the world frame.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Rays {
    /// Origins, metres.
    pub origins: Vec<[f32; 3]>,
    /// Unit directions, from the camera into the scene.
    pub directions: Vec<[f32; 3]>,
}

/// A light, as the field sees it: `[R | t]`, light-to-world, row-major; metres. Its position is column 3.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LightPose(pub [f32; 12]);

impl LightPose {
    /// The light's position, metres.
    pub fn position(&self) -> [f32; 3] {
        [self.0[3], self.0[7], self.0[11]]
    }
}

/// Rays to learn from. A ray carries one or more (light, colour) pairs: pictures of the same pixel under several
/// lights share its samples and geometry.
#[derive(Clone, Debug, Default)]
pub struct RayBatch {
    /// The rays, `n` of them.
    pub rays: Rays,
    /// The scene's lights, which `light_index` points into.
    pub lights: Vec<LightPose>,
    /// Pairs a ray, the same for all.
    pub lights_per_ray: usize,
    /// `[n, lights_per_ray]`: the light of each pair.
    pub light_index: Vec<u32>,
    /// `[n, lights_per_ray]`: the colour of each pair, sRGB in 0..1.
    pub colours: Vec<[f32; 3]>,
    /// `[n]`: distance along each ray at which a surface is expected, metres; NaN where nothing is known. Empty if
    /// nothing is known of any ray.
    pub depths: Vec<f32>,
    /// `[n, probes]`: probes, further lights for each ray, the same number for all; empty if there are none. Engines
    /// that trace no shadows leave them out.
    pub probe_lights: Vec<LightPose>,
    /// `[n, probes]`: the colour of each ray under its probes, sRGB in 0..1; NaN where nobody photographed it. The
    /// engine then imagines it from the ray's other pairs and from the shadows that its own geometry casts.
    pub probe_colours: Vec<[f32; 3]>,
}

impl RayBatch {
    /// Probes of each ray.
    pub fn probes_per_ray(&self) -> usize {
        self.probe_lights.len() / self.rays.origins.len().max(1)
    }
}

/// What changes from step to step.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StepSettings {
    /// Number of the step, from 0; with the engine's seed it decides every random draw.
    pub step: u64,
    /// Adam's learning rate.
    pub learning_rate: f32,
    /// Weight of the penalty on ray weight far from `RayBatch::depths`.
    pub depth_weight: f32,
    /// Distance from the expected depth within which a sample goes (nearly) unpunished, metres.
    pub depth_margin: f32,
    /// Weight of the distortion loss (Barron et al. 2022, equation 15), which gathers a ray's weight in one place.
    pub distortion_weight: f32,
    /// Weight of a ray's probes together beside its pairs together, at most: engines lower it where what is imagined of
    /// probes proves unsure. 0 leaves probes out.
    pub probe_weight: f32,
    /// Samples whose gradients are shorter than this many times the mean of their neighbours are left out at random when
    /// gradients go back to the grid, and those that stay count more in proportion; 0 leaves none out. Engines may go
    /// without.
    pub roulette: f32,
    /// Whether more samples go where the engine knows of nothing: things have to be found. Otherwise engines that place samples by
    /// what they know share them out as in pictures.
    pub search: bool,
}

/// What a step did.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct StepStats {
    /// Mean squared error over pairs and channels.
    pub loss: f64,
    /// Camera rays marched.
    pub rays: usize,
    /// Pairs compared.
    pub pixels: usize,
    /// Field samples evaluated with gradient.
    pub samples: usize,
    /// Mean over rays of the standard deviation of depth under the ray's weights, metres.
    pub depth_spread: f64,
}

/// What one stage of training steps cost. Engines count what they can; what they cannot is zero.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct StageCost {
    /// Time, seconds.
    pub seconds: f64,
    /// Additions and multiplications of single-precision numbers.
    pub operations: f64,
    /// Bytes read and written one after another.
    pub bytes: f64,
    /// Entries of a table read in no order.
    pub lookups: f64,
    /// Entries of a table added to in no order.
    pub updates: f64,
}

impl StageCost {
    /// Adds another cost.
    pub fn add(&mut self, other: &Self) {
        self.seconds += other.seconds;
        self.operations += other.operations;
        self.bytes += other.bytes;
        self.lookups += other.lookups;
        self.updates += other.updates;
    }
}

/// Which results a rendering must hold; the colour is always there.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Outputs {
    /// Visibility `o`, composited.
    pub visibility: bool,
    /// Reflectance: the colour before visibility, composited.
    pub reflectance: bool,
}

/// How a picture is made.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct RenderSettings {
    /// Samples a ray, for each thing that it looks at if the engine lets rays look on; `None` for the engine's own choice.
    pub samples: Option<usize>,
    /// What networks are multiplied in.
    pub precision: Precision,
}

/// What networks are multiplied in when a picture is made. Training is in single precision.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Precision {
    /// Fixed point of 16 bits with sums of 32, in engines whose processor has instructions for it and layers that are large enough;
    /// else single precision. Of an activation 12 bits and a sign are kept, relative to the largest of its sample; of a weight
    /// as many, relative to the largest of its output.
    #[default]
    I16,
    /// Single precision.
    F32,
}

/// Results a ray, in the order of the rays.
#[derive(Clone, Debug, Default)]
pub struct Samples {
    /// Colour under the light, sRGB in 0..1.
    pub colour: Vec<[f32; 3]>,
    /// Visibility in 0..1; empty if not asked for or if the architecture has none.
    pub visibility: Vec<f32>,
    /// Colour before visibility, sRGB in 0..1; empty if not asked for.
    pub reflectance: Vec<[f32; 3]>,
    /// Expected distance along the ray, metres.
    pub depth: Vec<f32>,
    /// Share of the ray's weight inside the box, 0..1.
    pub opacity: Vec<f32>,
}

/// Points at which the field itself is asked for, world frame. In double precision: on the finest level of the grid,
/// rounding a position to single precision shifts it by a ten-thousandth of a cell, and the density with it.
#[derive(Clone, Debug, Default)]
pub struct Points {
    /// Positions, metres.
    pub positions: Vec<[f64; 3]>,
    /// Unit view directions, from the camera into the scene.
    pub directions: Vec<[f64; 3]>,
    /// The light.
    pub light: Option<LightPose>,
}

/// The field at some points.
#[derive(Clone, Debug, Default)]
pub struct FieldValues {
    /// Density, per metre; zero outside the box.
    pub density: Vec<f32>,
    /// Radiance with visibility included, sRGB in 0..1.
    pub rgb: Vec<[f32; 3]>,
    /// Visibility, where the architecture has it.
    pub visibility: Option<Vec<f32>>,
}

/// Named arrays that let an engine continue the very same run: optimiser moments, occupancy, random state.
pub type EngineState = BTreeMap<String, StateTensor>;

/// One array of an [`EngineState`].
#[derive(Clone, Debug, PartialEq)]
pub enum StateTensor {
    /// 32-bit floats.
    F32(Vec<f32>),
    /// 32-bit unsigned integers.
    U32(Vec<u32>),
    /// Bytes.
    U8(Vec<u8>),
}

/// A machine that trains and draws a field.
pub trait Engine: Send {
    /// Takes one optimisation step.
    ///
    /// # Errors
    /// [`EngineError::NonFinite`] if the loss or a gradient is not finite; the parameters are then those of before
    /// the step. [`EngineError::Shape`] if the batch contradicts itself.
    fn train_step(&mut self, batch: &RayBatch, settings: &StepSettings) -> Result<StepStats, EngineError>;

    /// Tells the engine where surfaces are expected before it knows any itself: world positions, metres. A hint
    /// for placing samples; engines that need none ignore it.
    fn expect_surfaces(&mut self, points: &[[f32; 3]]) {
        let _ = points;
    }

    /// Tells the engine all that the cameras of its training have in view. Of all else nothing can be learnt; engines that would make
    /// something up may leave it empty for ever, or until they take back a guide or a checkpoint that knows nothing of it.
    fn set_views(&mut self, views: &[Frustum]) {
        let _ = views;
    }

    /// What each stage of the training steps so far cost, by name and in the order of a step; empty for engines that do
    /// not know.
    fn stages(&self) -> Vec<(&'static str, StageCost)> {
        Vec::new()
    }

    /// Looks over the whole field, but for what [`Engine::set_views`] left empty, for where to place samples, so that what no ray
    /// looked at of late is known too. To be called before pictures are drawn of weights that will not change; about a second on two
    /// cores. Engines that need none ignore it.
    fn survey(&mut self) {}

    /// What the engine has learnt of where to place samples, to be kept beside the weights: without it, the field has to
    /// be surveyed before pictures are drawn, thin things may be missed, and what the field made up out of view may show. Empty for
    /// engines that need none.
    fn guide(&self) -> Vec<u8> {
        Vec::new()
    }

    /// Takes back what [`Engine::guide`] gave.
    ///
    /// # Errors
    /// [`EngineError::Shape`] if it is not of this engine and field.
    fn set_guide(&mut self, guide: &[u8]) -> Result<(), EngineError> {
        let _ = guide;
        Ok(())
    }

    /// Draws rays under one light.
    ///
    /// # Errors
    /// [`EngineError::Shape`] if origins and directions differ in number.
    fn render(
        &self,
        rays: &Rays,
        light: &LightPose,
        outputs: Outputs,
        settings: &RenderSettings,
    ) -> Result<Samples, EngineError>;

    /// Evaluates the field at points.
    ///
    /// # Errors
    /// [`EngineError::Shape`] if positions and directions differ in number.
    fn query(&self, points: &Points) -> Result<FieldValues, EngineError>;

    /// A copy of the weights.
    ///
    /// # Errors
    /// [`EngineError::Device`] if they cannot be read back from the device.
    fn parameters(&self) -> Result<Parameters, EngineError>;

    /// All else that is needed to continue.
    ///
    /// # Errors
    /// [`EngineError::Device`] if it cannot be read back from the device.
    fn state(&self) -> Result<EngineState, EngineError>;

    /// Replaces weights and state by those of a checkpoint.
    ///
    /// # Errors
    /// [`EngineError::Shape`] if they are not of this field's shape.
    fn restore(&mut self, parameters: &Parameters, state: &EngineState) -> Result<(), EngineError>;
}

/// What can go wrong in an engine.
#[derive(Debug, thiserror::Error)]
pub enum EngineError {
    /// A loss or gradient was not finite.
    #[error("step {step}: {what} is not finite")]
    NonFinite {
        /// The step.
        step: u64,
        /// Where it arose.
        what: String,
    },
    /// Arrays that contradict each other.
    #[error("{0}")]
    Shape(String),
    /// The device failed.
    #[error("{0}")]
    Device(String),
}
