//! Corners on pictures of OpenCV's own boards, against OpenCV and against the truth (tools/golden_corners.py).

// Helpers outside of test functions unwrap too.
#![allow(clippy::unwrap_used)]

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use relight_capture::calibration::{Board, Corner, detect};
use relight_scene::{Image, read_image};
use serde::Deserialize;

#[derive(Deserialize)]
struct Golden {
    boards: BTreeMap<String, GoldenBoard>,
    cases: Vec<Case>,
}

#[derive(Deserialize)]
struct GoldenBoard {
    #[serde(flatten)]
    board: serde_json::Value,
    corners: Vec<[f64; 3]>,
}

#[derive(Deserialize)]
struct Case {
    image: String,
    board: String,
    truth: BTreeMap<u32, [f64; 2]>,
    opencv: BTreeMap<u32, [f64; 2]>,
}

/// A folder that `tools/golden_corners.py` made; another than the shipped one to try more pictures.
fn folder() -> PathBuf {
    std::env::var_os("RELIGHT_CORNERS")
        .map_or_else(|| Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/golden/corners"), PathBuf::from)
}

fn golden() -> (Golden, BTreeMap<String, Board>) {
    let golden: Golden =
        serde_json::from_str(&std::fs::read_to_string(folder().join("corners.json")).unwrap()).unwrap();
    let board = |b: &GoldenBoard| {
        let mut measures = b.board.clone();
        measures.as_object_mut().unwrap().remove("corners");
        serde_json::from_value(measures).unwrap()
    };
    let boards = golden.boards.iter().map(|(name, b)| (name.clone(), board(b))).collect();
    (golden, boards)
}

/// Squared misses of the corners that both have.
fn misses(found: &[Corner], truth: &BTreeMap<u32, [f64; 2]>) -> Vec<f64> {
    let miss = |c: &Corner| truth.get(&c.id).map(|t| (c.x - t[0]).powi(2) + (c.y - t[1]).powi(2));
    found.iter().filter_map(miss).collect()
}

fn rms(squares: &[f64]) -> f64 {
    (squares.iter().sum::<f64>() / squares.len() as f64).sqrt()
}

#[test]
fn boards_have_opencvs_corners() {
    let (golden, boards) = golden();
    for (name, golden) in &golden.boards {
        let board = &boards[name];
        assert_eq!(golden.corners.len(), board.corners() as usize);
        for (id, corner) in (0..).zip(&golden.corners) {
            let [x, y] = board.corner(id).unwrap();
            assert!(
                (x - corner[0]).abs() < 1e-6 && (y - corner[1]).abs() < 1e-6 && corner[2] == 0.0,
                "{name} {id}"
            );
        }
    }
}

#[test]
fn corners_are_where_opencv_and_the_truth_have_them() {
    let (golden, boards) = golden();
    let mut all = Vec::new();
    for case in &golden.cases {
        let found = detect(&read_image(&folder().join(&case.image)).unwrap(), &boards[&case.board]).unwrap();
        let opencv: Vec<_> = case.opencv.iter().map(|(&id, &[x, y])| Corner { id, x, y }).collect();
        let truth = misses(&found, &case.truth);
        let (from_opencv, of_opencv) =
            (rms(&misses(&found, &case.opencv)), rms(&misses(&opencv, &case.truth)));
        println!(
            "{}: {} of {} corners, {:.4} px RMS from the truth, {from_opencv:.4} from OpenCV, which has {} and {of_opencv:.4}",
            case.image,
            found.len(),
            case.truth.len(),
            rms(&truth),
            opencv.len()
        );
        assert_eq!(truth.len(), found.len(), "{}: a corner that is not in the picture", case.image);
        assert!(found.windows(2).all(|w| w[0].id < w[1].id));
        for (corner, square) in found.iter().zip(&truth) {
            assert!(square.sqrt() < 0.2, "{}: corner {} is {} px off", case.image, corner.id, square.sqrt());
        }
        // OpenCV's own window reaches into the markers where squares are small: there it is the one that is off.
        assert!(from_opencv < of_opencv.max(0.03) + 0.02, "{}", case.image);
        assert!(of_opencv > 0.05 || from_opencv <= 0.05, "{}", case.image);
        all.extend(truth);
    }
    println!("{} corners, {:.4} px RMS from the truth", all.len(), rms(&all));
    assert!(all.len() > 150 && rms(&all) < 0.03);
}

#[test]
fn pictures_without_the_board_have_no_corners() {
    let (golden, boards) = golden();
    let small = read_image(&folder().join(&golden.cases[0].image)).unwrap();
    assert_eq!(detect(&small, &boards["april"]).unwrap(), [], "markers of another dictionary");
    for (width, height) in [(0, 0), (1, 1), (0, 40), (31, 400), (64, 64)] {
        let pixels = 3 * (width * height) as usize;
        for byte in [0, 128, 255] {
            let image = Image { width, height, data: vec![byte; pixels] };
            assert_eq!(detect(&image, &boards["small"]).unwrap(), [], "{width}x{height}");
        }
        let noise =
            (0..pixels).map(|i| (i as u64).wrapping_mul(0x9E37_79B9_7F4A_7C15).to_be_bytes()[0]).collect();
        assert_eq!(detect(&Image { width, height, data: noise }, &boards["small"]).unwrap(), []);
    }
    let short = Image { width: 64, height: 64, data: vec![0; 100] };
    assert!(detect(&short, &boards["small"]).unwrap_err().to_string().contains("64x64"));
}
