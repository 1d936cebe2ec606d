//! Training longer on real captures, which the repository does not hold: set RELIGHT_SCENES to a folder of ReNe scenes
//! with test images that are not black, and run with `--release --ignored`.

// Helpers outside of test functions.
#![allow(clippy::unwrap_used)]

use std::path::{Path, PathBuf};
use std::process::Command;

use serde_json::Value;

/// Steps, each a few times as many as the one before.
const STEPS: [u32; 3] = [2_000, 6_000, 18_000];

/// Standard output of the binary, which must succeed.
fn relight(arguments: &[&str]) -> String {
    let output = Command::new(env!("CARGO_BIN_EXE_relight")).args(arguments).output().unwrap();
    assert!(output.status.success(), "{arguments:?}: {}", String::from_utf8_lossy(&output.stderr));
    String::from_utf8(output.stdout).unwrap()
}

fn scores(run: &Path, split: &str) -> Value {
    serde_json::from_str(&relight(&["eval", run.to_str().unwrap(), "--split", split, "--json", "-q"]))
        .unwrap()
}

fn scenes() -> Vec<PathBuf> {
    let root = std::env::var_os("RELIGHT_SCENES").expect("RELIGHT_SCENES names a folder of scenes");
    let folders = std::fs::read_dir(root).unwrap().map(|entry| entry.unwrap().path());
    let scenes: Vec<PathBuf> = folders.filter(|path| path.join("lset000").is_dir()).collect();
    assert!(!scenes.is_empty(), "RELIGHT_SCENES holds no scene");
    scenes
}

#[test]
#[ignore = "needs captures and minutes: set RELIGHT_SCENES"]
fn training_longer_never_scores_lower() {
    let folder = tempfile::tempdir_in(env!("CARGO_TARGET_TMPDIR")).unwrap();
    for scene in scenes() {
        let mut before = f64::NEG_INFINITY;
        for steps in STEPS {
            let run = folder.path().join(format!("{}-{steps}", scene.file_name().unwrap().to_string_lossy()));
            let (place, out, count) = (scene.to_str().unwrap(), run.to_str().unwrap(), steps.to_string());
            relight(&["train", place, "--out", out, "--steps", &count, "-q"]);
            let [val, easy, hard] = ["val", "easy", "hard"].map(|split| scores(&run, split));
            let psnr = val["psnr"].as_f64().unwrap();
            println!("{place}, {steps} steps: {psnr:.2} dB, easy {}, hard {}", easy["psnr"], hard["psnr"]);
            assert!(psnr >= before, "{place}: {psnr} dB after {steps} steps, {before} dB after fewer");
            before = psnr;
        }
    }
}
