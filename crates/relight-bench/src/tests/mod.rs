//! Tables of made-up scores.

mod files;
mod golden;
mod lists;
mod means;
mod published_beside;

use std::path::Path;

use relight_scene::{Bounds, Split};
use relight_train::evaluation::{Baselines, Evaluation, ImageScores, Scores};
use relight_train::recipe::Recipe;
use relight_train::run::{FORMAT, RunConfig};
use relight_train::schedule::Budget;

use crate::record::{Made, Outcome, Record, SplitRecord};
use crate::{Failure, Job, JobList, Results, SceneFacts, Scored, Settings};

fn settings() -> Settings {
    Settings {
        preset: "fast".into(),
        budget: Budget { steps: Some(3000), minutes: None },
        recipe: Recipe::fast(),
    }
}

fn list(scenes: &[&str], models: &[&str], seeds: &[u32]) -> JobList {
    let paths: Vec<_> = scenes.iter().map(|scene| Path::new("/scenes").join(scene)).collect();
    let models: Vec<String> = models.iter().map(|&model| model.to_owned()).collect();
    JobList::new(settings(), &paths, &models, seeds).unwrap()
}

/// Scores that depend on the scene, the model, the seed and the split, all of them different.
fn scores(job: &Job, split: Split) -> Scores {
    let model: f64 = job.model[1..].parse().unwrap();
    let scene = job.scene_name.len() as f64;
    let split = match split {
        Split::Val | Split::Train => 0.0,
        Split::Easy => 0.31,
        Split::Hard => -0.47,
    };
    Scores {
        psnr: 20.0 + model + 0.1 * scene + split + 0.25 * f64::from(job.seed),
        ssim: 0.5 + 0.05 * model + 0.001 * scene + 0.1 * split + 0.0123 * f64::from(job.seed),
    }
}

fn evaluation(job: &Job, split: Split) -> Evaluation {
    let mean = scores(job, split);
    Evaluation {
        scene: job.scene_name.clone(),
        model: job.model.clone(),
        split: split.to_string(),
        mean,
        images: vec![ImageScores { camera: 4, light: 2, scores: mean }],
        baselines: Baselines {
            mean_image: Some(Scores { psnr: 17.55, ssim: 0.41 }),
            nearest_light: Some(Scores { psnr: 15.73, ssim: 0.385 }),
        },
    }
}

fn record(job: &Job) -> Record {
    let config = RunConfig {
        format: FORMAT.into(),
        scene: job.scene.clone(),
        scene_name: job.scene_name.clone(),
        model: job.model.clone(),
        preset: "fast".into(),
        seed: job.seed,
        splits: "0123456789abcdef".into(),
        budget: settings().budget,
        bounds: Some(Bounds { lo: [0.0; 3], hi: [1.0; 3] }),
        search: Bounds { lo: [0.0; 3], hi: [1.0; 3] },
        recipe: Recipe::fast(),
    };
    let made = Made {
        version: "0.1.0".into(),
        commit: "0123abcdef".into(),
        device: "cpu (2 threads)".into(),
        steps: 3000,
        seconds: 61.5,
    };
    let scored = |split| SplitRecord { split, outcome: Outcome::Scored(evaluation(job, split)) };
    let splits = [Split::Val, Split::Easy, Split::Hard].map(scored).into();
    Record::new(job.clone(), config, made, Scored { splits, shown: None })
}

/// Takes the easy and hard scores away, as black test images do.
fn without_tests(mut record: Record) -> Record {
    for split in &mut record.splits[1..] {
        split.outcome = Outcome::Skipped("9 of 9 images are black".into());
    }
    record
}

const FULL: SceneFacts = SceneFacts { size: Some([1440, 1080]), official: true };
const SMALL: SceneFacts = SceneFacts { size: Some([160, 120]), official: true };

fn results(list: &JobList, facts: SceneFacts, records: Vec<Record>, failures: Vec<Failure>) -> Results {
    Results::gather(list, Path::new("/nowhere"), &|_| Some(facts), records, failures)
}

/// All jobs done.
fn complete(list: &JobList, facts: SceneFacts) -> Results {
    results(list, facts, list.jobs.iter().map(record).collect(), Vec::new())
}
