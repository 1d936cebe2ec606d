//! From the folder of a scene to a trained run: what `train`, `demo` and `bench` share.

use std::path::Path;
use std::sync::atomic::Ordering;
use std::time::Instant;

use anyhow::{Context, bail, ensure};
use relight_field::parameters::Parameters;
use relight_scene::{Bounds, PixelStore, Scene, Splits, scene_bounds};
use relight_stereo::{DepthPrior, Source, StereoSettings};
use relight_train::fineness::fitting_grid;
use relight_train::recipe::Recipe;
use relight_train::run::{FORMAT, RunConfig, RunFolder, splits_fingerprint};
use relight_train::schedule::Budget;
use relight_train::trainer::{Ending, Event, Outcome, Trainer, TrainingData};

use crate::console::{Progress, cancel_flag, print_json, unless};
use crate::engines::{self, Device};

/// Share of the pixels whose depth stereo must know before its surfaces decide the box.
const TRUSTED: f64 = 0.1;

/// Warnings told of a scene that is trained on; a check tells all.
const WARNINGS: usize = 5;

/// What somebody wants of a training.
pub struct Wish {
    pub model: String,
    pub preset: String,
    pub recipe: Recipe,
    pub seed: u32,
    pub budget: Budget,
    /// The field's box, or `None` to find it.
    pub bounds: Option<Bounds>,
}

impl Wish {
    /// The settings of a new run on a scene, as far as they do not depend on the surfaces that its images show.
    pub fn config(self, scene: &Scene, splits: &Splits) -> RunConfig {
        let Wish { model, preset, recipe, seed, budget, bounds } = self;
        RunConfig {
            format: FORMAT.to_owned(),
            scene: scene.root.canonicalize().unwrap_or_else(|_| scene.root.clone()),
            scene_name: scene.name.clone(),
            model,
            preset,
            seed,
            splits: splits_fingerprint(scene, splits),
            budget,
            bounds,
            search: bounds.unwrap_or_else(|| scene_bounds(scene)),
            recipe,
        }
    }
}

/// A scene that is ready to be trained on.
pub struct Prepared {
    pub scene: Scene,
    pub splits: Splits,
    pub pixels: PixelStore,
    pub depths: Option<DepthPrior>,
    /// Seconds that finding the depths took.
    seconds: f64,
}

impl Prepared {
    /// Loads the training images of a scene.
    pub fn load(scene: Scene, splits: Splits, quiet: bool) -> anyhow::Result<Self> {
        let pixels = load_pixels(&scene, &splits, quiet)?;
        Ok(Self::with(scene, splits, pixels))
    }

    /// With training images that are loaded already.
    pub fn with(scene: Scene, splits: Splits, pixels: PixelStore) -> Self {
        Self { scene, splits, pixels, depths: None, seconds: 0.0 }
    }

    /// What a trainer takes of it.
    pub fn training(&self) -> TrainingData<'_> {
        TrainingData {
            scene: &self.scene,
            splits: &self.splits,
            pixels: &self.pixels,
            depths: self.depths.as_ref(),
            seconds: self.seconds,
        }
    }

    /// All settings of a new run.
    pub fn plan(&mut self, wish: Wish) -> anyhow::Result<RunConfig> {
        let mut config = wish.config(&self.scene, &self.splits);
        self.settle(&mut config)?;
        Ok(config)
    }

    /// Finds the surfaces, and from them what the settings leave open: the box, and the grid that fits it.
    pub fn settle(&mut self, config: &mut RunConfig) -> anyhow::Result<()> {
        self.find_surfaces(&config.recipe, &config.search)?;
        let bounds = config.bounds.or_else(|| self.surface_bounds()).unwrap_or(config.search);
        config.bounds = Some(bounds);
        config.recipe.grid.get_or_insert_with(|| fitting_grid(&self.scene.cameras, &bounds));
        config.field()?;
        Ok(())
    }

    /// Looks for surfaces in the box `search` by stereo, where the recipe wants it. Fails if it is stopped meanwhile.
    pub fn find_surfaces(&mut self, recipe: &Recipe, search: &Bounds) -> anyhow::Result<()> {
        let cancel = cancel_flag()?;
        let started = Instant::now();
        let found = recipe.stereo.then(|| {
            let settings = StereoSettings::default();
            DepthPrior::find(&self.scene, &self.pixels, search, &settings, &|| unless(cancel))
        });
        if unless(cancel).is_break() {
            bail!("stopped before the first step of training");
        }
        if let Some(found) = found {
            self.seconds = started.elapsed().as_secs_f64();
            match &found {
                Some((prior, source)) => tracing::info!(
                    "stereo found depths for {:.0} % of the pixels {} {:.1} s",
                    100.0 * prior.coverage(),
                    match source {
                        Source::Stereo => "in",
                        Source::Cache => "at an earlier start: read from the cache in",
                    },
                    self.seconds
                ),
                None => tracing::warn!(
                    "stereo found no surfaces to start from: it matches views by the lights that they share, and these are too \
                     few, or show nothing in common; training starts in the fog, and may stay there for long"
                ),
            }
            self.depths = found.map(|(prior, _)| prior);
        }
        Ok(())
    }

    /// The box of the surfaces that were found, if enough were.
    fn surface_bounds(&self) -> Option<Bounds> {
        self.depths.as_ref().filter(|prior| prior.coverage() >= TRUSTED).and_then(DepthPrior::bounds)
    }
}

/// Opens the scene of a run: where its configuration has it, or at `elsewhere`.
pub fn open_scene(elsewhere: Option<&Path>, run: &RunFolder, config: &RunConfig) -> anyhow::Result<Scene> {
    match elsewhere {
        Some(path) => Ok(Scene::open(path)?),
        None => Scene::open(&config.scene).with_context(|| {
            format!(
                "{}: the run's scene; where it has moved, name its folder with --scene",
                run.root().display()
            )
        }),
    }
}

/// Opens the scene at `path` to be trained on, tells what may be wrong with it, and finds its splits.
pub fn open(path: &Path) -> anyhow::Result<(Scene, Splits)> {
    let (scene, warnings) = Scene::open_with_warnings(path)?;
    for warning in warnings.iter().take(WARNINGS) {
        tracing::warn!("{warning}");
    }
    let more = warnings.len().saturating_sub(WARNINGS);
    if more > 0 {
        let path = path.display();
        tracing::warn!("{path}: further warnings: {more}; relight scene check {path} tells all");
    }
    ensure!(
        path.canonicalize().map_or(true, |whole| whole.to_str().is_some()),
        "{}: the path is not UTF-8, so that no run could tell which scene it is of: rename the folder",
        path.display()
    );
    let splits = Splits::of(&scene)?;
    if let Some(fault) = splits.left_out(&scene) {
        tracing::warn!("{fault}");
    }
    Ok((scene, splits))
}

/// Loads the training images of a scene, until Ctrl-C.
fn load_pixels(scene: &Scene, splits: &Splits, quiet: bool) -> anyhow::Result<PixelStore> {
    let cancel = cancel_flag()?;
    let bar = Progress::new("loading", splits.train.len() as u64, quiet);
    let pixels = PixelStore::load(scene, &splits.train, &|done, all| {
        bar.count(done, all, "images");
        unless(cancel)
    })?;
    bar.finish(&format!("{}: {} training images", scene.name, splits.train.len()));
    Ok(pixels)
}

/// Checks that the splits of `scene` are those that a run was trained with.
pub fn check_splits(scene: &Scene, splits: &Splits, config: &RunConfig) -> anyhow::Result<()> {
    ensure!(
        splits_fingerprint(scene, splits) == config.splits,
        "{}: not the scene that this run was trained on, or other splits of it, so that training images and the ones \
         held out would mix; name the right scene, restore its splits.json, or train anew",
        scene.root.display()
    );
    Ok(())
}

/// Trains `run` to the end of its budget or until Ctrl-C.
pub fn train(
    run: &RunFolder,
    config: &RunConfig,
    data: &Prepared,
    device: Device,
    json: bool,
    quiet: bool,
) -> anyhow::Result<Outcome> {
    let first = Parameters::init(config.field()?, u64::from(config.seed))?;
    let engine = engines::create(device, &first, config.engine())?;
    let mut trainer = Trainer::new(run, config, data.training(), engine)?;
    let cancel = cancel_flag()?;
    let bar = Progress::new("training", 1000, quiet);
    if trainer.standing().step > 0 {
        bar.note(&format!("continuing at step {}", trainer.standing().step));
    }
    let (mut rate, mut lost_output) = (0.0, None);
    let outcome = trainer.train(
        &mut |event: Event<'_>| match event {
            Event::Step { standing, progress, loss } => bar.update((progress * 1000.0) as u64, 1000, || {
                let psnr = standing.best.map_or(String::new(), |b| format!(", best {:.2} dB", b.psnr));
                format!("step {}, loss {loss:.5}, {:.0} k pixels/s{psnr}", standing.step, rate / 1e3)
            }),
            Event::Report(report) => {
                rate = report.pixels_per_second;
                if let Some(psnr) = report.psnr {
                    bar.note(&format!("step {:>7}  {:>6.0} s  {psnr:.2} dB", report.step, report.seconds));
                }
                if json && let Err(error) = print_json(report) {
                    // Nobody reads any more: stop, keeping what is done.
                    lost_output.get_or_insert(error);
                    cancel.store(true, Ordering::Relaxed);
                }
            }
            Event::Checkpoint { step } => tracing::debug!("checkpoint at step {step}"),
        },
        cancel,
    )?;
    let ending = match outcome.ending {
        Ending::Budget => "done",
        Ending::Plateau => "validation stopped improving",
        Ending::Cancelled => "stopped",
    };
    if outcome.ending != Ending::Cancelled {
        drop(trainer);
        engines::complete_guide(run, config)?;
    }
    let best = outcome.standing.best.map_or(String::new(), |b| format!("; best {:.2} dB", b.psnr));
    bar.finish(&format!(
        "{ending} after {} steps, {:.0} s{best}",
        outcome.standing.step, outcome.standing.seconds
    ));
    match lost_output {
        Some(error) => Err(error),
        None => Ok(outcome),
    }
}
