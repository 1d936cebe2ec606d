use std::path::Path;

use super::{Rig, SMALL, fault, lset, matrix_text, mended, pose_path, replace};
use crate::{Fault, FaultKind, Pose, Scene, SceneError, Severity, check};

const RIG: Rig = Rig { views: 12, lights: 8, width: 8, height: 6 };

fn rewrite_cameras(root: &Path, rig: Rig, which: impl Fn(usize) -> bool, change: impl Fn(&Pose) -> Pose) {
    for light in 0..rig.lights {
        for view in (0..rig.views).filter(|&view| which(view)) {
            replace(&pose_path(root, light, view), matrix_text(&change(&rig.camera(view))));
        }
    }
}

fn rewrite_lights(root: &Path, rig: Rig, which: impl Fn(usize) -> bool, change: impl Fn(&Pose) -> Pose) {
    for light in (0..rig.lights).filter(|&light| which(light)) {
        replace(&lset(root, light).join("light.txt"), matrix_text(&change(&rig.light(light))));
    }
}

fn in_millimetres(pose: &Pose) -> Pose {
    Pose(pose.0.map(|[a, b, c, t]| [a, b, c, 1000.0 * t]))
}

fn warnings(root: &Path) -> Vec<Fault> {
    let report = check(root, &|_, _| {});
    assert!(report.is_usable(), "{:?}", report.faults);
    report.faults.into_iter().filter(|fault| fault.severity == Severity::Warning).collect()
}

#[test]
fn good_poses_raise_nothing() {
    for rig in [RIG, SMALL, Rig { views: 50, lights: 4, width: 2, height: 2 }] {
        let folder = rig.write();
        let report = check(folder.path(), &|_, _| {});
        assert_eq!(report.faults, []);
        assert_eq!(report.images, rig.views * rig.lights);
    }
}

#[test]
fn conventions_of_all_cameras_are_recognised() {
    type Change = fn(&Pose) -> Pose;
    let cases: [(Change, &str); 3] = [
        (Pose::inverse, "seem to be world-to-camera:"),
        (Pose::flip_camera_axes, "seem to be of OpenGL"),
        (|pose| pose.flip_camera_axes().inverse(), "seem to be world-to-camera of OpenGL"),
    ];
    for (change, says) in cases {
        let folder = RIG.write();
        rewrite_cameras(folder.path(), RIG, |_| true, change);
        let fault = fault(Scene::open(folder.path()));
        assert_eq!(fault.kind, FaultKind::Convention);
        assert!(fault.to_string().contains(says), "{says}: {fault}");
        assert!(fault.path.ends_with("00000_pose.txt"));
        rewrite_cameras(folder.path(), RIG, |_| true, |pose| mended(&change(pose), &fault.mend));
        assert_eq!(check(folder.path(), &|_, _| {}).faults, [], "{says}: the mend mends");
    }
}

#[test]
fn few_cameras_tell_what_they_are() {
    type Change = fn(&Pose) -> Pose;
    let changes: [Change; 3] =
        [Pose::inverse, Pose::flip_camera_axes, |pose| pose.flip_camera_axes().inverse()];
    let mut told = 0;
    for views in [6, 8, 12, 20] {
        for first in 0..6 {
            // Every third to every eighth camera of a larger rig.
            let rig = Rig { views: 50, lights: 4, width: 8, height: 6 };
            let chosen: Vec<Pose> =
                (0..views).map(|view| rig.camera((first + view * (3 + first)) % rig.views)).collect();
            for change in changes {
                let folder = tempfile::tempdir().unwrap();
                let rig = Rig { views, ..rig };
                rig.write_to(folder.path());
                let rewrite = |poses: &dyn Fn(&Pose) -> Pose| {
                    for light in 0..rig.lights {
                        for (view, pose) in chosen.iter().enumerate() {
                            replace(&pose_path(folder.path(), light, view), matrix_text(&poses(pose)));
                        }
                    }
                };
                rewrite(&change);
                let Err(SceneError::Fault(fault)) = Scene::open(folder.path()) else { continue };
                told += 1;
                rewrite(&|pose| mended(&change(pose), &fault.mend));
                let report = check(folder.path(), &|_, _| {});
                assert!(report.is_usable(), "{views} from {first}: {fault} {:?}", report.faults);
            }
        }
    }
    assert!(told > 65, "of 72 wrong captures {told} were noticed");
}

#[test]
fn scenes_far_from_the_origin_are_warned_of() {
    let far = |pose: &Pose| Pose(pose.0.map(|[a, b, c, t]| [a, b, c, t + 3000.0]));
    let folder = RIG.write();
    rewrite_cameras(folder.path(), RIG, |_| true, far);
    rewrite_lights(folder.path(), RIG, |_| true, far);
    let warnings = warnings(folder.path());
    assert_eq!(warnings.len(), 1, "{warnings:?}");
    assert!(warnings[0].problem.contains("5196 m from the world's origin"), "{}", warnings[0]);
}

#[test]
fn a_single_odd_camera_is_named() {
    type Change = fn(&Pose) -> Pose;
    let cases: [(Change, &str); 3] =
        [(Pose::inverse, "invert it"), (Pose::flip_camera_axes, "OpenGL"), (in_millimetres, "millimetres")];
    for view in [0, 5, 11] {
        for (change, says) in cases {
            let folder = RIG.write();
            rewrite_cameras(folder.path(), RIG, |other| other == view, change);
            let fault = fault(Scene::open(folder.path()));
            assert_eq!(
                (fault.kind, fault.path.clone()),
                (FaultKind::Convention, pose_path(folder.path(), 0, view))
            );
            assert!(fault.to_string().contains(says), "{says}: {fault}");
        }
    }
}

#[test]
fn millimetres_are_warned_of() {
    type Change = fn(&Pose) -> Pose;
    // The lights too, or the cameras alone; near the origin, or millimetres away from it that would be metres.
    let moved: Change = |pose| in_millimetres(&Pose(pose.0.map(|[a, b, c, t]| [a, b, c, t + 2.0])));
    let cases: [(Change, Change); 3] =
        [(in_millimetres, in_millimetres), (in_millimetres, |pose| *pose), (moved, moved)];
    for (cameras, lights) in cases {
        let folder = RIG.write();
        rewrite_cameras(folder.path(), RIG, |_| true, cameras);
        rewrite_lights(folder.path(), RIG, |_| true, lights);
        let warnings = warnings(folder.path());
        assert_eq!(warnings.len(), 1, "{warnings:?}");
        assert!(warnings[0].to_string().contains("millimetres"));
    }
}

#[test]
fn inverted_lights_are_recognised() {
    let folder = RIG.write();
    rewrite_lights(folder.path(), RIG, |_| true, Pose::inverse);
    let all = fault(Scene::open(folder.path()));
    assert!(all.to_string().contains("world-to-light") && all.path.ends_with("lset000/light.txt"), "{all}");
    // Those at the top look down either way.
    for light in 0..RIG.lights - 2 {
        let folder = RIG.write();
        rewrite_lights(folder.path(), RIG, |other| other == light, Pose::inverse);
        let one = fault(Scene::open(folder.path()));
        assert!(one.to_string().contains("world-to-light"), "{one}");
        assert_eq!(one.path, lset(folder.path(), light).join("light.txt"));
    }
}

#[test]
fn lights_out_of_place_are_warned_of() {
    let move_to =
        |z: f64| move |pose: &Pose| Pose::look_at([pose.position()[0], pose.position()[1], z], [0.0; 3]);
    let folder = RIG.write();
    rewrite_lights(folder.path(), RIG, |light| light == 1, move_to(-0.3));
    let below = warnings(folder.path());
    assert_eq!((below.len(), below[0].kind), (1, FaultKind::Placement));
    assert!(below[0].problem.contains("below the floor") && below[0].path.ends_with("lset001/light.txt"));
    let folder = RIG.write();
    rewrite_lights(folder.path(), RIG, |light| light == 2, |_| Pose::look_at([0.03, 0.02, 0.1], [0.0; 3]));
    let inside = warnings(folder.path());
    assert!(inside.len() == 1 && inside[0].problem.contains("inside"));
    let folder = RIG.write();
    rewrite_lights(folder.path(), RIG, |light| light == 3, in_millimetres);
    assert!(fault(Scene::open(folder.path())).to_string().contains("millimetres"));
}

#[test]
fn lights_may_face_any_way() {
    let folder = RIG.write();
    let turned = |pose: &Pose| Pose(pose.0.map(|[a, b, c, t]| [c, a, b, t]));
    rewrite_lights(folder.path(), RIG, |_| true, turned);
    assert_eq!(warnings(folder.path()), []);
}

#[test]
fn copied_poses_are_told_of() {
    let folder = RIG.write();
    rewrite_lights(folder.path(), RIG, |light| light == 3 || light == 5, |_| RIG.light(2));
    let told = warnings(folder.path());
    for (fault, copy) in told.iter().zip(["lset003/light.txt", "lset005/light.txt"]) {
        assert!(fault.path.ends_with(copy) && fault.problem.contains("lset002"), "{fault}");
    }
    assert_eq!(told.len(), 2);

    let folder = RIG.write();
    rewrite_cameras(folder.path(), RIG, |_| true, |_| RIG.camera(0));
    let told = warnings(folder.path());
    let copies = told.iter().filter(|fault| fault.problem.contains("00000_pose.txt"));
    assert_eq!(copies.count(), RIG.views - 1, "{told:?}");
    assert!(told.iter().all(|fault| fault.kind != FaultKind::Convention), "they are not said to look away");
}
