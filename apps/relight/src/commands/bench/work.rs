//! One job: a scene, a model and a seed, from wherever it stands to its record.

use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, PoisonError, Weak};

use anyhow::{anyhow, ensure};
use relight_bench::{Job, JobList, Made, Record, score};
use relight_field::parameters::Parameters;
use relight_scene::{PixelStore, Scene, Splits};
use relight_train::baselines::mean_image;
use relight_train::run::{RunConfig, RunFolder, splits_fingerprint};
use relight_train::trainer::{Ending, Event, Trainer};

use crate::console::unless;
use crate::engines::{self, Device};
use crate::preparation::{Prepared, Wish, check_splits, open};

/// How far a job is: its share, 0 to 1, and what it is at.
pub type Tell<'a> = &'a (dyn Fn(f64, &dyn Fn() -> String) + Sync);

/// Share of a job that is training; the rest is scoring.
const TRAINING: f64 = 0.95;

/// A scene that is ready, and how a run on it is configured but for model and seed.
struct Ready {
    data: Prepared,
    config: RunConfig,
}

/// Scenes by job: those that run at the same time share one.
pub struct Scenes {
    slots: Vec<(std::path::PathBuf, Mutex<Weak<Ready>>)>,
}

impl Scenes {
    /// None of them loaded yet.
    pub fn of(list: &JobList) -> Self {
        let mut slots = Vec::<(std::path::PathBuf, Mutex<Weak<Ready>>)>::new();
        for job in &list.jobs {
            if slots.iter().all(|(path, _)| *path != job.scene) {
                slots.push((job.scene.clone(), Mutex::default()));
            }
        }
        Self { slots }
    }

    /// The scene of a job, loaded unless another job holds it.
    fn get(
        &self,
        list: &JobList,
        job: &Job,
        cancel: &AtomicBool,
        tell: Tell<'_>,
    ) -> anyhow::Result<Arc<Ready>> {
        let slot = self.slots.iter().find(|(path, _)| *path == job.scene);
        let (_, slot) = slot.ok_or_else(|| anyhow!("{}: no scene of this list", job.scene.display()))?;
        // Others of the scene wait here until it is there.
        let mut slot = slot.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(ready) = slot.upgrade() {
            return Ok(ready);
        }
        let (scene, splits) = open(&job.scene)?;
        let pixels = PixelStore::load(&scene, &splits.train, &|done, all| {
            tell(0.0, &|| format!("loading {done} of {all} images"));
            unless(cancel)
        })?;
        let mut data = Prepared::with(scene, splits, pixels);
        tell(0.0, &|| "looking for surfaces".to_owned());
        let config = data.plan(Wish {
            model: job.model.clone(),
            preset: list.settings.preset.clone(),
            recipe: list.settings.recipe.clone(),
            seed: job.seed,
            budget: list.settings.budget,
            bounds: None,
        })?;
        let ready = Arc::new(Ready { data, config });
        *slot = Arc::downgrade(&ready);
        Ok(ready)
    }
}

/// The record of a finished job, if it still holds: its settings must be those of the list, its scene the one that it was
/// trained on, where that can be read.
pub fn finished(list: &JobList, job: &Job, out: &Path) -> anyhow::Result<Option<Record>> {
    let folder = job.folder(out);
    let Some(record) = Record::load(&folder)? else { return Ok(None) };
    let mend = format!("remove {} to train it anew, or choose another folder with --out", folder.display());
    list.settings
        .check(job, &record.config)
        .map_err(|problem| anyhow!("{}: {problem}; {mend}", folder.display()))?;
    if let Ok(scene) = Scene::open(&job.scene)
        && let Ok(splits) = Splits::peek(&scene)
    {
        ensure!(
            splits_fingerprint(&scene, &splits) == record.config.splits,
            "{}: the scene has changed since this run was trained; {mend}",
            folder.display()
        );
    }
    Ok(Some(record))
}

/// Does the job at `index` in the list: trains its run, or goes on where it was stopped, scores it and leaves its record.
/// What is done already is not done again. `None` if `cancel` is set before the end; the same call goes on then.
pub fn run_job(
    list: &JobList,
    index: usize,
    out: &Path,
    scenes: &Scenes,
    device: Device,
    cancel: &AtomicBool,
    tell: Tell<'_>,
) -> anyhow::Result<Option<Record>> {
    let job = list
        .jobs
        .get(index)
        .ok_or_else(|| anyhow!("there is no job {index}: the list has {}", list.jobs.len()))?;
    if let Some(record) = finished(list, job, out)? {
        return Ok(Some(record));
    }
    let done = attempt(list, job, out, scenes, device, cancel, tell);
    // Whatever was under way may have ended in an error because it was stopped.
    if cancel.load(Ordering::Relaxed) { Ok(done.ok().flatten()) } else { done }
}

fn attempt(
    list: &JobList,
    job: &Job,
    out: &Path,
    scenes: &Scenes,
    device: Device,
    cancel: &AtomicBool,
    tell: Tell<'_>,
) -> anyhow::Result<Option<Record>> {
    let ready = scenes.get(list, job, cancel, tell)?;
    let data = &ready.data;
    let (run, config) = begin(list, job, out, &ready)?;
    let first = Parameters::init(config.field()?, u64::from(config.seed))?;
    let engine = engines::create(device, &first, config.engine())?;
    let mut trainer = Trainer::new(&run, &config, data.training(), engine)?;
    let mut observer = |event: Event<'_>| {
        if let Event::Step { standing, progress, .. } = event {
            tell(TRAINING * progress, &|| {
                let best = standing.best.map_or(String::new(), |best| format!(", best {:.2} dB", best.psnr));
                format!("step {}{best}", standing.step)
            });
        }
    };
    let outcome = trainer.train(&mut observer, cancel)?;
    if outcome.ending == Ending::Cancelled {
        return Ok(None);
    }
    drop(trainer);

    engines::complete_guide(&run, &config)?;
    let engine = engines::of_run(&run, &config)?;
    let folder = run.root();
    let mean = mean_image(&data.scene, &data.splits.train, &|done, all| {
        tell(TRAINING, &|| format!("mean of {done} of {all} images"));
        unless(cancel)
    })?;
    let scored = score(
        &data.scene,
        &data.splits,
        mean.as_ref(),
        &config,
        engine.as_ref(),
        folder,
        &mut |done, all| {
            let share = done as f64 / all.max(1) as f64;
            tell(TRAINING + (1.0 - TRAINING) * share, &|| format!("scored {done} of {all} images"));
            unless(cancel)
        },
    )?;
    let Some(scored) = scored else { return Ok(None) };
    let made = Made {
        version: env!("CARGO_PKG_VERSION").to_owned(),
        commit: env!("RELIGHT_COMMIT").to_owned(),
        device: engines::told(device),
        steps: outcome.standing.step,
        seconds: outcome.standing.seconds,
    };
    let record = Record::new(job.clone(), config, made, scored);
    record.save(folder)?;
    Ok(Some(record))
}

/// The run of a job: the one that was begun, or a new one.
fn begin(list: &JobList, job: &Job, out: &Path, ready: &Ready) -> anyhow::Result<(RunFolder, RunConfig)> {
    let folder = job.folder(out);
    if !RunFolder::is_begun(&folder) {
        let config = RunConfig { model: job.model.clone(), seed: job.seed, ..ready.config.clone() };
        return Ok((RunFolder::create(&folder, &config)?, config));
    }
    let (run, config) = RunFolder::resume(&folder)?;
    let mend = "remove the folder to train it anew, or choose another with --out";
    list.settings
        .check(job, &config)
        .map_err(|problem| anyhow!("{}: {problem}; {mend}", folder.display()))?;
    check_splits(&ready.data.scene, &ready.data.splits, &config)?;
    Ok((run, config))
}
