//! What waypoints alone cannot tell of a lens, and what tells it: simulated corners against the truth.

// Helpers outside of test functions unwrap too.
#![allow(clippy::unwrap_used)]

use relight_capture::calibration::{
    Board, Calibration, CalibrationError, Corner, Dictionary, Measurements, WaypointView, calibrate,
    lens_viewpoints,
};
use relight_capture::trajectory::{Plan, PlanSettings};
use relight_scene::{Intrinsics, Pose};

const NOISE: f64 = 0.05;
const K3: usize = 8;

fn lens() -> Intrinsics {
    let distortion = vec![-0.08, 0.05, 4e-4, -3e-4, 0.0];
    Intrinsics { width: 1440, height: 1080, fx: 2321.0, fy: 2388.0, cx: 760.0, cy: 510.0, distortion }
}

fn board() -> Board {
    Board::new(12, 9, 0.027, 0.02025, Dictionary::named("DICT_5X5_100").unwrap()).unwrap()
}

/// Normal noise, a function of its number alone: twelve uniform numbers of SplitMix64 (Steele, Lea and Flood 2014).
fn normal(number: u64) -> f64 {
    let uniform = |k: u64| {
        let mut z = (number * 12 + k).wrapping_mul(0x9E37_79B9_7F4A_7C15);
        z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        (z >> 11) as f64 / (1u64 << 53) as f64
    };
    (0..12).map(uniform).sum::<f64>() - 6.0
}

/// The corners of a board that lies in the middle of the world, as a camera there sees them, with noise.
fn seen(label: usize, pose: &Pose, lens: &Intrinsics, seed: u64) -> WaypointView {
    let board = board();
    let flat = board.lying_flat();
    let corner = |id: u32| {
        let [x, y] = board.corner(id).unwrap();
        let at = lens.project(pose.inverse_transform(flat.transform([x, y, 0.0]))).unwrap();
        let key = ((seed * 1000 + label as u64) * 1000 + u64::from(id)) * 2;
        let [x, y] = [at[0] + NOISE * normal(key), at[1] + NOISE * normal(key + 1)];
        let is_inside = x > 0.0 && y > 0.0 && x < f64::from(lens.width) && y < f64::from(lens.height);
        is_inside.then_some(Corner { id, x, y })
    };
    WaypointView { label, corners: (0..board.corners()).filter_map(corner).collect() }
}

/// Some of the paper's camera waypoints.
fn waypoints() -> Vec<Pose> {
    let plan = Plan::new(&PlanSettings::default()).unwrap();
    plan.camera.waypoints.iter().step_by(4).map(|waypoint| waypoint.pose).collect()
}

fn views(poses: &[Pose], lens: &Intrinsics, seed: u64) -> Vec<WaypointView> {
    poses.iter().enumerate().map(|(label, pose)| seen(label, pose, lens, seed)).collect()
}

fn solve(
    views: &[WaypointView],
    lens_views: &[WaypointView],
    earlier: Option<&Calibration>,
) -> Result<Calibration, CalibrationError> {
    let board = board();
    calibrate(&Measurements {
        board: &board,
        board_to_world: board.lying_flat(),
        image_size: (1440, 1080),
        views,
        lens_views,
        earlier,
        touches: &[],
        declared_alignment: None,
    })
}

/// Mean distance of the centres from the truth, and what the calibration says it is, metres.
fn centres(found: &Calibration, truth: &[Pose]) -> [f64; 2] {
    let count = found.waypoints.len() as f64;
    let miss = |waypoint: &relight_capture::calibration::Waypoint| {
        let (a, b) = (waypoint.pose.position(), truth[waypoint.label].position());
        (0..3).map(|i| (a[i] - b[i]).powi(2)).sum::<f64>().sqrt()
    };
    let claimed = found.waypoints.iter().map(|w| w.position_error).sum::<f64>();
    [found.waypoints.iter().map(miss).sum::<f64>() / count, claimed / count]
}

#[test]
fn waypoints_under_one_tilt_are_weak_and_say_so() {
    let truth = waypoints();
    let (mut found, mut claimed) = (0.0, 0.0);
    for seed in 0..6 {
        let calibration = solve(&views(&truth, &lens(), seed), &[], None).unwrap();
        // The residuals betray nothing.
        assert!((calibration.rms_pixels - NOISE * 2f64.sqrt()).abs() < 0.005, "{}", calibration.rms_pixels);
        assert_eq!(calibration.weak(), (0..truth.len()).collect::<Vec<_>>());
        let warnings = calibration.warnings().concat();
        assert!(warnings.contains("weak") && warnings.contains("0, 1, 2"), "{warnings}");
        let [miss, says] = centres(&calibration, &truth);
        found += miss / 6.0;
        claimed += says / 6.0;
    }
    println!("centres {:.3} mm off, {:.3} mm expected", found * 1e3, claimed * 1e3);
    assert!(claimed > 5e-4, "{claimed}");
    assert!((0.3..1.5).contains(&(found / claimed)), "{found} m against {claimed} m");
}

#[test]
fn photographs_for_the_lens_make_them_strong() {
    let (truth, around) = (waypoints(), lens_viewpoints(12, 0.6));
    let (mut found, mut claimed) = (0.0, 0.0);
    for seed in 0..6 {
        let lens_views = views(&around, &lens(), seed + 100);
        let calibration = solve(&views(&truth, &lens(), seed), &lens_views, None).unwrap();
        assert_eq!((calibration.weak(), calibration.warnings()), (vec![], vec![]));
        assert!(
            calibration.lens_photographs.len() == 12
                && calibration.lens_photographs.iter().all(|p| p.problem.is_none())
        );
        let [miss, says] = centres(&calibration, &truth);
        found += miss / 6.0;
        claimed += says / 6.0;
    }
    println!("centres {:.4} mm off, {:.4} mm expected", found * 1e3, claimed * 1e3);
    assert!(found < 5e-5 && (0.7..1.2).contains(&(found / claimed)), "{found} m against {claimed} m");
}

#[test]
fn an_earlier_lens_counts_as_its_photographs_would() {
    let (truth, around) = (waypoints(), lens_viewpoints(12, 0.6));
    let lens_views = views(&around, &lens(), 100);
    let earlier = solve(&views(&truth, &lens(), 0), &lens_views, None).unwrap();
    let today = views(&truth, &lens(), 1);
    let found = solve(&today, &[], Some(&earlier)).unwrap();
    assert!(found.weak().is_empty() && !found.is_another_lens() && found.warnings().is_empty());
    // All photographs together know the same.
    let mut all = lens_views.clone();
    all.extend(views(&truth, &lens(), 0).into_iter().map(|v| WaypointView { label: v.label + 50, ..v }));
    let together = solve(&today, &all, None).unwrap();
    for (i, (a, b)) in found.intrinsics_errors.iter().zip(together.intrinsics_errors).enumerate() {
        assert!((a - b).abs() <= 0.05 * b, "{i}: {a} {b}");
    }
    for (a, b) in found.waypoints.iter().zip(&together.waypoints) {
        let apart = (0..3).map(|i| (a.pose.0[i][3] - b.pose.0[i][3]).abs()).fold(0.0, f64::max);
        assert!(apart < 2e-6, "waypoint {}: {apart} m", a.label);
    }
    // One view alone is enough then.
    assert!(solve(&today[..1], &[], Some(&earlier)).unwrap().weak().is_empty());

    let refocused = Intrinsics { fx: 2335.0, fy: 2402.0, ..lens() };
    let another = solve(&views(&truth, &refocused, 1), &[], Some(&earlier)).unwrap();
    assert!(another.is_another_lens() && another.warnings().concat().contains("refocused"));
    let mut smaller = earlier.clone();
    smaller.intrinsics.width = 720;
    let refused = solve(&today, &[], Some(&smaller));
    assert_eq!(refused, Err(CalibrationError::Earlier(720, 1080)));
}

#[test]
fn k3_is_held_unless_the_views_support_it() {
    let (truth, around) = (waypoints(), lens_viewpoints(12, 0.6));
    let with = |k3: f64| {
        let mut lens = lens();
        lens.distortion[4] = k3;
        solve(&views(&truth, &lens, 3), &views(&around, &lens, 103), None).unwrap()
    };
    let none = with(0.0);
    assert_eq!((none.intrinsics.distortion[4], none.intrinsics_errors[K3]), (0.0, 0.0));
    assert!(none.to_string().contains("k3 0 (held)"), "{none}");
    let strong = with(2.0);
    let (k3, error) = (strong.intrinsics.distortion[4], strong.intrinsics_errors[K3]);
    assert!(error > 0.0 && (k3 - 2.0).abs() < 4.0 * error, "{k3} +- {error}");
}

#[test]
fn bad_photographs_for_the_lens_are_named_and_pull_nothing() {
    let (truth, around) = (waypoints(), lens_viewpoints(12, 0.6));
    let waypoints = views(&truth, &lens(), 0);
    let mut lens_views = views(&around, &lens(), 100);
    let clean = solve(&waypoints, &lens_views, None).unwrap();
    // Shaken, and hardly anything of the board.
    for (i, corner) in lens_views[4].corners.iter_mut().enumerate() {
        corner.x += if i % 2 == 0 { 1.5 } else { -1.5 };
    }
    lens_views[7].corners.truncate(3);
    let found = solve(&waypoints, &lens_views, None).unwrap();
    let named: Vec<_> =
        found.lens_photographs.iter().filter(|p| p.problem.is_some()).map(|p| p.label).collect();
    assert_eq!(named, [4, 7]);
    assert!(found.left_out.is_empty() && found.bad().is_empty());
    assert!(found.to_string().contains("10 of 12 photographs for the lens"), "{found}");
    assert!(found.lens_photographs[7].problem.as_ref().unwrap().contains("3 corners are seen"));
    let off = (found.intrinsics.fx - clean.intrinsics.fx).abs();
    assert!(off < 2.0 * clean.intrinsics_errors[0], "{off}");
}
