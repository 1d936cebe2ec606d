//! Lists of jobs, and their files.

use std::fs;
use std::path::Path;

use relight_train::schedule::Budget;

use super::*;
use crate::BenchError;

fn ids(list: &JobList) -> Vec<&str> {
    list.jobs.iter().map(|job| job.id.as_str()).collect()
}

#[test]
fn ids_are_of_scene_model_and_seed_and_jobs_of_a_scene_stay_together() {
    let list = list(&["cube", "lego"], &["v1", "v5"], &[0, 7]);
    assert_eq!(
        ids(&list),
        [
            "cube-v1-s0",
            "cube-v5-s0",
            "cube-v1-s7",
            "cube-v5-s7",
            "lego-v1-s0",
            "lego-v5-s0",
            "lego-v1-s7",
            "lego-v5-s7"
        ]
    );
    assert_eq!(list.jobs[1].folder(Path::new("out")), Path::new("out/runs/cube-v5-s0"));
}

#[test]
fn lists_that_cannot_be_are_refused() {
    let refused = |scenes: &[&str], models: &[&str], seeds: &[u32]| {
        let models: Vec<String> = models.iter().map(|&m| m.to_owned()).collect();
        let paths: Vec<_> = scenes.iter().map(|s| Path::new(s).to_owned()).collect();
        JobList::new(settings(), &paths, &models, seeds).unwrap_err().to_string()
    };
    assert!(
        refused(&["/a/cube", "/b/cube"], &["v5"], &[0])
            .contains("two scenes are called cube: /a/cube and /b/cube")
    );
    assert!(refused(&["/a/cube", "/a/cube"], &["v5"], &[0]).contains("named twice"));
    assert!(refused(&["/a/cube"], &["v5", "v5"], &[0]).contains("model v5 with seed 0 is named twice"));
    assert!(refused(&[], &["v5"], &[0]).contains("no jobs"));
}

#[test]
fn a_kept_list_keeps_the_places_of_its_jobs() {
    let folder = tempfile::tempdir().unwrap();
    assert_eq!(JobList::load(folder.path()).unwrap(), None);
    list(&["lego"], &["v5"], &[0]).keep(folder.path()).unwrap();
    list(&["cube", "lego"], &["v1", "v5"], &[0]).keep(folder.path()).unwrap();
    let kept = JobList::load(folder.path()).unwrap().unwrap();
    assert_eq!(ids(&kept), ["lego-v5-s0", "cube-v1-s0", "cube-v5-s0", "lego-v1-s0"]);
}

#[test]
fn other_settings_and_other_scenes_of_the_name_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let before = list(&["cube"], &["v5"], &[0]);
    before.keep(folder.path()).unwrap();
    let mut longer = before.clone();
    longer.settings.budget = Budget { steps: None, minutes: Some(2.5) };
    let refusal = longer.keep(folder.path()).unwrap_err().to_string();
    assert!(refusal.contains("(preset fast, 3000 steps, and now preset fast, 2.5 minutes)"), "{refusal}");
    let mut moved = before.clone();
    moved.jobs[0].scene = "/elsewhere/cube".into();
    let refusal = moved.keep(folder.path()).unwrap_err().to_string();
    assert!(refusal.contains("cube is another scene here, /scenes/cube"), "{refusal}");
    assert_eq!(JobList::load(folder.path()).unwrap().unwrap(), before, "nothing was changed");
}

#[test]
fn unknown_versions_and_damage_are_refused_by_name() {
    let folder = tempfile::tempdir().unwrap();
    let list = list(&["cube"], &["v5"], &[0]);
    list.keep(folder.path()).unwrap();
    let text = fs::read_to_string(folder.path().join("jobs.json")).unwrap();
    let refusal = |text: &str| {
        fs::write(folder.path().join("jobs.json"), text).unwrap();
        JobList::load(folder.path()).unwrap_err().to_string()
    };
    assert!(refusal(&text.replace("jobs-1", "jobs-9")).contains("relight-bench-jobs-9"));
    assert!(refusal(&text[..text.len() / 2]).contains("jobs.json"));
    assert!(refusal(&text.replace("scene-name", "warp")).contains("warp"));

    let record = record(&list.jobs[0]);
    record.save(folder.path()).unwrap();
    assert_eq!(Record::load(folder.path()).unwrap().unwrap(), record);
    let path = folder.path().join("result.json");
    let text = fs::read_to_string(&path).unwrap();
    fs::write(&path, text.replace("result-1", "result-9")).unwrap();
    let error = Record::load(folder.path()).unwrap_err();
    assert!(
        matches!(&error, BenchError::File { .. }) && error.to_string().contains("relight-bench-result-9")
    );
}

#[test]
fn settings_know_their_runs_and_may_leave_the_grid_to_them() {
    let list = list(&["cube"], &["v5"], &[3]);
    let job = &list.jobs[0];
    let mut config = record(job).config;
    assert_eq!(list.settings.check(job, &config), Ok(()));
    config.recipe.grid = Some(Default::default());
    assert_eq!(list.settings.check(job, &config), Ok(()), "fitted to the scene");
    let fixed = Settings { recipe: config.recipe.clone(), ..list.settings.clone() };
    config.recipe.grid = None;
    assert!(fixed.check(job, &config).unwrap_err().contains("recipe"));
    config.seed = 4;
    assert!(list.settings.check(job, &config).unwrap_err().contains("seed"));
}
