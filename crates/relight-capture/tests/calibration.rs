//! Calibrations against OpenCV's of the same corners and against the truth (tools/golden_calibration.py).

// Helpers outside of test functions unwrap too.
#![allow(clippy::unwrap_used)]

use std::fs;
use std::path::Path;

use relight_capture::calibration::{
    Board, Calibration, CalibrationError, Corner, Dictionary, FORMAT, Measurements, RecheckError, Tolerance,
    Touch, TouchError, WaypointView, calibrate, load, recheck, store,
};
use relight_scene::{Image, Intrinsics, Pose};
use serde::Deserialize;

#[derive(Deserialize)]
struct Golden {
    width: u32,
    height: u32,
    columns: u32,
    rows: u32,
    square: f64,
    marker: f64,
    dictionary: String,
    truth: [f64; 9],
    opencv: OpenCv,
    views: Vec<GoldenView>,
}

#[derive(Deserialize)]
struct OpenCv {
    rms: f64,
    intrinsics: [f64; 9],
    deviations: [f64; 9],
}

#[derive(Deserialize)]
struct GoldenView {
    corners: Vec<(u32, f64, f64)>,
    truth: [[f64; 4]; 3],
    opencv: [[f64; 4]; 3],
}

fn golden() -> Golden {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/golden/calibration.json");
    serde_json::from_str(&fs::read_to_string(path).unwrap()).unwrap()
}

impl Golden {
    fn board(&self) -> Board {
        let dictionary = Dictionary::named(&self.dictionary).unwrap();
        Board::new(self.columns, self.rows, self.square, self.marker, dictionary).unwrap()
    }

    fn views(&self) -> Vec<WaypointView> {
        let corners =
            |view: &GoldenView| view.corners.iter().map(|&(id, x, y)| Corner { id, x, y }).collect();
        self.views
            .iter()
            .enumerate()
            .map(|(label, view)| WaypointView { label, corners: corners(view) })
            .collect()
    }

    /// In the board's frame.
    fn calibrate(&self, views: &[WaypointView]) -> Result<Calibration, CalibrationError> {
        calibrate(&Measurements {
            board: &self.board(),
            board_to_world: Pose::IDENTITY,
            image_size: (self.width, self.height),
            views,
            lens_views: &[],
            earlier: None,
            touches: &[],
            declared_alignment: None,
        })
    }

    fn lens(&self) -> Intrinsics {
        let [fx, fy, cx, cy, distortion @ ..] = self.truth;
        let distortion = distortion.to_vec();
        Intrinsics { width: self.width, height: self.height, fx, fy, cx, cy, distortion }
    }

    /// Exact corners from a camera-to-board pose.
    fn seen_from(&self, label: usize, pose: &Pose) -> WaypointView {
        let (board, lens) = (self.board(), self.lens());
        let corner = |id| {
            let [x, y] = board.corner(id).unwrap();
            let [x, y] = lens.project(pose.inverse_transform([x, y, 0.0])).unwrap();
            let is_inside = x > 0.0 && y > 0.0 && x < f64::from(self.width) && y < f64::from(self.height);
            is_inside.then_some(Corner { id, x, y })
        };
        WaypointView { label, corners: (0..board.corners()).filter_map(corner).collect() }
    }
}

fn values(lens: &Intrinsics) -> [f64; 9] {
    let d = &lens.distortion;
    [lens.fx, lens.fy, lens.cx, lens.cy, d[0], d[1], d[2], d[3], d[4]]
}

/// Distance of the centres, metres, and the angle between the orientations, degrees.
fn apart(a: &Pose, b: &Pose) -> (f64, f64) {
    let distance = (0..3).map(|i| (a.0[i][3] - b.0[i][3]).powi(2)).sum::<f64>().sqrt();
    let squares = (0..9).map(|k| (a.0[k / 3][k % 3] - b.0[k / 3][k % 3]).powi(2)).sum::<f64>();
    (distance, (squares.sqrt() / 8f64.sqrt()).asin().to_degrees() * 2.0)
}

fn mean(values: impl Iterator<Item = f64>) -> f64 {
    let values: Vec<f64> = values.collect();
    values.iter().sum::<f64>() / values.len() as f64
}

#[test]
fn lens_and_poses_are_those_of_opencv() {
    let golden = golden();
    let calibration = golden.calibrate(&golden.views()).unwrap();
    let (lens, opencv) = (values(&calibration.intrinsics), &golden.opencv);
    println!("{calibration}");
    let theirs = opencv.intrinsics.iter().zip(&opencv.deviations);
    let ours = lens.iter().zip(&calibration.intrinsics_errors);
    for (i, ((value, error), (expected, deviation))) in ours.zip(theirs).enumerate() {
        assert!(
            (value - expected).abs() <= 0.1 * deviation,
            "parameter {i}: {value} against OpenCV's {expected}"
        );
        // k3 is held by both.
        assert!(
            i == 8 && *error == 0.0 || (error / deviation - 1.0).abs() < 0.05,
            "standard error of {i}: {error} against OpenCV's {deviation}"
        );
    }
    assert!((calibration.rms_pixels - opencv.rms).abs() < 1e-4 * opencv.rms);
    assert!(calibration.left_out.is_empty() && calibration.waypoints.iter().all(|w| !w.is_bad));
    for (waypoint, view) in calibration.waypoints.iter().zip(&golden.views) {
        let (metres, degrees) = apart(&waypoint.pose, &Pose(view.opencv));
        assert!(
            metres < 2e-5 && degrees < 0.002,
            "waypoint {}: {metres} m, {degrees} degrees",
            waypoint.label
        );
    }
}

#[test]
fn lens_and_poses_are_near_the_truth() {
    let golden = golden();
    let calibration = golden.calibrate(&golden.views()).unwrap();
    let apart: Vec<_> = calibration
        .waypoints
        .iter()
        .zip(&golden.views)
        .map(|(w, v)| apart(&w.pose, &Pose(v.truth)))
        .collect();
    let (metres, degrees) = (mean(apart.iter().map(|a| a.0)), mean(apart.iter().map(|a| a.1)));
    println!("centres {:.4} mm, {degrees:.5} degrees, {:.4} px", metres * 1e3, calibration.rms_pixels);
    assert!(metres < 1e-4 && degrees < 0.02 && calibration.rms_pixels < 0.15);
    // Standard errors mean what they say: over nine numbers, none is many times too small.
    let lens = values(&calibration.intrinsics);
    for ((found, truth), error) in lens.iter().zip(golden.truth).zip(calibration.intrinsics_errors) {
        assert!((found - truth).abs() <= 4.0 * error, "{found} +- {error}, truly {truth}");
    }
    let root_mean_square = |values: Vec<f64>| mean(values.iter().map(|v| v * v)).sqrt();
    let found = [apart.iter().map(|a| a.0).collect(), apart.iter().map(|a| a.1.to_radians()).collect()]
        .map(root_mean_square);
    let waypoints = &calibration.waypoints;
    let claimed = [
        waypoints.iter().map(|w| w.position_error).collect(),
        waypoints.iter().map(|w| w.rotation_error).collect(),
    ];
    for (found, claimed) in found.into_iter().zip(claimed.map(root_mean_square)) {
        assert!((0.7..1.4).contains(&(found / claimed)), "{found} found, {claimed} claimed");
    }
    for waypoint in &calibration.waypoints {
        let per_pixel = waypoint.rms_metres / waypoint.rms_pixels;
        assert!((per_pixel / (0.6 / 2354.0) - 1.0).abs() < 0.2, "{per_pixel} m a pixel");
    }
}

#[test]
fn exact_corners_give_the_truth_in_the_boards_world() {
    let golden = golden();
    let board = golden.board();
    let views: Vec<_> =
        (0..).zip(&golden.views).map(|(i, v)| golden.seen_from(3 * i, &Pose(v.truth))).collect();
    let to_world = board.lying_flat();
    let touch = |on_board: [f64; 3]| Touch { on_board, in_arm: to_world.transform(on_board) };
    let touches = [touch([0.0; 3]), touch([0.324, 0.0, 0.0]), touch([0.0, 0.243, 0.0])];
    let calibration = calibrate(&Measurements {
        board: &board,
        board_to_world: to_world,
        image_size: (golden.width, golden.height),
        views: &views,
        lens_views: &[],
        earlier: None,
        touches: &touches,
        declared_alignment: None,
    })
    .unwrap();
    for (found, truth) in values(&calibration.intrinsics).iter().zip(golden.truth) {
        assert!((found - truth).abs() < 1e-4 * (1.0 + truth.abs()), "{found} {truth}");
    }
    for ((waypoint, view), golden) in calibration.waypoints.iter().zip(&views).zip(&golden.views) {
        assert_eq!(waypoint.label, view.label);
        let camera = Pose(golden.truth);
        let (at, expected) = (waypoint.pose.position(), to_world.transform(camera.position()));
        assert!((0..3).all(|i| (at[i] - expected[i]).abs() < 1e-6), "{at:?} {expected:?}");
        assert!(at[2] > 0.2, "the camera is above the board");
        let ahead = to_world.rotate(camera.rotate([0.0, 0.0, 1.0]));
        let found = waypoint.pose.rotate([0.0, 0.0, 1.0]);
        assert!((0..3).all(|i| (found[i] - ahead[i]).abs() < 1e-6));
    }
    let light = calibration.light.unwrap();
    let (metres, degrees) = apart(&light.base_to_world, &Pose::IDENTITY);
    assert!(metres < 1e-9 && degrees < 1e-6 && light.is_rotation_measured);
}

#[test]
fn bad_waypoints_are_named_and_pull_nothing() {
    let golden = golden();
    let clean = golden.calibrate(&golden.views()).unwrap();
    let mut views = golden.views();
    // Shaken: every corner off by some pixels, this way and that.
    for (i, corner) in views[5].corners.iter_mut().enumerate() {
        corner.x += if i % 2 == 0 { 2.0 } else { -1.5 };
        corner.y += if i % 3 == 0 { 1.5 } else { -2.0 };
    }
    // Wrongly read: numbers in disorder.
    let n = views[11].corners.len();
    let ids: Vec<u32> = views[11].corners.iter().map(|corner| corner.id).collect();
    for (i, corner) in views[11].corners.iter_mut().enumerate() {
        corner.id = ids[(7 * i + 3) % n];
    }
    // One corner of an otherwise good view.
    views[20].corners[4].x += 6.0;
    // Hardly anything seen, and nothing.
    views[30].corners.truncate(5);
    views[31].corners.clear();
    let calibration = golden.calibrate(&views).unwrap();
    let bad: Vec<usize> = calibration.waypoints.iter().filter(|w| w.is_bad).map(|w| w.label).collect();
    let left_out: Vec<usize> = calibration.left_out.iter().map(|l| l.label).collect();
    let named = |label| bad.contains(&label) || left_out.contains(&label);
    assert!(
        bad.contains(&5) && named(11) && left_out.contains(&30) && left_out.contains(&31),
        "{bad:?} {left_out:?}"
    );
    for label in (0..36).filter(|label| ![5, 11, 20, 30, 31].contains(label)) {
        assert!(!named(label), "waypoint {label}");
    }
    assert!(calibration.to_string().contains("waypoint 31 has no pose: 0 corners are seen"), "{calibration}");
    for (a, b) in calibration.waypoints.iter().filter(|w| !w.is_bad).map(|w| (w, &clean.waypoints[w.label])) {
        assert!(apart(&a.pose, &b.pose).0 < 1e-4, "waypoint {}", a.label);
    }
    let off = (calibration.intrinsics.fx - clean.intrinsics.fx).abs();
    assert!(off < 2.0 * clean.intrinsics_errors[0], "{off}");
}

#[test]
fn several_images_of_a_waypoint_count_as_several() {
    let golden = golden();
    let mut views = golden.views();
    for view in &mut views {
        view.corners.extend_from_within(..);
    }
    let (twice, once) = (golden.calibrate(&views).unwrap(), golden.calibrate(&golden.views()).unwrap());
    let ratio = twice.intrinsics_errors[0] / once.intrinsics_errors[0];
    assert!((ratio - 0.5f64.sqrt()).abs() < 0.02, "{ratio}");
    assert!((twice.intrinsics.fx - once.intrinsics.fx).abs() < 0.05);
}

#[test]
fn views_that_do_not_determine_the_lens_are_refused() {
    let golden = golden();
    let few = golden.calibrate(&golden.views()[..3]);
    assert!(matches!(few, Err(CalibrationError::TooFewViews { usable: 3, .. })), "{few:?}");
    let mut views = golden.views();
    views.iter_mut().for_each(|view| view.corners.truncate(5));
    let fault = golden.calibrate(&views).unwrap_err().to_string();
    assert!(fault.contains("0 of 36 views") && fault.contains("waypoint 35: 5 corners are seen"), "{fault}");
    views = golden.views();
    views.iter_mut().for_each(|view| view.corners.retain(|corner| corner.id / 11 == 3));
    let fault = golden.calibrate(&views).unwrap_err().to_string();
    assert!(fault.contains("lie on a line"), "{fault}");
    // Straight ahead, from near and far and turned: exact, and with rounding for noise.
    for digits in [1e9, 10.0] {
        let views: Vec<_> = (0..12)
            .map(|i| {
                let (sin, cos) = (0.5 * f64::from(i)).sin_cos();
                let at = [0.13 + 0.002 * f64::from(i), 0.1, -0.5 - 0.02 * f64::from(i)];
                let pose = Pose([[cos, -sin, 0.0, at[0]], [sin, cos, 0.0, at[1]], [0.0, 0.0, 1.0, at[2]]]);
                let mut view = golden.seen_from(i as usize, &pose);
                for corner in &mut view.corners {
                    (corner.x, corner.y) =
                        ((corner.x * digits).round() / digits, (corner.y * digits).round() / digits);
                }
                view
            })
            .collect();
        let parallel = golden.calibrate(&views);
        assert!(matches!(parallel, Err(CalibrationError::Undetermined { .. })), "{digits}: {parallel:?}");
        assert!(parallel.unwrap_err().to_string().contains("tilted"));
    }
}

#[test]
fn views_of_another_board_and_touches_that_do_not_suffice_are_refused() {
    let golden = golden();
    let fault = |views: &[WaypointView]| golden.calibrate(views).unwrap_err().to_string();
    let mut views = golden.views();
    views[2].corners[0].id = 88;
    assert!(fault(&views).contains("waypoint 2: corner 88"));
    views = golden.views();
    views[2].corners[0].x = f64::NAN;
    assert!(fault(&views).contains("waypoint 2: corner"));
    views = golden.views();
    views[7].label = 3;
    assert!(fault(&views).contains("waypoint 3 was given twice"));
    let (board, views) = (golden.board(), golden.views());
    let measurements = Measurements {
        board: &board,
        board_to_world: Pose::IDENTITY,
        image_size: (golden.width, golden.height),
        views: &views,
        lens_views: &[],
        earlier: None,
        touches: &[Touch { on_board: [0.0; 3], in_arm: [0.5, 0.1, 0.0] }],
        declared_alignment: None,
    };
    assert_eq!(calibrate(&measurements), Err(CalibrationError::Touch(TouchError::TooFew(1))));
    let declared =
        calibrate(&Measurements { declared_alignment: Some(Pose::IDENTITY), ..measurements }).unwrap();
    assert_eq!(declared.light.unwrap().base_to_world.position(), [-0.5, -0.1, 0.0]);
    let no_image = calibrate(&Measurements { image_size: (0, 1080), ..measurements });
    assert_eq!(no_image, Err(CalibrationError::NoImage(0, 1080)));
    let empty = Image { width: 64, height: 48, data: vec![0; 3 * 64 * 48] };
    assert_eq!(
        WaypointView::of_images(4, &[empty], &board).unwrap(),
        WaypointView { label: 4, corners: vec![] }
    );
}

#[test]
fn a_stored_calibration_comes_back_the_same() {
    let golden = golden();
    let mut calibration = golden.calibrate(&golden.views()).unwrap();
    calibration
        .left_out
        .push(relight_capture::calibration::LeftOut { label: 99, reason: "a \"reason\"".to_owned() });
    let folder = tempfile::tempdir_in(env!("CARGO_TARGET_TMPDIR")).unwrap();
    let path = folder.path().join("calibration.json");
    store(&calibration, 1_700_000_000, &path).unwrap();
    assert_eq!(load(&path).unwrap(), (calibration, 1_700_000_000));
    assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 1);

    let text = fs::read_to_string(&path).unwrap();
    let fault = |from: &str, to: &str| {
        assert!(text.contains(from), "{from}");
        fs::write(&path, text.replacen(from, to, 1)).unwrap();
        load(&path).unwrap_err().to_string()
    };
    let version = fault(FORMAT, "relight-calibration-1");
    assert!(version.contains("calibration.json: the format is \"relight-calibration-1\""), "{version}");
    assert!(fault("\"columns\": 12", "\"columns\": 2").contains("too few corners"));
    assert!(fault("DICT_5X5_100", "DICT_5X5_101").contains("no dictionary"));
    assert!(fault("\"made\"", "\"mad\"").contains("line"));
    assert!(fault("\"fx\": 2", "\"fx\": -2").contains("the lens cannot be"));
    assert!(
        fault("\"fx\": 2", "\"colour\": 1, \"fx\": 2").contains("colour"),
        "no part of a lens is told by that name"
    );
    let first = &text[text.find("camera_to_world").unwrap()..];
    let number = first.lines().nth(1).unwrap().trim().trim_end_matches(',');
    assert!(fault(number, "7.5").contains("waypoint 0: the rotation part"), "{number}");
    assert!(fault("\"format\"", "").contains("no calibration"));
    assert!(load(&folder.path().join("none.json")).unwrap_err().to_string().contains("none.json"));
}

#[test]
fn a_recheck_tells_moved_waypoints_from_those_that_stayed() {
    let golden = golden();
    let calibration = golden.calibrate(&golden.views()).unwrap();
    let views = golden.views();
    let check = |views: &[WaypointView]| recheck(&calibration, views, Tolerance::default());
    let same = check(&views[..6]).unwrap();
    assert!(same.holds && same.waypoints.iter().all(|w| !w.has_moved && w.pixels.unwrap() < 0.15));

    // 0.03 mm is the arm's repeatability; a millimetre is not.
    for (millimetres, moves) in [(0.03, false), (1.0, true)] {
        let mut pose = Pose(golden.views[2].truth);
        pose.0[0][3] += millimetres * 1e-3;
        let moved = check(&[views[1].clone(), golden.seen_from(2, &pose)]).unwrap();
        assert_eq!(
            (moved.holds, moved.waypoints[0].has_moved, moved.waypoints[1].has_moved),
            (!moves, false, moves)
        );
        let by = moved.waypoints[1].camera_moved.unwrap() * 1e3;
        assert!((by - millimetres).abs() < 0.15, "{by} mm for {millimetres}");
    }
    let mut unseen = views[3].clone();
    unseen.corners.truncate(3);
    let unseen = check(&[unseen]).unwrap();
    assert!(!unseen.holds && unseen.waypoints[0].pixels.is_none(), "nothing seen is no proof");
    let unknown = WaypointView { label: 77, corners: vec![] };
    assert_eq!(check(&[unknown]), Err(RecheckError::UnknownWaypoint(77)));
}
