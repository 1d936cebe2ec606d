//! The plain engine, to be read beside the paper: one sample after the other, in `f32` or `f64`, no tricks.
//!
//! It is the oracle that faster engines are tested against, and they use the same names for the same phases:
//! `march` (rays to samples), `encode`, `networks`, `composite`, `backward` and `optimise`.

mod backward;
mod composite;
mod encode;
mod march;
mod networks;
mod optimise;
mod soap;

pub use backward::{Evaluation, loss_and_gradient};
pub use march::{Ray, RaySamples, importance, place, stratified};
pub use soap::Soap;

use crate::architecture::LightInput;
use crate::encoding::hash_grid::HashGrid;
use crate::encoding::spherical_harmonics;
use crate::engine::{
    Engine, EngineError, EngineState, FieldValues, LightPose, Outputs, Points, RayBatch, Rays,
    RenderSettings, Samples, StepSettings, StepStats,
};
use crate::parameters::{ParameterError, Parameters};
use crate::random::Random;
use crate::real::Real;
use crate::sampling::{EngineConfig, Sampling};
use optimise::Moments;

/// Number of the random stream of step 0; that of the first weights lie below.
const STEP_STREAM: u64 = 1 << 32;

/// A field ready for evaluation.
#[derive(Clone, Debug)]
pub struct Field<R> {
    /// The weights.
    pub parameters: Parameters<R>,
    grid: HashGrid,
}

impl<R: Real> Field<R> {
    /// The field of some weights.
    ///
    /// # Errors
    /// [`ParameterError`] if they are not of the shape of their configuration.
    pub fn new(parameters: &Parameters) -> Result<Self, ParameterError> {
        parameters.validate()?;
        Ok(Self { parameters: parameters.map(R::from_f32), grid: HashGrid::new(&parameters.config.grid) })
    }
}

/// The plain engine.
#[derive(Clone, Debug)]
pub struct ReferenceEngine<R> {
    field: Field<R>,
    moments: Moments<R>,
    config: EngineConfig,
    coarse: usize,
    fine: usize,
}

impl<R: Real> ReferenceEngine<R> {
    /// An engine for a field.
    ///
    /// # Errors
    /// [`EngineError::Shape`] if the weights are not of the shape of their configuration, if samples are to be
    /// placed otherwise than [`Sampling::Stratified`], or by [`EngineConfig::validate`].
    pub fn new(parameters: &Parameters, config: EngineConfig) -> Result<Self, EngineError> {
        config.validate()?;
        let Sampling::Stratified { coarse, fine } = config.sampling else {
            return Err(EngineError::Shape("the reference engine samples stratified only".to_owned()));
        };
        if coarse == 0 {
            return Err(EngineError::Shape("a ray needs at least one coarse sample".to_owned()));
        }
        let field = Field::new(parameters).map_err(|e| EngineError::Shape(e.to_string()))?;
        Ok(Self { moments: Moments::new(&field.parameters, config.optimiser), field, config, coarse, fine })
    }
}

/// The field at points: density, radiance and visibility.
///
/// # Errors
/// [`EngineError::Shape`] if positions and directions differ in number, or if the field needs a light and none is
/// given.
pub fn query<R: Real>(field: &Field<R>, points: &Points) -> Result<FieldValues, EngineError> {
    same_number(points.positions.len(), points.directions.len())?;
    let config = &field.parameters.config;
    let lit = config.architecture.light != LightInput::None || config.architecture.visibility;
    let light = match points.light {
        None if lit => {
            let name = config.architecture.name();
            return Err(EngineError::Shape(format!("the colours of {name} need a light")));
        }
        light => light.unwrap_or(LightPose([0.0; 12])),
    };
    let mut values = FieldValues::default();
    let mut visibility = Vec::new();
    for (&position, &direction) in points.positions.iter().zip(&points.directions) {
        let inside = (0..3).all(|a| {
            let (lo, hi) = (f64::from(config.bounds.lo[a]), f64::from(config.bounds.hi[a]));
            (lo..=hi).contains(&position[a])
        });
        let position = position.map(R::from_f64);
        let view = spherical_harmonics::encode(direction.map(R::from_f64));
        let encoded = encode::position(field, position);
        let geometry = networks::geometry(field, &encoded.h);
        let decoded = networks::decode(field, &encoded.h, geometry.e(), &view, &light, position);
        values.density.push(if inside { geometry.sigma.to_f32() } else { 0.0 });
        values.rgb.push(decoded.reflectance.map(|c| (decoded.visibility * c).to_f32()));
        visibility.push(decoded.visibility.to_f32());
    }
    values.visibility = config.architecture.visibility.then_some(visibility);
    Ok(values)
}

impl<R: Real> Engine for ReferenceEngine<R> {
    fn train_step(&mut self, batch: &RayBatch, settings: &StepSettings) -> Result<StepStats, EngineError> {
        let random = Random::new(self.config.seed, STEP_STREAM.wrapping_add(settings.step));
        let draws = self.coarse + self.fine;
        let rays = batch.rays.origins.iter().zip(&batch.rays.directions);
        let samples: Vec<RaySamples<R>> = rays
            .enumerate()
            .map(|(r, (&origin, &direction))| {
                let jitter = |i: usize| R::from_f32(random.uniform_at((r * draws + i) as u64));
                place(&self.field, &Ray::new(origin, direction), self.coarse, self.fine, jitter)
            })
            .collect();
        let evaluation = loss_and_gradient(&self.field, self.config.shading, batch, &samples, settings)?;
        let non_finite = |what| EngineError::NonFinite { step: settings.step, what };
        if !evaluation.total.is_finite() {
            return Err(non_finite("the loss".to_owned()));
        }
        for (name, _, values) in evaluation.gradient.tensors() {
            if !values.iter().all(|v| v.is_finite()) {
                return Err(non_finite(format!("the gradient of {name}")));
            }
        }
        self.moments.step(
            &mut self.field.parameters,
            &evaluation.gradient,
            settings.learning_rate,
            self.config.beta2,
        );
        Ok(StepStats {
            loss: evaluation.colour.to_f64(),
            rays: samples.len(),
            pixels: batch.colours.len(),
            samples: samples.iter().map(|s| s.t.len()).sum(),
            depth_spread: evaluation.depth_spread.to_f64(),
        })
    }

    fn render(
        &self,
        rays: &Rays,
        light: &LightPose,
        outputs: Outputs,
        settings: &RenderSettings,
    ) -> Result<Samples, EngineError> {
        same_number(rays.origins.len(), rays.directions.len())?;
        let (coarse, fine) = match settings.samples {
            Some(n) => (n.div_ceil(2).max(1), n / 2),
            None => (self.coarse, self.fine),
        };
        let visibility = outputs.visibility && self.field.parameters.vis.is_some();
        let mut result = Samples::default();
        for (&origin, &direction) in rays.origins.iter().zip(&rays.directions) {
            let ray = Ray::new(origin, direction);
            let samples = place(&self.field, &ray, coarse, fine, |_| R::from_f64(0.5));
            let trace = composite::trace(&self.field, self.config.shading, &ray, &samples);
            let shaded = composite::shade(&self.field, &trace, light);
            let weight = &trace.weights.weight;
            let depth: R = weight.iter().zip(&samples.t).map(|(&w, &t)| w * t).sum();
            let inside: R = weight[..weight.len() - 1].iter().copied().sum();
            result.colour.push(shaded.colour.map(R::to_f32));
            result.depth.push(depth.to_f32());
            result.opacity.push(inside.to_f32());
            if visibility {
                result.visibility.push(shaded.visibility.to_f32());
            }
            if outputs.reflectance {
                result.reflectance.push(shaded.reflectance.map(R::to_f32));
            }
        }
        Ok(result)
    }

    fn query(&self, points: &Points) -> Result<FieldValues, EngineError> {
        query(&self.field, points)
    }

    fn parameters(&self) -> Result<Parameters, EngineError> {
        Ok(self.field.parameters.map(R::to_f32))
    }

    fn state(&self) -> Result<EngineState, EngineError> {
        Ok(self.moments.state())
    }

    fn restore(&mut self, parameters: &Parameters, state: &EngineState) -> Result<(), EngineError> {
        if parameters.config != self.field.parameters.config {
            return Err(EngineError::Shape("the checkpoint is of another field".to_owned()));
        }
        let field = Field::new(parameters).map_err(|e| EngineError::Shape(e.to_string()))?;
        self.moments = Moments::restore(&field.parameters, self.config.optimiser, state)?;
        self.field = field;
        Ok(())
    }
}

/// Refuses origins (or positions) and directions that differ in number.
fn same_number(origins: usize, directions: usize) -> Result<(), EngineError> {
    if origins == directions {
        return Ok(());
    }
    Err(EngineError::Shape(format!("{origins} positions but {directions} directions")))
}
