//! The training loop, with an engine whose weights depend on every batch that it has seen.

// Helpers outside of test functions.
#![allow(clippy::unwrap_used)]

mod common;

use std::collections::BTreeSet;
use std::fs;
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use common::{Data, FakeEngine, config, tiny_scene};
use relight_field::parameters::Parameters;
use relight_field::weights_file;
use relight_scene::Frustum;
use relight_train::checkpoint::Checkpoint;
use relight_train::run::{RunConfig, RunFolder};
use relight_train::trainer::{Ending, Event, Outcome, Trainer, TrainingData};
use relight_train::{Report, TrainError};

/// Trains until step `stop` or to the end; what each event was, in short, goes to `events`.
fn train(
    data: &Data,
    run: &RunFolder,
    config: &RunConfig,
    engine: FakeEngine,
    stop: u64,
    events: &mut Vec<String>,
) -> Result<Outcome, TrainError> {
    let training = TrainingData {
        scene: &data.scene,
        splits: &data.splits,
        pixels: &data.pixels,
        depths: None,
        seconds: 0.0,
    };
    let mut trainer = Trainer::new(run, config, training, Box::new(engine))?;
    let cancel = AtomicBool::new(false);
    trainer.train(
        &mut |event: Event<'_>| match event {
            Event::Step { standing, .. } => cancel.store(standing.step >= stop, Ordering::Relaxed),
            Event::Report(r) => {
                events.push(format!("report {}{}", r.step, if r.psnr.is_some() { "*" } else { "" }))
            }
            Event::Checkpoint { step } => events.push(format!("checkpoint {step}")),
        },
        &cancel,
    )
}

/// Lines of metrics without what depends on the machine's speed.
fn metrics(root: &Path) -> Vec<Report> {
    let text = fs::read_to_string(root.join("metrics.jsonl")).unwrap();
    text.lines()
        .map(|line| Report {
            seconds: 0.0,
            pixels_per_second: 0.0,
            ..serde_json::from_str::<Report>(line).unwrap()
        })
        .collect()
}

fn weights(run: &RunFolder) -> Parameters {
    weights_file::load(&run.weights()).unwrap()
}

#[test]
fn a_run_leaves_what_it_promises() {
    let folder = tempfile::tempdir().unwrap();
    let data = tiny_scene(&folder.path().join("scene"));
    let config = config(&data, Some(10));
    let root = folder.path().join("run");
    let run = RunFolder::create(&root, &config).unwrap();
    let mut events = Vec::new();
    let engine = FakeEngine::new(&config);
    let views = Arc::clone(&engine.views);
    let outcome = train(&data, &run, &config, engine, u64::MAX, &mut events).unwrap();
    // The engine was told what training cameras have in view, and only they.
    let frames = data.splits.train.iter().map(|&frame| data.scene.frames[frame].camera);
    let cameras: BTreeSet<usize> = frames.collect();
    let told: Vec<Frustum> = cameras.iter().map(|&camera| Frustum::of(&data.scene.cameras[camera])).collect();
    assert!(cameras.len() < data.scene.cameras.len() && *views.lock().unwrap() == told);
    assert_eq!(outcome.ending, Ending::Budget);
    assert_eq!((outcome.standing.step, outcome.standing.rays, outcome.standing.pixels), (10, 320, 960));
    let reports: Vec<&String> = events.iter().filter(|e| e.starts_with("report")).collect();
    assert_eq!(reports, ["report 3", "report 4*", "report 6", "report 8*", "report 9", "report 10*"]);
    assert_eq!(events.last().unwrap(), "checkpoint 10");
    let lines = metrics(&root);
    assert_eq!(lines.iter().map(|r| r.step).collect::<Vec<_>>(), [3, 4, 6, 8, 9, 10]);
    assert!(lines[5].psnr.is_some() && lines[5].ssim.is_some() && lines[0].psnr.is_none());
    // The weights are those of the best validation.
    let best = lines.iter().filter_map(|r| r.psnr).fold(0.0, f64::max);
    assert_eq!(outcome.standing.best.unwrap().psnr, best);
    weights(&run);
    assert!(run.preview(8).is_file());
    let (_, read) = RunFolder::open(&root).unwrap();
    assert_eq!(read, config);
    assert!(RunFolder::create(&root, &config).unwrap_err().to_string().contains("--resume"));
}

#[test]
fn a_run_that_was_stopped_goes_on_as_if_it_had_not_been() {
    let folder = tempfile::tempdir().unwrap();
    let data = tiny_scene(&folder.path().join("scene"));
    let config = config(&data, Some(23));
    let whole = RunFolder::create(&folder.path().join("whole"), &config).unwrap();
    train(&data, &whole, &config, FakeEngine::new(&config), u64::MAX, &mut Vec::new()).unwrap();

    let parts = RunFolder::create(&folder.path().join("parts"), &config).unwrap();
    for stop in [5, 13, u64::MAX] {
        let outcome = train(&data, &parts, &config, FakeEngine::new(&config), stop, &mut Vec::new()).unwrap();
        assert_eq!(outcome.standing.step, stop.min(23));
    }
    assert_eq!(metrics(parts.root()), metrics(whole.root()));
    assert!(weights(&parts) == weights(&whole));
}

#[test]
fn equal_checkpoints_are_equal_files() {
    let folder = tempfile::tempdir().unwrap();
    let data = tiny_scene(&folder.path().join("scene"));
    let config = config(&data, Some(3));
    let run = RunFolder::create(&folder.path().join("run"), &config).unwrap();
    train(&data, &run, &config, FakeEngine::new(&config), u64::MAX, &mut Vec::new()).unwrap();
    let zeros = Parameters::zeros(config.field().unwrap()).unwrap();
    let checkpoint = Checkpoint::load(&run.checkpoint(), zeros).unwrap().unwrap();
    // Each time a map in random order would come in another.
    for copy in 0..8 {
        let path = folder.path().join(copy.to_string());
        checkpoint.save(&path).unwrap();
        assert!(fs::read(path).unwrap() == fs::read(run.checkpoint()).unwrap());
    }
}

#[test]
fn after_a_kill_what_the_checkpoint_does_not_know_is_done_again() {
    let folder = tempfile::tempdir().unwrap();
    let data = tiny_scene(&folder.path().join("scene"));
    let config = config(&data, Some(20));
    let whole = RunFolder::create(&folder.path().join("whole"), &config).unwrap();
    train(&data, &whole, &config, FakeEngine::new(&config), u64::MAX, &mut Vec::new()).unwrap();

    // Killed at step 14: metrics, weights and previews are of then, the checkpoint is of step 6.
    let killed = RunFolder::create(&folder.path().join("killed"), &config).unwrap();
    train(&data, &killed, &config, FakeEngine::new(&config), 6, &mut Vec::new()).unwrap();
    let checkpoint = fs::read(killed.checkpoint()).unwrap();
    train(&data, &killed, &config, FakeEngine::new(&config), 14, &mut Vec::new()).unwrap();
    fs::write(killed.checkpoint(), checkpoint).unwrap();
    let mut part = killed.checkpoint().into_os_string();
    part.push(".part");
    fs::write(part, b"half a checkpo").unwrap();

    train(&data, &killed, &config, FakeEngine::new(&config), u64::MAX, &mut Vec::new()).unwrap();
    assert_eq!(metrics(killed.root()), metrics(whole.root()));
    assert!(weights(&killed) == weights(&whole));
}

#[test]
fn numbers_that_are_not_finite_are_reported_with_their_place_and_cost_nothing_kept() {
    let folder = tempfile::tempdir().unwrap();
    let data = tiny_scene(&folder.path().join("scene"));
    let config = config(&data, Some(20));
    let run = RunFolder::create(&folder.path().join("run"), &config).unwrap();
    let broken_at = |step| {
        let mut engine = FakeEngine::new(&config);
        engine.broken_at = Some(step);
        engine
    };
    let error = train(&data, &run, &config, broken_at(2), u64::MAX, &mut Vec::new()).unwrap_err().to_string();
    assert!(error.contains("step 2") && error.contains("nothing is kept"), "{error}");
    assert!(!run.weights().exists() && !run.checkpoint().exists());

    train(&data, &run, &config, FakeEngine::new(&config), 9, &mut Vec::new()).unwrap();
    let kept = (fs::read(run.weights()).unwrap(), fs::read(run.checkpoint()).unwrap());
    let error =
        train(&data, &run, &config, broken_at(11), u64::MAX, &mut Vec::new()).unwrap_err().to_string();
    assert!(error.contains("step 11") && error.contains("rgb layer 2"), "{error}");
    assert!(error.contains("are kept"), "{error}");
    assert!((fs::read(run.weights()).unwrap(), fs::read(run.checkpoint()).unwrap()) == kept);
}

#[test]
fn lost_weights_are_written_from_the_checkpoint() {
    let folder = tempfile::tempdir().unwrap();
    let data = tiny_scene(&folder.path().join("scene"));
    let config = config(&data, Some(10));
    let run = RunFolder::create(&folder.path().join("run"), &config).unwrap();
    train(&data, &run, &config, FakeEngine::new(&config), u64::MAX, &mut Vec::new()).unwrap();
    fs::remove_file(run.weights()).unwrap();
    // There is nothing left to train.
    train(&data, &run, &config, FakeEngine::new(&config), u64::MAX, &mut Vec::new()).unwrap();
    let zeros = Parameters::zeros(config.field().unwrap()).unwrap();
    let checkpoint = Checkpoint::load(&run.checkpoint(), zeros).unwrap().unwrap();
    assert!(weights(&run) == checkpoint.parameters);
}

#[test]
fn one_training_at_a_time_works_in_a_folder() {
    let folder = tempfile::tempdir().unwrap();
    let data = tiny_scene(&folder.path().join("scene"));
    let config = config(&data, Some(4));
    let root = folder.path().join("run");
    let first = RunFolder::create(&root, &config).unwrap();
    let refused = |second: Result<RunFolder, TrainError>| {
        let error = second.unwrap_err().to_string();
        assert!(error.contains("run") && error.contains("another training"), "{error}");
    };
    refused(RunFolder::create(&root, &config));
    assert!(RunFolder::check_vacant(&root).unwrap_err().to_string().contains("another training"));
    train(&data, &first, &config, FakeEngine::new(&config), u64::MAX, &mut Vec::new()).unwrap();
    refused(RunFolder::resume(&root).map(|(run, _)| run));
    // Reading is free to all.
    RunFolder::open(&root).unwrap();
    drop(first);
    RunFolder::resume(&root).unwrap();
}

#[test]
fn a_run_that_is_given_up_leaves_nothing_but_what_others_left() {
    let folder = tempfile::tempdir().unwrap();
    let data = tiny_scene(&folder.path().join("scene"));
    let config = RunConfig { bounds: None, ..config(&data, Some(4)) };
    let root = folder.path().join("deep/run");
    let run = RunFolder::create(&root, &config).unwrap();
    assert_eq!(RunFolder::open(&root).unwrap().1, config, "as far as it is known");
    run.abandon();
    assert!(!root.exists() && root.parent().unwrap().exists());
    let run = RunFolder::create(&root, &config).unwrap();
    fs::write(root.join("metrics.jsonl"), "").unwrap();
    run.abandon();
    let left: Vec<_> = fs::read_dir(&root).unwrap().map(|entry| entry.unwrap().file_name()).collect();
    assert_eq!(left, ["metrics.jsonl"]);
}

#[test]
fn a_run_needs_a_folder_of_its_own() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("file");
    fs::write(&file, "something").unwrap();
    assert!(RunFolder::check_vacant(&file).unwrap_err().to_string().contains("is a file"));
    assert!(RunFolder::check_vacant(folder.path()).unwrap_err().to_string().contains("not empty"));
    let under = RunFolder::check_vacant(&file.join("run")).unwrap_err().to_string();
    assert!(under.contains("file/run: lies under a file"), "{under}");
    for (name, is_folder) in
        [("config.toml", true), ("lock", true), ("a.part", true), ("previews", false), ("checkpoint", false)]
    {
        let root = folder.path().join(format!("with-{name}"));
        fs::create_dir(&root).unwrap();
        let path = root.join(name);
        if is_folder {
            fs::create_dir(&path).unwrap()
        } else {
            fs::write(&path, "").unwrap()
        }
        let told = RunFolder::check_vacant(&root).unwrap_err().to_string();
        assert!(told.contains(&format!("{name}: is no f")), "{told}");
    }
    RunFolder::check_vacant(&folder.path().join("none")).unwrap();
}

#[test]
fn without_a_budget_a_plateau_ends_the_run() {
    let folder = tempfile::tempdir().unwrap();
    let data = tiny_scene(&folder.path().join("scene"));
    let mut config = config(&data, None);
    // No validation can gain so much: the first is the best, and three more are waited for.
    config.recipe.improvement = 1e3;
    // The learning rate falls until the horizon, and nothing is given up before.
    for (horizon, end) in [(10, 16), (23, 23)] {
        config.recipe.horizon = horizon;
        let run = RunFolder::create(&folder.path().join(format!("run{horizon}")), &config).unwrap();
        let fake = FakeEngine::new(&config);
        let outcome = train(&data, &run, &config, fake, u64::MAX, &mut Vec::new()).unwrap();
        assert_eq!((outcome.ending, outcome.standing.step), (Ending::Plateau, end));
    }
}

#[test]
fn damaged_and_foreign_files_are_refused_by_name() {
    let folder = tempfile::tempdir().unwrap();
    let data = tiny_scene(&folder.path().join("scene"));
    let config = config(&data, Some(6));
    let run = RunFolder::create(&folder.path().join("run"), &config).unwrap();
    train(&data, &run, &config, FakeEngine::new(&config), u64::MAX, &mut Vec::new()).unwrap();
    let again = |run: &RunFolder, config: &RunConfig| {
        train(&data, run, config, FakeEngine::new(config), u64::MAX, &mut Vec::new()).unwrap_err().to_string()
    };

    let good = fs::read(run.checkpoint()).unwrap();
    for length in [0, 7, 100, good.len() - 1] {
        fs::write(run.checkpoint(), &good[..length]).unwrap();
        assert!(again(&run, &config).contains("latest.safetensors"), "cut to {length}");
    }
    fs::write(run.checkpoint(), &good).unwrap();
    let mut other = config.clone();
    other.model = "v1".into();
    assert!(again(&run, &other).contains("another shape"));
    // Longer than any checkpoint of this field, and sparse.
    fs::File::create(run.checkpoint()).unwrap().set_len(1 << 40).unwrap();
    assert!(again(&run, &config).contains("latest.safetensors: is longer than"));

    let text = fs::read_to_string(run.config()).unwrap();
    fs::write(run.config(), text.replace("relight-run-1", "relight-run-9")).unwrap();
    let error = RunFolder::open(run.root()).unwrap_err().to_string();
    assert!(error.contains("config.toml") && error.contains("relight-run-9"), "{error}");
    fs::write(run.config(), "scene = [").unwrap();
    assert!(RunFolder::open(run.root()).unwrap_err().to_string().contains("config.toml"));
    assert!(RunFolder::open(folder.path()).unwrap_err().to_string().contains("no run"));
    assert!(RunFolder::create(folder.path(), &config).unwrap_err().to_string().contains("not empty"));
}
