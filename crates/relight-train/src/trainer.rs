//! The training loop.

use std::fs;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use relight_field::engine::{Engine, EngineError, RayBatch, StepStats};
use relight_field::parameters::Parameters;
use relight_field::weights_file;
use relight_scene::{Bounds, Frustum, PixelStore, Scene, Splits};
use relight_stereo::DepthPrior;

use crate::TrainError;
use crate::batch::{BatchSampler, LightChoice};
use crate::checkpoint::{Best, Checkpoint, Standing};
use crate::guide_file::{self, Guide};
use crate::metrics_log::{MetricsLog, Report};
use crate::run::{RunConfig, RunFolder};
use crate::schedule::Budget;
use crate::validation::Validation;

/// Longest time from one checkpoint to the next.
const CHECKPOINT_EVERY: Duration = Duration::from_secs(60);

/// What happens while a field is trained.
#[derive(Clone, Copy, Debug)]
pub enum Event<'a> {
    /// A step was taken.
    Step {
        /// Where the training stands now.
        standing: &'a Standing,
        /// Share of the training that is done, 0..1.
        progress: f64,
        /// Mean squared error of this step.
        loss: f64,
    },
    /// A line of metrics was written; at a validation it holds the scores.
    Report(&'a Report),
    /// A checkpoint was written.
    Checkpoint {
        /// Steps taken.
        step: u64,
    },
}

/// Someone who wants to know.
pub trait Observer {
    /// Called on the training thread, between steps.
    fn on_event(&mut self, event: Event<'_>);
}

impl<F: FnMut(Event<'_>)> Observer for F {
    fn on_event(&mut self, event: Event<'_>) {
        self(event);
    }
}

/// Why a training ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Ending {
    /// The budget is used up.
    Budget,
    /// Validation stopped improving.
    Plateau,
    /// It was cancelled.
    Cancelled,
}

/// What a training came to.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Outcome {
    /// Why it ended.
    pub ending: Ending,
    /// Where it stands.
    pub standing: Standing,
}

/// What is trained on.
#[derive(Clone, Copy)]
pub struct TrainingData<'a> {
    /// The scene.
    pub scene: &'a Scene,
    /// Its splits.
    pub splits: &'a Splits,
    /// The pixels of the training split.
    pub pixels: &'a PixelStore,
    /// Where surfaces are expected.
    pub depths: Option<&'a DepthPrior>,
    /// Seconds that finding them took: they count as training.
    pub seconds: f64,
}

/// What the cameras of training pixels have in view.
pub fn views(scene: &Scene, pixels: &PixelStore) -> Vec<Frustum> {
    (0..pixels.views()).map(|view| Frustum::of(&scene.cameras[pixels.camera(view)])).collect()
}

/// A training under way.
pub struct Trainer<'a> {
    run: &'a RunFolder,
    config: &'a RunConfig,
    /// The field's box.
    bounds: Bounds,
    engine: Box<dyn Engine>,
    batches: BatchSampler<'a>,
    validation: Validation<'a>,
    metrics: MetricsLog,
    standing: Standing,
    /// The run's, or the recipe's horizon where nothing could tell when to stop.
    budget: Budget,
    /// Steps from one validation to the next.
    epoch: u64,
    /// Training time and pairs since the last line of metrics, for the rate.
    recent: (Duration, u64),
}

impl<'a> Trainer<'a> {
    /// Takes up the run where its checkpoint left it, or starts it with the weights that `engine` holds.
    ///
    /// # Errors
    /// [`TrainError::Run`] if the checkpoint is not of this run; [`TrainError::Scene`] or [`TrainError::Data`] if the
    /// scene does not hold what training needs; [`TrainError::Io`] if the folder cannot be read or written.
    pub fn new(
        run: &'a RunFolder,
        config: &'a RunConfig,
        data: TrainingData<'a>,
        mut engine: Box<dyn Engine>,
    ) -> Result<Self, TrainError> {
        let recipe = &config.recipe;
        recipe.validate()?;
        let bounds = config.field()?.bounds;
        let batches = BatchSampler::new(
            data.scene,
            data.pixels,
            data.depths,
            recipe.rays_per_step,
            LightChoice::of(recipe),
            u64::from(config.seed),
        )?;
        let validation = Validation::load(data.scene, &data.splits.val, recipe.validation_pixels)?;
        let standing = match Checkpoint::load(&run.checkpoint(), engine.parameters()?)? {
            Some(checkpoint) => {
                engine.restore(&checkpoint.parameters, &checkpoint.engine)?;
                if run.weights().is_file() {
                    checkpoint.standing
                } else {
                    // The best weights are lost. The present ones stand in until a validation has found better.
                    keep(run, engine.as_ref(), &checkpoint.parameters)?;
                    Standing { best: None, ..checkpoint.standing }
                }
            }
            None => {
                if let Some(prior) = data.depths {
                    engine.expect_surfaces(&prior.points);
                }
                Standing { seconds: data.seconds, ..Standing::default() }
            }
        };
        // After a checkpoint too: one of before hides nothing.
        engine.set_views(&views(data.scene, data.pixels));
        fs::create_dir_all(run.previews()).map_err(TrainError::io(&run.previews()))?;
        Ok(Self {
            metrics: MetricsLog::open(&run.metrics(), standing.metrics_bytes)?,
            budget: if config.budget.is_open() && validation.is_empty() {
                Budget { steps: Some(recipe.horizon), minutes: None }
            } else {
                config.budget
            },
            epoch: recipe.epoch.unwrap_or(data.splits.train.len() as u64).max(1),
            recent: (Duration::ZERO, 0),
            run,
            config,
            bounds,
            engine,
            batches,
            validation,
            standing,
        })
    }

    /// Where the training stands.
    pub fn standing(&self) -> &Standing {
        &self.standing
    }

    /// Trains until the budget is used up, until validation stops improving where there is no budget, or until
    /// `cancel` is set. In each case a checkpoint is left, and the best weights so far.
    ///
    /// # Errors
    /// [`TrainError::NonFinite`] if a loss or gradient is not finite: the checkpoint and weights written before are
    /// kept. [`TrainError::Engine`], [`TrainError::Render`] and [`TrainError::Io`] as they arise.
    pub fn train(&mut self, observer: &mut dyn Observer, cancel: &AtomicBool) -> Result<Outcome, TrainError> {
        let started = Instant::now();
        let seconds_before = self.standing.seconds;
        let mut saved = None::<Instant>;
        let mut batch = RayBatch::default();
        let recipe = &self.config.recipe;
        let budget = self.budget;
        let ending = loop {
            self.standing.seconds = seconds_before + started.elapsed().as_secs_f64();
            let progress = budget.progress(self.standing.step, self.standing.seconds, recipe.horizon);
            // A budget that stereo has used up still gets one step: weights that nothing trained are no result.
            if !budget.is_open() && progress >= 1.0 && self.standing.step > 0 {
                break Ending::Budget;
            }
            // While the learning rate still falls, the gain is yet to come.
            let settled = recipe.learning_rate.is_settled(progress);
            if budget.is_open() && settled && self.standing.stale >= recipe.patience {
                break Ending::Plateau;
            }
            if cancel.load(Ordering::Relaxed) {
                break Ending::Cancelled;
            }

            let stats = self.step(progress, &mut batch)?;
            self.standing.seconds = seconds_before + started.elapsed().as_secs_f64();
            let done = budget.progress(self.standing.step, self.standing.seconds, recipe.horizon);
            observer.on_event(Event::Step { standing: &self.standing, progress: done, loss: stats.loss });
            let last = !budget.is_open() && done >= 1.0;
            let validated =
                if last || self.standing.step.is_multiple_of(self.epoch) { self.validate()? } else { None };
            if validated.is_some() || last || self.standing.step.is_multiple_of(recipe.report_every) {
                self.standing.seconds = seconds_before + started.elapsed().as_secs_f64();
                let report = self.report(recipe.learning_rate.at(progress), validated)?;
                observer.on_event(Event::Report(&report));
            }
            let due = match saved {
                Some(at) => at.elapsed() >= CHECKPOINT_EVERY,
                None => validated.is_some() || started.elapsed() >= CHECKPOINT_EVERY,
            };
            if due && !last {
                self.save(observer)?;
                saved = Some(Instant::now());
            }
        };
        self.save(observer)?;
        Ok(Outcome { ending, standing: self.standing })
    }

    /// Takes one step.
    fn step(&mut self, progress: f64, batch: &mut RayBatch) -> Result<StepStats, TrainError> {
        let started = Instant::now();
        let recipe = &self.config.recipe;
        let step = self.standing.step;
        self.batches.fill(step, batch);
        let settings = recipe.step_settings(step, progress, &self.bounds);
        let non_finite = |what: String| TrainError::NonFinite {
            step,
            what,
            run: self.run.root().to_owned(),
            kept: self.run.checkpoint().is_file(),
        };
        let stats = self.engine.train_step(batch, &settings).map_err(|e| match e {
            EngineError::NonFinite { what, .. } => non_finite(what),
            other => other.into(),
        })?;
        if !stats.loss.is_finite() {
            return Err(non_finite("the loss".into()));
        }
        let standing = &mut self.standing;
        standing.step += 1;
        standing.rays += stats.rays as u64;
        standing.pixels += stats.pixels as u64;
        standing.unreported += 1;
        standing.loss_sum += stats.loss;
        standing.spread_sum += stats.depth_spread;
        self.recent.0 += started.elapsed();
        self.recent.1 += stats.pixels as u64;
        Ok(stats)
    }

    /// Scores the validation split, keeps the weights if they are the best so far, and leaves a preview.
    fn validate(&mut self) -> Result<Option<(f64, Option<f64>)>, TrainError> {
        let Some(score) = self.validation.score(self.engine.as_ref())? else { return Ok(None) };
        let step = self.standing.step;
        score.preview.write_png(&self.run.preview(step))?;
        let best = self.standing.best.map_or(f64::NEG_INFINITY, |b| b.psnr);
        if score.psnr > best {
            keep(self.run, self.engine.as_ref(), &self.engine.parameters()?)?;
            self.standing.best = Some(Best { step, psnr: score.psnr });
        }
        // Small gains add up: they are counted from the last that was large enough.
        if score.psnr > self.standing.reference.unwrap_or(f64::NEG_INFINITY) + self.config.recipe.improvement
        {
            (self.standing.reference, self.standing.stale) = (Some(score.psnr), 0);
        } else {
            self.standing.stale += 1;
        }
        Ok(Some((score.psnr, score.ssim)))
    }

    /// Writes a line of metrics.
    fn report(
        &mut self,
        learning_rate: f64,
        validated: Option<(f64, Option<f64>)>,
    ) -> Result<Report, TrainError> {
        let standing = &mut self.standing;
        let steps = standing.unreported.max(1) as f64;
        let (time, pixels) = std::mem::take(&mut self.recent);
        let report = Report {
            step: standing.step,
            seconds: standing.seconds,
            rays: standing.rays,
            pixels: standing.pixels,
            pixels_per_second: pixels as f64 / time.as_secs_f64().max(1e-9),
            loss: standing.loss_sum / steps,
            learning_rate,
            depth_spread: standing.spread_sum / steps,
            psnr: validated.map(|(psnr, _)| psnr),
            ssim: validated.and_then(|(_, ssim)| ssim),
        };
        self.metrics.add(&report)?;
        *standing = Standing {
            unreported: 0,
            loss_sum: 0.0,
            spread_sum: 0.0,
            metrics_bytes: self.metrics.bytes(),
            ..*standing
        };
        Ok(report)
    }

    /// Writes a checkpoint, and the present weights where no validation has chosen any yet.
    fn save(&mut self, observer: &mut dyn Observer) -> Result<(), TrainError> {
        let parameters = self.engine.parameters()?;
        if self.standing.best.is_none() {
            keep(self.run, self.engine.as_ref(), &parameters)?;
        }
        let checkpoint = Checkpoint { parameters, engine: self.engine.state()?, standing: self.standing };
        checkpoint.save(&self.run.checkpoint())?;
        observer.on_event(Event::Checkpoint { step: self.standing.step });
        Ok(())
    }
}

/// Keeps weights to draw with. A guide of later weights, after a kill between the two files, still serves.
fn keep(run: &RunFolder, engine: &dyn Engine, parameters: &Parameters) -> Result<(), TrainError> {
    guide_file::save(&Guide { learnt: engine.guide(), surveyed: false }, &run.guide())?;
    Ok(weights_file::save(parameters, &run.weights())?)
}
