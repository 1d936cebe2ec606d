//! `relight capture calibrate`: what it refuses.

// Helpers outside of test functions.
#![allow(clippy::unwrap_used)]

use std::fs;
use std::path::Path;
use std::process::{Command, Output};

fn calibrate(session: &Path, arguments: &[&str]) -> Output {
    let mut command = Command::new(env!("CARGO_BIN_EXE_relight"));
    command.args(["capture", "calibrate"]).arg(session).args(arguments).output().unwrap()
}

#[test]
fn what_is_missing_or_wrong_is_named() {
    let folder = tempfile::tempdir_in(env!("CARGO_TARGET_TMPDIR")).unwrap();
    let session = folder.path();
    let fail = |arguments: &[&str]| {
        let output = calibrate(session, arguments);
        assert_eq!(output.status.code(), Some(1));
        String::from_utf8(output.stderr).unwrap()
    };
    assert!(fail(&[]).contains("board.toml"));
    let file = session.join("board.toml");
    let good =
        "columns = 9\nrows = 7\nsquare-metres = 0.02\nmarker-metres = 0.015\ndictionary = \"DICT_4X4_50\"\n";
    for (wrong, says) in [
        ("columns = 9", "missing field"),
        (&good.replace("4X4_50", "9X9_50"), "9X9_50"),
        (&good.replace("0.015", "0.025"), "board.toml"),
        (&format!("board-to-world = {:?}\n{good}", [0.5; 16]), "board-to-world"),
    ] {
        fs::write(&file, wrong).unwrap();
        fs::create_dir_all(session.join("board")).unwrap();
        let said = fail(&[]);
        assert!(said.contains(says), "{said}");
    }
    fs::write(&file, good).unwrap();
    assert!(fail(&[]).contains("holds no photographs"));
    fs::write(session.join("board/IMG.png"), "").unwrap();
    assert!(fail(&[]).contains("IMG.png: is named after no waypoint"));
    fs::rename(session.join("board/IMG.png"), session.join("board/3.png")).unwrap();
    assert!(fail(&[]).contains("3.png"));
    assert!(fail(&["--recheck"]).contains("calibration.json"));
}
