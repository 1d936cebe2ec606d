//! What there is so far of what a table needs.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use relight_scene::{Layout, Scene, Split};
use relight_train::evaluation::Scores;
use serde::Serialize;

use crate::job::{JobList, Settings};
use crate::numbers::Figure;
use crate::published;
use crate::record::Record;
use crate::table::Entry;

/// What a scene is, as far as it matters for comparing with the paper.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub struct SceneFacts {
    /// Width and height of all its images; `None` where they differ.
    pub size: Option<[u32; 2]>,
    /// Whether it is laid out as the official release, with as many views and lights.
    pub official: bool,
}

impl SceneFacts {
    /// Looks at a scene.
    pub fn of(scene: &Scene) -> Self {
        let mut sizes =
            scene.cameras.iter().map(|camera| [camera.intrinsics.width, camera.intrinsics.height]);
        let first = sizes.next();
        Self {
            size: first.filter(|first| sizes.all(|size| size == *first)),
            official: scene.layout == Layout::Rene
                && [scene.cameras.len(), scene.lights.len()] == published::CAPTURED,
        }
    }
}

/// A job that failed.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Failure {
    /// Id of the job.
    pub job: String,
    /// Why.
    pub reason: String,
}

/// The scenes, models and seeds of a table, and what there is of them.
#[derive(Clone, Debug)]
pub struct Results {
    pub(crate) settings: Settings,
    pub(crate) folder: PathBuf,
    /// By name, in the order in which they were asked for; `None` where a scene could not be read.
    pub(crate) scenes: Vec<(String, Option<SceneFacts>)>,
    pub(crate) models: Vec<String>,
    pub(crate) seeds: Vec<u32>,
    /// Number of jobs.
    pub(crate) jobs: usize,
    /// In the order of the jobs.
    pub(crate) records: Vec<Record>,
    pub(crate) failures: Vec<Failure>,
}

/// Where scores come from.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) enum Method {
    /// A model trained here.
    Model(String),
    /// The paper's figures of a model.
    Published(String),
    /// The mean of all training images.
    MeanImage,
    /// The nearest training camera under the nearest training light.
    NearestLight,
}

impl Method {
    pub fn name(&self) -> String {
        match self {
            Self::Model(model) => model.to_uppercase(),
            Self::Published(model) => format!("{}, published", model.to_uppercase()),
            Self::MeanImage => "Mean image".to_owned(),
            Self::NearestLight => "Nearest light".to_owned(),
        }
    }
}

/// One set of scores a seed; those without seed under `None`.
type BySeed<'a> = BTreeMap<Option<u32>, (Scores, Option<&'a str>)>;

impl Results {
    /// What there is in `out`, the folder of the tables, of the jobs in `list`. `facts` tells of each scene by name.
    pub fn gather(
        list: &JobList,
        out: &Path,
        facts: &dyn Fn(&str) -> Option<SceneFacts>,
        records: Vec<Record>,
        failures: Vec<Failure>,
    ) -> Self {
        let mut results = Self {
            settings: list.settings.clone(),
            folder: out.to_owned(),
            scenes: Vec::new(),
            models: Vec::new(),
            seeds: Vec::new(),
            jobs: list.jobs.len(),
            records,
            failures,
        };
        for job in &list.jobs {
            if !results.scenes.iter().any(|(name, _)| *name == job.scene_name) {
                results.scenes.push((job.scene_name.clone(), facts(&job.scene_name)));
            }
            if !results.models.contains(&job.model) {
                results.models.push(job.model.clone());
            }
            if !results.seeds.contains(&job.seed) {
                results.seeds.push(job.seed);
            }
        }
        let place = |id: &str| list.jobs.iter().position(|job| job.id == id);
        results.records.retain(|record| place(&record.job.id).is_some());
        results.records.sort_by_key(|record| place(&record.job.id));
        results.failures.sort_by_key(|failure| place(&failure.job));
        results
    }

    /// The methods of the table: each model with its published figures, then what needs no training.
    pub(crate) fn methods(&self) -> Vec<Method> {
        let models = self.models.iter().flat_map(|model| {
            let own = Method::Model(model.clone());
            let published = Method::Published(model.clone());
            let is_there = [Split::Val, Split::Easy, Split::Hard].iter().any(|&split| {
                self.scenes.iter().any(|(scene, _)| self.entry(scene, &published, split).is_some())
            });
            std::iter::once(own).chain(is_there.then_some(published))
        });
        models.chain([Method::MeanImage, Method::NearestLight]).collect()
    }

    fn by_seed(&self, scene: &str, method: &Method, split: Split) -> BySeed<'_> {
        let of_scene = self.records.iter().filter(|record| record.job.scene_name == scene);
        let evaluations = of_scene.filter_map(|record| Some((record, record.evaluation(split)?)));
        let baseline = |pick: fn(&relight_train::evaluation::Baselines) -> Option<Scores>| {
            // The same in every run of a scene.
            let found = evaluations.clone().find_map(|(record, e)| Some((pick(&e.baselines)?, record)));
            found.map(|(scores, record)| (None, (scores, Some(record.job.id.as_str())))).into_iter().collect()
        };
        match method {
            Method::Model(model) => evaluations
                .filter(|(record, _)| record.job.model == *model)
                .map(|(record, e)| (Some(record.job.seed), (e.mean, Some(record.job.id.as_str()))))
                .collect(),
            Method::MeanImage => baseline(|b| b.mean_image),
            Method::NearestLight => baseline(|b| b.nearest_light),
            Method::Published(model) => {
                let found = self.is_official(scene).then(|| published::scores(scene, model, split)).flatten();
                found.map(|scores| (None, (scores, None))).into_iter().collect()
            }
        }
    }

    /// Whether the paper's figures may stand beside a scene's.
    pub(crate) fn is_official(&self, scene: &str) -> bool {
        let facts = self.scenes.iter().find(|(name, _)| name == scene).and_then(|(_, facts)| *facts);
        published::is_name(scene) && facts.is_some_and(|f| f.official && f.size == Some(published::SIZE))
    }

    /// The scores of a method on a split of a scene, over all seeds that are there.
    pub(crate) fn entry(&self, scene: &str, method: &Method, split: Split) -> Option<Entry> {
        let by_seed = self.by_seed(scene, method, split);
        let scores: Vec<Scores> = by_seed.values().map(|(scores, _)| *scores).collect();
        entry(&scores, by_seed.values().filter_map(|(_, run)| *run).collect())
    }

    /// Scenes over which means are taken: those on which every model was scored.
    pub(crate) fn common(&self, split: Split) -> Vec<&str> {
        let is_common = |scene: &str| {
            self.models
                .iter()
                .all(|model| !self.by_seed(scene, &Method::Model(model.clone()), split).is_empty())
        };
        self.scenes.iter().map(|(scene, _)| scene.as_str()).filter(|scene| is_common(scene)).collect()
    }

    /// The mean of a method over the [common](Self::common) scenes, taken for each seed that all of them have.
    pub(crate) fn mean(&self, method: &Method, split: Split) -> Option<Entry> {
        let scenes: Vec<BySeed<'_>> =
            self.common(split).into_iter().map(|scene| self.by_seed(scene, method, split)).collect();
        let first = scenes.first()?;
        let seeds = first.keys().filter(|seed| scenes.iter().all(|scene| scene.contains_key(seed)));
        let mut means = Vec::new();
        let mut runs = Vec::new();
        for seed in seeds {
            let scores: Vec<Scores> = scenes.iter().filter_map(|scene| Some(scene.get(seed)?.0)).collect();
            let n = scores.len() as f64;
            means.push(Scores {
                psnr: scores.iter().map(|s| s.psnr).sum::<f64>() / n,
                ssim: scores.iter().map(|s| s.ssim).sum::<f64>() / n,
            });
            runs.extend(scenes.iter().filter_map(|scene| scene.get(seed)?.1));
        }
        entry(&means, runs)
    }
}

fn entry(scores: &[Scores], runs: Vec<&str>) -> Option<Entry> {
    let values = |pick: fn(&Scores) -> f64| scores.iter().map(pick).collect::<Vec<_>>();
    Some(Entry {
        psnr: Figure::of(&values(|s| s.psnr))?,
        ssim: Figure::of(&values(|s| s.ssim))?,
        best: [false; 2],
        runs: runs.into_iter().map(str::to_owned).collect(),
    })
}
