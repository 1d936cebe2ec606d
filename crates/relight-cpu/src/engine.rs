//! The engine: what a step and a picture are made of.

mod lane;
mod step;

use std::sync::OnceLock;

use fearless_simd::Level;
use relight_field::architecture::LightInput;
use relight_field::encoding::fourier;
use relight_field::engine::{
    Engine, EngineError, EngineState, FieldValues, LightPose, Outputs, Points, Precision, RayBatch, Rays,
    RenderSettings, Samples, StageCost, StepSettings, StepStats,
};
use relight_field::parameters::{FieldConfig, Parameters};
use relight_field::random::Random;
use relight_field::sampling::{EngineConfig, Sampling, Shading};
use relight_scene::Frustum;

use crate::adam::Adam;
use crate::dense::has_fixed_point;
use crate::density_grid::DensityGrid;
use crate::draw::DrawMemory;
use crate::experience::Experience;
use crate::hash_grid::HashGrid;
use crate::march::UnitCube;
use crate::moments::Moments;
use crate::networks::Networks;
use crate::pool::Pool;
use crate::samples::Marcher;
use crate::shade::CodedLight;
use crate::stages::Costs;
use crate::state;
use crate::tile::Workspace;

use lane::Lane;
use step::LANES;

/// Cells an axis of the density grid.
const DENSITY_RESOLUTION: usize = 256;
/// Guided samples a ray when a picture is drawn and nobody says how many, at least: beyond them, little is gained.
const DRAWING_SAMPLES: usize = 16;
/// The same where rays look on (see [`SampleBatch::look_on`](crate::samples::SampleBatch::look_on)): all are for one thing then.
const LOOK_SAMPLES: usize = 12;

/// The fast CPU engine.
pub struct CpuEngine {
    config: EngineConfig,
    field: FieldConfig,
    simd: Level,
    cube: UnitCube,
    pub(crate) grid: HashGrid,
    networks: Networks,
    /// They in fixed point, made anew for the first picture after they have learnt.
    drawn: OnceLock<Networks>,
    moments: [Moments; 3],
    adam: Adam,
    density: DensityGrid,
    experience: Experience,
    lanes: Vec<Lane>,
    /// How many of them, from the first on, had tiles in the last step.
    lanes_used: usize,
    workspaces: Pool<Workspace>,
    drawing: Pool<DrawMemory>,
    costs: Costs,
}

impl CpuEngine {
    /// An engine for a field.
    ///
    /// # Errors
    /// [`EngineError::Shape`] if the parameters contradict their configuration, or ask for more than two samples
    /// cannot hold, or by [`EngineConfig::validate`].
    pub fn new(parameters: &Parameters, config: EngineConfig) -> Result<Self, EngineError> {
        config.validate()?;
        parameters.validate().map_err(|e| EngineError::Shape(e.to_string()))?;
        let samples = match config.sampling {
            Sampling::Guided { samples } => samples,
            Sampling::Stratified { coarse, .. } => coarse,
        };
        if samples < 2 {
            return Err(EngineError::Shape("a ray needs at least two samples".into()));
        }
        let field = parameters.config.clone();
        let networks = Networks::new(parameters);
        let gradients = networks.gradients();
        Ok(Self {
            config,
            simd: Level::new(),
            cube: UnitCube::new(&field.bounds),
            grid: HashGrid::new(&field.grid, &parameters.table),
            moments: networks.moments(config.optimiser),
            networks,
            drawn: OnceLock::new(),
            adam: Adam::new(config.beta2),
            density: DensityGrid::uniform(&field.bounds, DENSITY_RESOLUTION, field.density_scale),
            experience: Experience::default(),
            lanes: (0..LANES).map(|_| Lane::new(&gradients)).collect(),
            lanes_used: 0,
            workspaces: Pool::default(),
            drawing: Pool::default(),
            costs: Costs::default(),
            field,
        })
    }

    fn marcher(&self) -> Marcher<'_> {
        Marcher {
            cube: self.cube,
            density: &self.density,
            grid: &self.grid,
            networks: &self.networks,
            simd: self.simd,
            workspaces: &self.workspaces,
            search: false,
        }
    }

    /// Whether the density grid says where samples lie.
    fn is_guided(&self) -> bool {
        matches!(self.config.sampling, Sampling::Guided { .. })
    }

    fn code_light(&self, pose: &LightPose) -> CodedLight {
        let code = match self.field.architecture.light {
            LightInput::Pose => fourier::encode(&pose.0).to_vec(),
            LightInput::None | LightInput::Direction => Vec::new(),
        };
        CodedLight { position: pose.position(), code }
    }

    fn sampling_for(&self, settings: &RenderSettings) -> Sampling {
        match (self.config.sampling, settings.samples) {
            (Sampling::Guided { samples }, None) => Sampling::Guided {
                samples: match self.config.shading {
                    Shading::Deferred => (samples * LOOK_SAMPLES / DRAWING_SAMPLES).max(LOOK_SAMPLES),
                    Shading::PerSample => samples.max(DRAWING_SAMPLES),
                },
            },
            (sampling, None) => sampling,
            (Sampling::Guided { .. }, Some(samples)) => Sampling::Guided { samples: samples.max(2) },
            (Sampling::Stratified { .. }, Some(samples)) => {
                let coarse = (samples / 2).max(2);
                Sampling::Stratified { coarse, fine: samples.saturating_sub(coarse) }
            }
        }
    }
}

impl Engine for CpuEngine {
    fn train_step(&mut self, batch: &RayBatch, settings: &StepSettings) -> Result<StepStats, EngineError> {
        self.drawn.take();
        // From outside the pool, every part of the step that is shared out would have to be waited for asleep.
        rayon::scope(|_| self.step(batch, settings))
    }

    fn expect_surfaces(&mut self, points: &[[f32; 3]]) {
        // Opaque enough to draw samples, and no more: the field has to confirm it.
        let density = 1.0 / self.density.cell_size();
        let background = 0.02 / self.cube.edge;
        self.density.fill(background);
        for &point in points {
            let unit = self.cube.map(point);
            if unit.iter().all(|u| (0.0..1.0).contains(u)) {
                let cell = self.density.cell(unit);
                self.density.observe(cell, density);
            }
        }
    }

    fn set_views(&mut self, views: &[Frustum]) {
        self.density.hide_unseen(&self.cube, views);
    }

    fn stages(&self) -> Vec<(&'static str, StageCost)> {
        self.costs.named()
    }

    fn guide(&self) -> Vec<u8> {
        self.density.cells()
    }

    fn survey(&mut self) {
        if self.is_guided() {
            self.marcher().survey(1, Random::new(self.config.seed, 0));
        }
    }

    fn set_guide(&mut self, guide: &[u8]) -> Result<(), EngineError> {
        if self.density.set_cells(guide) {
            Ok(())
        } else {
            Err(EngineError::Shape(format!("the density grid has {} cells", guide.len())))
        }
    }

    fn render(
        &self,
        rays: &Rays,
        light: &LightPose,
        outputs: Outputs,
        settings: &RenderSettings,
    ) -> Result<Samples, EngineError> {
        let networks = match settings.precision {
            Precision::I16 if has_fixed_point(self.simd) => {
                self.drawn.get_or_init(|| self.networks.in_fixed_point())
            }
            _ => &self.networks,
        };
        crate::draw::draw(
            &Marcher { networks, ..self.marcher() },
            &self.drawing,
            self.sampling_for(settings),
            self.config.shading,
            rays,
            &self.code_light(light),
            outputs,
        )
    }

    fn query(&self, points: &Points) -> Result<FieldValues, EngineError> {
        let light = points.light.as_ref().map(|l| self.code_light(l));
        crate::draw::query(&self.marcher(), points, light.as_ref())
    }

    fn parameters(&self) -> Result<Parameters, EngineError> {
        Ok(Parameters {
            config: self.field.clone(),
            table: self.grid.table(),
            geo: self.networks.geo.network(),
            rgb: self.networks.rgb.network(),
            vis: self.networks.vis.as_ref().map(crate::mlp::Mlp::network),
        })
    }

    fn state(&self) -> Result<EngineState, EngineError> {
        Ok(state::save(&self.grid, &self.moments, &self.density, self.experience))
    }

    fn restore(&mut self, parameters: &Parameters, state: &EngineState) -> Result<(), EngineError> {
        if parameters.config != self.field {
            return Err(EngineError::Shape("the checkpoint holds another field than this run's".into()));
        }
        let mut fresh = Self::new(parameters, self.config)?;
        let (grid, moments, density) = (&mut fresh.grid, &mut fresh.moments, &mut fresh.density);
        state::load(state, grid, moments, density, &mut fresh.experience)?;
        *self = fresh;
        Ok(())
    }
}
