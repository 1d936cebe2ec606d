//! A tiny scene on disk and an engine whose weights depend on every batch that it has seen.
// Each test uses a part of it.
#![allow(dead_code, clippy::unwrap_used)]

use std::ops::ControlFlow;
use std::path::Path;
use std::sync::{Arc, Mutex};

use relight_capture::virtual_rig::VirtualCapture;
use relight_field::engine::*;
use relight_field::parameters::{GridConfig, Parameters};
use relight_scene::{Frustum, PixelStore, Scene, Splits, scene_bounds};
use relight_train::recipe::Recipe;
use relight_train::run::{FORMAT, RunConfig, splits_fingerprint};
use relight_train::schedule::Budget;

/// A scene, its splits and its training pixels.
pub struct Data {
    pub scene: Scene,
    pub splits: Splits,
    pub pixels: PixelStore,
}

/// Writes a scene of 8 views x 6 lights at 24x18 to `root` and opens it.
pub fn tiny_scene(root: &Path) -> Data {
    let object = "wheel".to_owned();
    let capture = VirtualCapture { object, views: 8, lights: 6, width: 24, height: 18, samples: 4, seed: 0 };
    capture.shoot(root, false, &mut |_| ControlFlow::Continue(())).unwrap();
    let scene = Scene::open(root).unwrap();
    let splits = Splits::of(&scene).unwrap();
    let pixels = PixelStore::load(&scene, &splits.train, &|_, _| ControlFlow::Continue(())).unwrap();
    Data { scene, splits, pixels }
}

/// A run of `steps` steps on a small field, validated every 4 and reported every 3 steps.
pub fn config(data: &Data, steps: Option<u64>) -> RunConfig {
    RunConfig {
        format: FORMAT.into(),
        scene: data.scene.root.clone(),
        scene_name: data.scene.name.clone(),
        model: "v5".into(),
        preset: "fast".into(),
        seed: 7,
        splits: splits_fingerprint(&data.scene, &data.splits),
        budget: Budget { steps, minutes: None },
        bounds: Some(scene_bounds(&data.scene)),
        search: scene_bounds(&data.scene),
        recipe: Recipe {
            rays_per_step: 32,
            lights_per_ray: 3,
            epoch: Some(4),
            patience: 3,
            report_every: 3,
            grid: Some(GridConfig { levels: 2, features: 2, log2_table: 6, base: 2, finest: 4 }),
            ..Recipe::fast()
        },
    }
}

/// An engine whose weights are a running hash of all it was asked; its pictures are of one grey that its weights
/// decide.
pub struct FakeEngine {
    parameters: Parameters,
    steps_taken: u32,
    /// Step at which the loss is not a number.
    pub broken_at: Option<u64>,
    /// What it was told that cameras have in view.
    pub views: Arc<Mutex<Vec<Frustum>>>,
}

impl FakeEngine {
    pub fn new(config: &RunConfig) -> Self {
        let parameters = Parameters::init(config.field().unwrap(), u64::from(config.seed)).unwrap();
        Self { parameters, steps_taken: 0, broken_at: None, views: Arc::default() }
    }
}

impl Engine for FakeEngine {
    fn train_step(&mut self, batch: &RayBatch, settings: &StepSettings) -> Result<StepStats, EngineError> {
        if self.broken_at == Some(settings.step) {
            return Err(EngineError::NonFinite {
                step: settings.step,
                what: "gradient of rgb layer 2".into(),
            });
        }
        self.steps_taken += 1;
        let sum: f32 = batch.colours.iter().flatten().sum::<f32>()
            + batch.light_index.iter().map(|&l| l as f32).sum::<f32>()
            + batch.rays.directions.iter().flatten().sum::<f32>();
        let n = self.parameters.table.len();
        self.parameters.table[settings.step as usize % n] += settings.learning_rate * sum;
        self.parameters.table[0] = (self.parameters.table[0] * 1.7 + sum * self.steps_taken as f32).sin();
        Ok(StepStats {
            loss: f64::from(self.parameters.table[0].abs()),
            rays: batch.rays.origins.len(),
            pixels: batch.colours.len(),
            samples: 0,
            depth_spread: 0.5,
        })
    }

    fn set_views(&mut self, views: &[Frustum]) {
        *self.views.lock().unwrap() = views.to_vec();
    }

    fn render(
        &self,
        rays: &Rays,
        _: &LightPose,
        _: Outputs,
        _: &RenderSettings,
    ) -> Result<Samples, EngineError> {
        let n = rays.origins.len();
        let grey = self.parameters.table[0].abs();
        Ok(Samples {
            colour: vec![[grey; 3]; n],
            depth: vec![1.0; n],
            opacity: vec![1.0; n],
            ..Default::default()
        })
    }

    fn query(&self, _: &Points) -> Result<FieldValues, EngineError> {
        Ok(FieldValues::default())
    }

    fn parameters(&self) -> Result<Parameters, EngineError> {
        Ok(self.parameters.clone())
    }

    fn state(&self) -> Result<EngineState, EngineError> {
        Ok([
            ("steps".to_owned(), StateTensor::U32(vec![self.steps_taken])),
            ("bytes".to_owned(), StateTensor::U8(vec![1, 2, 3])),
            ("moments".to_owned(), StateTensor::F32(vec![0.5; 5])),
        ]
        .into())
    }

    fn restore(&mut self, parameters: &Parameters, state: &EngineState) -> Result<(), EngineError> {
        let Some(StateTensor::U32(steps)) = state.get("steps") else {
            return Err(EngineError::Shape("no steps".into()));
        };
        assert_eq!(state["bytes"], StateTensor::U8(vec![1, 2, 3]));
        assert_eq!(state["moments"], StateTensor::F32(vec![0.5; 5]));
        self.steps_taken = steps[0];
        self.parameters = parameters.clone();
        Ok(())
    }
}
