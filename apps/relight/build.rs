//! Tells the program which commit it is built of, so that its scores can say so.

use std::process::Command;

fn main() {
    let git = |arguments: &[&str]| {
        let output = Command::new("git").args(arguments).output().ok()?;
        let text = String::from_utf8(output.stdout).ok()?;
        output.status.success().then(|| text.trim().to_owned())
    };
    // Every commit, and every change of what the program is made of.
    println!("cargo::rerun-if-changed=../../crates");
    println!("cargo::rerun-if-changed=src");
    if let Some(log) =
        git(&["rev-parse", "--git-path", "logs/HEAD"]).filter(|log| std::path::Path::new(log).exists())
    {
        println!("cargo::rerun-if-changed={log}");
    }
    let commit = git(&["rev-parse", "--short=10", "HEAD"]).map(|commit| {
        let changed = git(&["status", "--porcelain", "--", "../../crates", "src"])
            .is_none_or(|files| !files.is_empty());
        if changed { format!("{commit}, changed") } else { commit }
    });
    println!("cargo::rustc-env=RELIGHT_COMMIT={}", commit.as_deref().unwrap_or("no commit"));
}
