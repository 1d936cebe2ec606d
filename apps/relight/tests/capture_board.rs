//! `relight capture board` and `detect` on the command line.

// Helpers outside of test functions unwrap too.
#![allow(clippy::unwrap_used)]

use std::fs;
use std::path::Path;
use std::process::{Command, Output};

use serde_json::Value;

const GOLDEN: &str =
    concat!(env!("CARGO_MANIFEST_DIR"), "/../../crates/relight-capture/tests/golden/corners");
const BOARD: &str = "--board 7x5 --square 0.03 --marker 0.0225";

fn relight(folder: &Path, arguments: &str) -> Output {
    let mut command = Command::new(env!("CARGO_BIN_EXE_relight"));
    command.current_dir(folder).arg("capture").args(arguments.split_whitespace()).output().unwrap()
}

fn text(bytes: &[u8]) -> &str {
    std::str::from_utf8(bytes).unwrap()
}

#[test]
fn detect_writes_corners_as_opencv_numbers_and_places_them() {
    for dictionary in ["DICT_4X4_50", "4x4_50"] {
        let arguments = format!("detect frontal.webp {BOARD} --dictionary {dictionary} --json");
        let output = relight(Path::new(GOLDEN), &arguments);
        assert!(output.status.success(), "{}", text(&output.stderr));
        let answer: Value = serde_json::from_slice(&output.stdout).unwrap();
        let golden: Value =
            serde_json::from_str(&fs::read_to_string(format!("{GOLDEN}/corners.json")).unwrap()).unwrap();
        let frontal = &golden["cases"]
            .as_array()
            .unwrap()
            .iter()
            .find(|c| c["image"] == "frontal.webp")
            .unwrap()["opencv"];
        let corners = answer["corners"].as_array().unwrap();
        assert_eq!(answer.as_object().unwrap().len(), 1);
        assert_eq!(corners.len(), 24);
        for (number, corner) in corners.iter().enumerate() {
            assert_eq!(corner["id"], number);
            let [x, y] = [0, 1].map(|axis| frontal[number.to_string()][axis].as_f64().unwrap());
            assert!(
                (corner["x"].as_f64().unwrap() - x).abs() < 0.15
                    && (corner["y"].as_f64().unwrap() - y).abs() < 0.15
            );
        }
    }
}

#[test]
fn an_image_without_the_board_has_no_corners_and_a_warning() {
    let output =
        relight(Path::new(GOLDEN), &format!("detect frontal.webp {BOARD} --dictionary DICT_6X6_250 --json"));
    assert!(output.status.success());
    assert_eq!(text(&output.stdout), "{\"corners\":[]}\n");
    assert!(
        text(&output.stderr).contains("frontal.webp: no board of 7x5 squares"),
        "{}",
        text(&output.stderr)
    );
}

#[test]
fn bad_arguments_are_named() {
    let folder = tempfile::tempdir_in(env!("CARGO_TARGET_TMPDIR")).unwrap();
    let fails = |arguments: &str, code: i32, says: &str| {
        let output = relight(folder.path(), arguments);
        let stderr = text(&output.stderr);
        assert_eq!(output.status.code(), Some(code), "{arguments}: {stderr}");
        assert!(stderr.contains(says) && !stderr.contains("panicked"), "{arguments}: {stderr}");
    };
    fails(&format!("detect a.png {BOARD} --dictionary DICT_9X9_50"), 2, "known are DICT_4X4_100");
    fails("detect a.png --board 7 --square 0.03 --marker 0.02 --dictionary 4X4_50", 2, "as in 7x5");
    fails(
        "detect a.png --board 99x99 --square 0.03 --marker 0.02 --dictionary 4X4_50",
        1,
        "larger dictionary",
    );
    fails(&format!("detect a.png {BOARD} --dictionary 4X4_50"), 1, "a.png");
    fails(&format!("board {BOARD} --dictionary 4X4_50 --out board.dxf"), 1, ".svg or .pdf");
}

#[test]
fn a_rig_file_tells_of_the_board_once_for_all() {
    let folder = tempfile::tempdir_in(env!("CARGO_TARGET_TMPDIR")).unwrap();
    let table = "[board]\ncolumns = 7\nrows = 5\nsquare-metres = 0.03\nmarker-metres = 0.0225\ndictionary = \"4X4_50\"\n\
                 [camera]\nwaypoints = 2\ncolatitude-degrees = [48, 68]\nazimuth-degrees = [-118.5, -61.5]\n\
                 radius-metres = [0.602, 0.623]\n\
                 [light]\nwaypoints = 3\ncolatitude-degrees = [5, 43]\nradius-metres = [0.363, 0.414]\n\
                 [arms]\ncamera = { model = \"ec66\", base-metres = [0, -1, 0] }\n\
                 light = { model = \"ur5e\", base-metres = [0, 0.48, 0.03] }\n";
    fs::write(folder.path().join("rig.toml"), table).unwrap();
    let succeed = |arguments: &str| {
        let output = relight(folder.path(), arguments);
        assert!(output.status.success(), "{arguments}: {}", text(&output.stderr));
        text(&output.stdout).to_owned()
    };
    assert!(succeed("board --rig rig.toml --out board.svg").contains("230.0 x 170.0 mm"));
    assert!(succeed("board --rig rig.toml --square 0.02 --marker 0.01 --out board.svg").contains("160.0 x"));
    let golden = format!("{GOLDEN}/frontal.webp");
    assert!(succeed(&format!("detect {golden} --rig rig.toml")).starts_with("24 of 24 corners"));
    // The arms of the file go to its waypoints, and its board is that of the session.
    let shot = succeed("shoot-board --rig rig.toml --out session --size 320x240 --samples 2 --lens-views 1");
    assert!(shot.contains("board of 7x5 squares with markers of DICT_4X4_50 from 2 waypoints"), "{shot}");
    // A session of which nothing is said is of that board too.
    let file = folder.path().join("session/board.toml");
    assert!(fs::read_to_string(&file).unwrap().starts_with("columns = 7"));
    fs::remove_file(&file).unwrap();
    let error = relight(folder.path(), "calibrate session");
    assert!(text(&error.stderr).contains("board.toml"), "{}", text(&error.stderr));
    let with = relight(folder.path(), "calibrate session --rig rig.toml");
    assert!(!text(&with.stderr).contains("board.toml"), "{}", text(&with.stderr));
    let real = format!("{table}[controllers]\ncamera = \"a\"\nlight = \"b\"\n");
    fs::write(folder.path().join("rig.toml"), real).unwrap();
    let error = relight(folder.path(), "shoot-board --rig rig.toml --out other");
    assert!(text(&error.stderr).contains("no real camera"), "{}", text(&error.stderr));
}

#[test]
fn a_board_is_drawn_in_millimetres() {
    let folder = tempfile::tempdir_in(env!("CARGO_TARGET_TMPDIR")).unwrap();
    for (name, head) in [("board.svg", "<svg"), ("board.pdf", "%PDF")] {
        let output = relight(folder.path(), &format!("board {BOARD} --dictionary 4X4_50 --out {name}"));
        assert_eq!(text(&output.stdout), format!("{name}: 230.0 x 170.0 mm; print at 100 %\n"));
        assert!(fs::read_to_string(folder.path().join(name)).unwrap().starts_with(head));
    }
}
