use std::path::Path;

use super::{Rig, SMALL};
use crate::vector::{norm, sub};
use crate::{Bounds, BoundsFault, Camera, Intrinsics, Light, Pose, Scene, check_bounds, scene_bounds};

fn lens() -> Intrinsics {
    Intrinsics { width: 1440, height: 1080, fx: 2321.0, fy: 2388.0, cx: 868.0, cy: 454.0, distortion: vec![] }
}

fn scene(cameras: Vec<Pose>, lights: Vec<Pose>) -> Scene {
    let camera = |(label, pose)| Camera { label, intrinsics: lens(), pose };
    Scene {
        cameras: cameras.into_iter().enumerate().map(camera).collect(),
        lights: lights.into_iter().enumerate().map(|(label, pose)| Light { label, pose }).collect(),
        frames: Vec::new(),
        ..SMALL.scene(Path::new("test"))
    }
}

fn contains(bounds: &Bounds, p: [f64; 3]) -> bool {
    (0..3).all(|i| (f64::from(bounds.lo[i])..f64::from(bounds.hi[i])).contains(&p[i]))
}

fn assert_cubic(bounds: &Bounds) {
    let sides = [0, 1, 2].map(|i| bounds.hi[i] - bounds.lo[i]);
    assert!(
        sides[0] > 0.0 && sides.iter().all(|side| (side - sides[0]).abs() < 1e-4 * sides[0]),
        "{bounds:?}"
    );
}

/// Aims the middle of the image, not the principal point, at a target.
fn aim(pose: &Pose, target: [f64; 3]) -> Pose {
    let [x, y, _] = lens().unproject(719.5, 539.5);
    let (across, down) = (x.atan(), (y / x.hypot(1.0)).atan());
    let mut aimed = Pose::look_at(pose.position(), target);
    let (s, c) = across.sin_cos();
    aimed = Pose(aimed.0.map(|[a, b, z, t]| [c * a + s * z, b, c * z - s * a, t]));
    let (s, c) = down.sin_cos();
    Pose(aimed.0.map(|[a, b, z, t]| [a, c * b + s * z, c * z - s * b, t]))
}

#[test]
fn the_real_rig_gets_floor_and_walls_and_few_cameras() {
    let rig = Rig { views: 50, lights: 40, width: 1440, height: 1080 };
    let cameras: Vec<Pose> = (0..50).map(|view| aim(&rig.camera(view), [0.0, 0.0, 0.05])).collect();
    let scene = scene(cameras, (0..40).map(|light| rig.light(light)).collect());
    let bounds = scene_bounds(&scene);
    assert_cubic(&bounds);
    // Seen from azimuths of -50 to 7 degrees the walls stand 0.4 m behind, at negative x and positive y.
    for place in [[0.0; 3], [-0.4, 0.0, 0.0], [0.0, 0.35, 0.0], [-0.3, 0.3, 0.3], [0.15, -0.15, 0.0]] {
        assert!(contains(&bounds, place), "{place:?} outside {bounds:?}");
    }
    let inside = scene.cameras.iter().filter(|camera| contains(&bounds, camera.pose.position())).count();
    assert!(inside <= 8, "{inside} cameras inside {bounds:?}");
    assert!(bounds.hi[0] - bounds.lo[0] < 1.0);
}

#[test]
fn stray_cameras_do_not_move_the_box() {
    let rig = Rig { views: 30, lights: 5, width: 8, height: 8 };
    let cameras: Vec<Pose> = (0..30).map(|view| rig.camera(view)).collect();
    let lights: Vec<Pose> = (0..5).map(|light| rig.light(light)).collect();
    let before = scene_bounds(&scene(cameras.clone(), lights.clone()));
    let mut strayed = cameras;
    strayed[3] = Pose::look_at([0.5, 0.5, 0.5], [3.0, -2.0, 1.0]);
    let after = scene_bounds(&scene(strayed, lights));
    assert!((0..3).all(|i| (before.lo[i] - after.lo[i]).abs() < 0.05), "{before:?} {after:?}");
}

#[test]
fn few_or_parallel_cameras_still_get_a_box() {
    let lamp = Pose::look_at([0.0, 0.0, 1.2], [0.0; 3]);
    let single = scene_bounds(&scene(vec![Pose::look_at([1.0, 0.0, 1.0], [0.0; 3])], vec![lamp]));
    assert_cubic(&single);
    assert!((0..3).all(|i| single.lo[i].abs() < 2.0 && single.hi[i].abs() < 2.0), "{single:?}");
    let row: Vec<Pose> = (0..5)
        .map(|i| Pose::look_at([0.2 * f64::from(i), -1.0, 0.0], [0.2 * f64::from(i), 0.0, 0.0]))
        .collect();
    let parallel = scene_bounds(&scene(row, vec![lamp]));
    assert_cubic(&parallel);
    let middle = [0, 1, 2].map(|i| f64::from(parallel.lo[i] + parallel.hi[i]) / 2.0);
    assert!(middle[1] > -0.8 && norm(sub(middle, [0.4, 0.0, 0.0])) < 1.0, "{parallel:?}");
    assert_cubic(&scene_bounds(&scene(vec![lamp, lamp], vec![lamp])));
    assert!(scene_bounds(&scene(vec![], vec![])).lo.iter().all(|v| v.is_finite()));
}

#[test]
fn boxes_that_no_field_could_have_are_refused() {
    let rig = Rig { views: 12, lights: 8, width: 1440, height: 1080 };
    let cameras: Vec<Pose> = (0..12).map(|view| aim(&rig.camera(view), [0.0, 0.0, 0.05])).collect();
    let scene = scene(cameras, (0..8).map(|light| rig.light(light)).collect());
    let around = |half: f32| Bounds { lo: [-half; 3], hi: [half; 3] };
    let check = |bounds: Bounds| check_bounds(&scene, &bounds);

    // Cameras stand at 0.6 m; that is 6 mm to 60 m.
    for half in [0.0035, 0.1, 1.0, 25.0] {
        assert_eq!(check(around(half)), Ok(()), "{half}");
    }
    assert_eq!(check(scene_bounds(&scene)), Ok(()));
    assert_eq!(check(Bounds { lo: [-0.1, -0.1, 0.0], hi: [0.1, 0.1, 0.001] }), Ok(()), "a sheet of card");
    // Beside the focus, but in the picture.
    assert_eq!(check(Bounds { lo: [0.05, 0.0, 0.0], hi: [0.08, 0.03, 0.03] }), Ok(()));

    for half in [1e-30, 1e-6, 0.0028] {
        assert!(matches!(check(around(half)), Err(BoundsFault::TooSmall { .. })), "{half}");
    }
    let thin = Bounds { lo: [-0.1, -0.1, 0.0], hi: [0.1, 0.1, 1e-5] };
    assert!(matches!(check(thin), Err(BoundsFault::TooSmall { .. })));
    for half in [33.0, 1e6, 1e38, f32::MAX] {
        assert!(matches!(check(around(half)), Err(BoundsFault::TooLarge { .. })), "{half}");
    }
    for half in [0.0, -1.0, f32::NAN, f32::INFINITY] {
        assert_eq!(check(around(half)), Err(BoundsFault::NoBox), "{half}");
    }
    for far in [[50.0, 50.0, 0.0], [0.0, 0.0, 2.0], [0.0, 0.0, -1e20]] {
        let elsewhere = Bounds { lo: far, hi: far.map(|c| c + 0.5_f32.max(c.abs() * 1e-6)) };
        assert!(check(elsewhere).is_err(), "{far:?}");
    }
    assert_eq!(check(Bounds { lo: [50.0; 3], hi: [50.5; 3] }), Err(BoundsFault::Unseen));
}
