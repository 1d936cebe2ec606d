//! Runs the real binary on a tiny scene.

// Each test uses a part of it, outside of test functions.
#![allow(dead_code, clippy::unwrap_used)]

use std::collections::BTreeMap;
use std::fs;
use std::ops::ControlFlow;
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};

use relight_capture::virtual_rig::VirtualCapture;
use serde_json::Value;
use tempfile::TempDir;

/// A recipe that trains a small field in an instant.
pub const TINY: &str = "rays-per-step = 32\nlights-per-ray = 2\nepoch = 10\nreport-every = 5\n\
    [sampling.guided]\nsamples = 8\n\
    [grid]\nlevels = 4\nfeatures = 2\nlog2_table = 10\nbase = 4\nfinest = 16\n";

/// Every file of a folder.
pub fn contents(folder: &Path) -> BTreeMap<String, Vec<u8>> {
    let mut found = BTreeMap::new();
    for entry in fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        let name = path.file_name().unwrap().to_string_lossy().into_owned();
        if path.is_dir() {
            found
                .extend(contents(&path).into_iter().map(|(inner, bytes)| (format!("{name}/{inner}"), bytes)));
        } else {
            found.insert(name, fs::read(&path).unwrap());
        }
    }
    found
}

/// A folder of the test's own, with a scene of 8 views x 6 lights at 24x18.
pub struct Workshop {
    folder: TempDir,
}

impl Workshop {
    pub fn new() -> Self {
        Self::with([8, 6], [24, 18], TINY)
    }

    /// With a scene of so many views and lights at a width and height, and a recipe.
    pub fn with([views, lights]: [usize; 2], [width, height]: [u32; 2], recipe: &str) -> Self {
        let folder = tempfile::tempdir_in(env!("CARGO_TARGET_TMPDIR")).unwrap();
        let object = "wheel".to_owned();
        let capture = VirtualCapture { object, views, lights, width, height, samples: 4, seed: 0 };
        capture.shoot(&folder.path().join("scene"), false, &mut |_| ControlFlow::Continue(())).unwrap();
        fs::write(folder.path().join("recipe.toml"), recipe).unwrap();
        Self { folder }
    }

    pub fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    /// The binary, in the folder: `scene` and `recipe.toml` are there.
    pub fn command(&self, arguments: &str) -> Command {
        let mut command = Command::new(env!("CARGO_BIN_EXE_relight"));
        command.current_dir(self.folder.path()).args(arguments.split_whitespace()).stdin(Stdio::null());
        command
    }

    pub fn run(&self, arguments: &str) -> Output {
        self.command(arguments).output().unwrap()
    }

    /// Standard output of a command that must succeed.
    pub fn succeed(&self, arguments: &str) -> String {
        let output = self.run(arguments);
        assert!(output.status.success(), "{arguments}: {}", String::from_utf8_lossy(&output.stderr));
        String::from_utf8(output.stdout).unwrap()
    }

    /// JSON on standard output of a command that must succeed.
    pub fn json(&self, arguments: &str) -> Value {
        serde_json::from_str(&self.succeed(arguments)).unwrap()
    }

    /// Standard error of a command that must fail with exit status `code`, say so once and not panic.
    pub fn fail(&self, arguments: &str, code: i32) -> String {
        let output = self.run(arguments);
        let stderr = String::from_utf8(output.stderr).unwrap();
        assert_eq!(output.status.code(), Some(code), "{arguments}: {stderr}");
        assert!(stderr.contains("error: ") && !stderr.contains("panicked"), "{arguments}: {stderr}");
        stderr
    }

    /// Trains `run` for 20 steps on the tiny recipe.
    pub fn train(&self, run: &str) {
        self.succeed(&format!("train scene --out {run} --recipe recipe.toml --steps 20"));
    }
}

/// Lines of metrics without what depends on the machine's speed, and without the format that the first tells.
pub fn metrics(run: &Path) -> Vec<Value> {
    let mut lines = lines(&fs::read_to_string(run.join("metrics.jsonl")).unwrap());
    if let Some(first) = lines.first_mut() {
        assert_eq!(first.as_object_mut().unwrap().remove("format").unwrap(), "relight-metrics-1");
    }
    lines
}

/// JSON lines without what depends on the machine's speed.
pub fn lines(text: &str) -> Vec<Value> {
    let timeless = |line: &str| {
        let mut value: Value = serde_json::from_str(line).unwrap();
        for key in ["seconds", "pixels_per_second"] {
            assert!(value.as_object_mut().unwrap().remove(key).is_some(), "{line}");
        }
        value
    };
    text.lines().map(timeless).collect()
}
