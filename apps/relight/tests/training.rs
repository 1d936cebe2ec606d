//! Training as a user meets it: it learns, and it survives being stopped.

// Helpers outside of test functions.
#![allow(clippy::unwrap_used)]

mod common;

use std::fs;

use common::{TINY, Workshop, metrics};

#[test]
fn a_trained_field_beats_what_can_be_had_without_learning() {
    let recipe = "rays-per-step = 512\nlights-per-ray = 4\nepoch = 300\n\
        [sampling.guided]\nsamples = 24\n\
        [grid]\nlevels = 4\nfeatures = 4\nlog2_table = 15\nbase = 8\nfinest = 128\n";
    let shop = Workshop::with([30, 12], [48, 36], recipe);
    shop.succeed("train scene --out run --recipe recipe.toml --steps 600");
    for split in ["val", "easy", "hard"] {
        let scores = shop.json(&format!("eval run --split {split} --json"));
        let own = scores["psnr"].as_f64().unwrap();
        for baseline in ["mean-image", "nearest-light"] {
            let other = scores["baselines"][baseline]["psnr"].as_f64().unwrap();
            assert!(own > other + 1.0, "{split}: {own} dB against {other} dB of {baseline}");
        }
    }
}

/// Once training has ended, the guide tells of the whole field; what a guide does not tell is found again, and not kept.
#[test]
fn guides_are_completed_where_training_ends_and_missed_nowhere() {
    let shop = Workshop::new();
    shop.train("run");
    let path = shop.path("run/guide.safetensors");
    let kept = fs::read(&path).unwrap();
    let score = || shop.json("eval run --split easy --json")["psnr"].as_f64().unwrap();
    let expected = score();
    // Where a training was stopped.
    let name = b"\"surveyed\":\"true\"";
    let at = kept.windows(name.len()).position(|bytes| bytes == name).unwrap();
    let mut stopped = kept.clone();
    stopped[at + 1] = b'S';
    fs::write(&path, &stopped).unwrap();
    assert_eq!(score(), expected);
    assert_eq!(fs::read(&path).unwrap(), stopped);
    fs::remove_file(&path).unwrap();
    assert!((score() - expected).abs() < 0.5, "{} {expected}", score());
    assert!(!path.exists());
    // Where a training goes on and ends, a damaged one is whole again.
    fs::write(&path, &kept[..kept.len() - 1]).unwrap();
    let output = shop.run("train scene --out run --resume --steps 30");
    let said = String::from_utf8(output.stderr).unwrap();
    assert!(output.status.success(), "{said}");
    let anew = fs::read(&path).unwrap();
    assert!(anew.windows(name.len()).any(|bytes| bytes == name));
}

#[cfg(unix)]
mod stopping {
    use std::process::{Command, Stdio};
    use std::time::{Duration, Instant};

    use super::*;

    /// Starts a command and sends it signals at once when there is the file or folder `awaited`; its exit status and what it
    /// said.
    fn signalled(shop: &Workshop, arguments: &str, awaited: &str, signals: &[&str]) -> (Option<i32>, String) {
        let mut child = shop.command(arguments).stdout(Stdio::null()).stderr(Stdio::piped()).spawn().unwrap();
        let patience = Instant::now();
        while !shop.path(awaited).exists() {
            assert!(patience.elapsed() < Duration::from_secs(120), "no {awaited}");
            std::thread::sleep(Duration::from_millis(2));
        }
        let pid = child.id();
        let kill: String = signals.iter().map(|signal| format!("kill {signal} {pid};")).collect();
        assert!(Command::new("sh").args(["-c", &kill]).status().unwrap().success());
        let mut said = String::new();
        std::io::Read::read_to_string(&mut child.stderr.take().unwrap(), &mut said).unwrap();
        (child.wait().unwrap().code(), said)
    }

    /// Stops a training of 600 steps once there is a checkpoint.
    fn interrupted(shop: &Workshop, signal: &str) -> (Option<i32>, String) {
        let arguments = "train scene --out stopped --recipe recipe.toml --steps 600";
        signalled(shop, arguments, "stopped/checkpoint/latest.safetensors", &[signal])
    }

    fn resumed_equals_whole(shop: &Workshop) {
        shop.succeed("train scene --out stopped --resume");
        shop.succeed("train scene --out whole --recipe recipe.toml --steps 600");
        let (stopped, whole) = (shop.path("stopped"), shop.path("whole"));
        assert!(metrics(&stopped) == metrics(&whole));
        let weights = |run: &std::path::Path| std::fs::read(run.join("weights.safetensors")).unwrap();
        assert!(weights(&stopped) == weights(&whole), "byte for byte");
    }

    #[test]
    fn a_killed_run_goes_on_as_if_nothing_had_happened() {
        let shop = Workshop::new();
        let (status, _) = interrupted(&shop, "-KILL");
        assert_eq!(status, None, "it was killed before its end");
        resumed_equals_whole(&shop);
    }

    #[test]
    fn ctrl_c_stops_cleanly_and_the_run_goes_on_later() {
        let shop = Workshop::new();
        let (status, said) = interrupted(&shop, "-INT");
        assert_eq!(status, Some(1), "{said}");
        assert!(said.contains("--resume"), "{said}");
        resumed_equals_whole(&shop);
    }

    #[test]
    fn a_demo_that_is_stopped_before_it_learns_leaves_an_empty_folder() {
        let shop = Workshop::new();
        let (status, said) = signalled(&shop, "demo --out demo", "demo/scene/lset000", &["-INT"]);
        assert_eq!(status, Some(1), "{said}");
        assert!(said.contains("stopped before"), "{said}");
        assert_eq!(std::fs::read_dir(shop.path("demo")).unwrap().count(), 0);
    }

    #[test]
    fn termination_stops_as_cleanly() {
        let shop = Workshop::new();
        let (status, said) = interrupted(&shop, "-TERM");
        assert_eq!(status, Some(1), "{said}");
        assert!(said.contains("--resume"), "{said}");
        resumed_equals_whole(&shop);
    }

    #[test]
    fn signals_that_come_at_once_stop_as_cleanly_as_one() {
        // As `timeout` and terminals send them. They differ, for equal ones that come so soon may count as one.
        let shop = Workshop::new();
        let arguments = "train scene --out run --recipe recipe.toml --steps 100000";
        let (status, said) =
            signalled(&shop, arguments, "run/checkpoint/latest.safetensors", &["-INT", "-TERM"]);
        assert!(status == Some(1) && said.contains("--resume"), "{status:?}: {said}");
    }

    #[test]
    fn a_run_that_was_stopped_while_its_scene_was_made_ready_is_begun_as_it_was_asked_for() {
        // Large enough for stereo to take a while.
        let recipe = "rays-per-step = 32\n[sampling.guided]\nsamples = 8\n";
        let shop = Workshop::with([12, 6], [48, 36], recipe);
        let asked = "--recipe recipe.toml --model v3 --seed 7 --steps 20";
        shop.succeed(&format!("train scene --out whole {asked}"));
        let weights = |run: &str| std::fs::read(shop.path(run).join("weights.safetensors")).unwrap();
        for (run, signal, expected) in [("killed", "-KILL", None), ("stopped", "-INT", Some(1))] {
            let config = format!("{run}/config.toml");
            let train = format!("train scene --out {run} {asked}");
            let (status, said) = signalled(&shop, &train, &config, &[signal]);
            assert!(status == expected && said.contains("--resume") == (signal == "-INT"), "{said}");
            let config = std::fs::read_to_string(shop.path(&config)).unwrap();
            assert!(!config.contains("[bounds]") && !config.contains("[recipe.grid]"), "{config}");
            assert!(shop.fail(&format!("train scene --out {run} --resume --model v5"), 1).contains("v3"));
            shop.succeed(&format!("train scene --out {run} --resume"));
            assert!(weights(run) == weights("whole"), "{run}");
        }
    }
}

/// The published recipe at a smaller size: colour at every sample, one light a ray, samples in two passes, and nothing but photographs
/// to start from.
#[test]
fn the_papers_recipe_learns() {
    let recipe = "rays-per-step = 512\nepoch = 100\nreport-every = 100\n\
        [sampling.stratified]\ncoarse = 24\nfine = 24\n\
        [grid]\nlevels = 8\nfeatures = 2\nlog2_table = 14\nbase = 8\nfinest = 128\n";
    let shop = Workshop::with([12, 8], [32, 24], recipe);
    shop.succeed("train scene --out run --preset paper --recipe recipe.toml --steps 300");
    let config = std::fs::read_to_string(shop.path("run/config.toml")).unwrap();
    assert!(config.contains("preset = \"paper\"") && config.contains("shading = \"per-sample\""), "{config}");
    let scores = shop.json("eval run --json");
    let (own, mean) = (&scores["psnr"], &scores["baselines"]["mean-image"]["psnr"]);
    assert!(own.as_f64().unwrap() > mean.as_f64().unwrap() + 1.0, "{scores}");
    shop.succeed("render run --camera 0 --light 0 --out view.png");
    assert!(shop.path("view.png").exists());
    // The same recipe continues the run, another does not.
    let resume = "train scene --out run --resume --recipe recipe.toml --steps 310";
    shop.succeed(resume);
    std::fs::write(shop.path("recipe.toml"), recipe.replace("512", "256")).unwrap();
    assert!(shop.fail(resume, 1).contains("this run has another recipe"));
}

#[test]
fn without_a_budget_training_ends_when_validation_stops_improving() {
    let recipe = format!("horizon = 15\npatience = 2\nimprovement = 1000.0\n{TINY}");
    let shop = Workshop::with([8, 6], [24, 18], &recipe);
    shop.succeed("train scene --out run --recipe recipe.toml");
    assert_eq!(metrics(&shop.path("run")).last().unwrap()["step"], 30);
}

#[test]
fn a_grid_that_the_recipe_leaves_open_is_fitted_to_the_images_and_kept() {
    let recipe = "rays-per-step = 32\nepoch = 10\n[sampling.guided]\nsamples = 8\n";
    let shop = Workshop::with([8, 6], [24, 18], recipe);
    shop.succeed("train scene --out run --recipe recipe.toml --steps 5");
    let config = std::fs::read_to_string(shop.path("run/config.toml")).unwrap();
    // Images this small ask for the coarsest.
    assert!(config.contains("finest = 256") && config.contains("log2_table = 17"), "{config}");
    shop.succeed("train scene --out run --resume --steps 10");
    let open = config.split("[recipe.grid]").next().unwrap();
    std::fs::write(shop.path("run/config.toml"), open).unwrap();
    assert!(shop.fail("train scene --out run --resume --steps 15", 1).contains("has no [recipe.grid]"));
}
