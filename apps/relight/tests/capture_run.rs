//! Capturing on the virtual rig, as a user meets it.

// Helpers outside of test functions.
#![allow(clippy::unwrap_used)]

mod common;

use std::fs;
use std::process::{Command, Output, Stdio};
use std::thread::sleep;
use std::time::{Duration, Instant};

use relight_scene::{Scene, Splits};
use tempfile::TempDir;

use common::contents;

/// A capture that takes a second or two.
const SMALL: &str = "capture run --object wheel --views 6 --lights 5 --size 40x30 --samples 8";

fn folder() -> TempDir {
    tempfile::tempdir_in(env!("CARGO_TARGET_TMPDIR")).unwrap()
}

fn command(folder: &TempDir, arguments: &str) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_relight"));
    command.current_dir(folder.path()).args(arguments.split_whitespace()).stdin(Stdio::null());
    command
}

fn run(folder: &TempDir, arguments: &str) -> Output {
    command(folder, arguments).output().unwrap()
}

/// What a command says that must fail with 1.
fn fail(folder: &TempDir, arguments: &str) -> String {
    let output = run(folder, arguments);
    assert_eq!(output.status.code(), Some(1), "{arguments}");
    String::from_utf8(output.stderr).unwrap()
}

/// A session that is killed again and again, at moments that may depend on how long a whole one takes.
fn kill(moments: impl Fn(Duration) -> Vec<Duration>, more: &str) {
    let folder = folder();
    let begun = Instant::now();
    let straight = run(&folder, &format!("{SMALL} --out straight {more}"));
    let whole = begun.elapsed();
    assert!(straight.status.success(), "{}", String::from_utf8_lossy(&straight.stderr));
    let scene = Scene::open(&folder.path().join("straight")).unwrap();
    assert_eq!((scene.cameras.len(), scene.lights.len(), scene.frames.len()), (6, 5, 30));
    assert!(!Splits::of(&scene).unwrap().hard.is_empty());
    let kill_after = |moment: Duration| {
        let arguments = format!("{SMALL} --out killed --resume --quiet {more}");
        let mut child = command(&folder, &arguments).spawn().unwrap();
        sleep(moment);
        child.kill().unwrap();
        child.wait().unwrap();
    };
    moments(whole).into_iter().for_each(kill_after);
    let rest = run(&folder, &format!("{SMALL} --out killed --resume {more}"));
    assert!(rest.status.success(), "{}", String::from_utf8_lossy(&rest.stderr));
    let (straight, killed) =
        (contents(&folder.path().join("straight")), contents(&folder.path().join("killed")));
    assert_eq!(killed.keys().collect::<Vec<_>>(), straight.keys().collect::<Vec<_>>());
    assert!(killed == straight);
}

#[test]
fn a_session_killed_at_twenty_moments_ends_as_one_that_never_was() {
    // Moments that are spread over all that happens, however fast the machine is: most come before the end.
    kill(|_| (0..20).map(|i| Duration::from_millis(3 + 37 * i % 191)).collect(), "--skip-robots");
}

#[test]
fn so_does_one_with_arms() {
    // Planning comes first, and takes some of the time.
    kill(|whole| [4, 2, 6, 3, 5].map(|eighths| whole * eighths / 8).to_vec(), "");
}

#[test]
fn photographs_are_taken_again_on_request() {
    let folder = folder();
    let small = format!("{SMALL} --skip-robots --out scene");
    assert!(run(&folder, &small).status.success());
    let scene = folder.path().join("scene");
    let but_the_journal = || {
        let mut files = contents(&scene);
        files.remove(".capture/journal.jsonl");
        files
    };
    let shot = but_the_journal();
    // Somebody was at a photograph.
    fs::write(scene.join("lset003/data/00002_image.png"), "smudge").unwrap();
    let error = fail(&folder, &format!("{small} --resume"));
    assert!(error.contains("00002_image.png") && error.contains("--reshoot 2,3"), "{error}");
    assert!(run(&folder, &format!("{small} --resume --reshoot 2,3 --reshoot 4")).status.success());
    assert!(but_the_journal() == shot);
    let error = fail(&folder, &format!("{small} --resume --reshoot 6"));
    assert!(error.contains("view 6 was not shot yet"), "{error}");
    let elsewhere = small.replace("--out scene", "--out elsewhere");
    assert!(fail(&folder, &format!("{elsewhere} --resume --reshoot moved")).contains("holds no session"));
    for wrong in ["--reshoot 2,3", "--resume --reshoot 2,"] {
        assert_eq!(run(&folder, &format!("{small} {wrong}")).status.code(), Some(2), "{wrong}");
    }
}

#[test]
fn sessions_are_not_mixed_up_and_nothing_is_made_in_vain() {
    let folder = folder();
    let dry = run(&folder, &format!("{SMALL} --out scene --dry-run"));
    assert!(
        String::from_utf8_lossy(&dry.stdout)
            .starts_with("6 views under 5 lights: 30 photographs of 40x30 pixels")
    );
    assert!(fail(&folder, "capture run --object unicorn --out scene").contains("wire-cube"));
    assert!(fail(&folder, "capture run --object nowhere.glb --out scene --dry-run").contains("nowhere.glb"));
    assert!(fail(&folder, "capture run --object wheel --views 0 --out scene").contains("[camera]"));
    assert!(fail(&folder, "capture run --object wheel --samples 0 --out scene").contains("samples"));
    assert!(!folder.path().join("scene").exists());
    assert!(run(&folder, &format!("{SMALL} --out scene")).status.success());
    assert!(fail(&folder, &format!("{SMALL} --out scene")).contains("--resume"));
    let other = fail(&folder, &format!("{SMALL} --out scene --resume --seed 3"));
    assert!(other.contains("begun with seed 0, not 3"), "{other}");
    fs::create_dir(folder.path().join("thesis")).unwrap();
    fs::write(folder.path().join("thesis/thesis.tex"), "").unwrap();
    assert!(fail(&folder, &format!("{SMALL} --out thesis --resume")).contains("is not empty"));
    assert_eq!(fs::read_dir(folder.path().join("thesis")).unwrap().count(), 1);
}
