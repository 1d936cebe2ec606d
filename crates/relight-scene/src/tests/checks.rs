use std::fs;

use super::{Rig, SMALL, image_path, lset, matrix_text, pose_path, replace};
use crate::{FaultKind, Image, Scene, SceneInfo, Severity, Splits, check};

#[test]
fn all_faults_are_listed_at_once() {
    let folder = SMALL.write();
    let root = folder.path();
    fs::remove_file(image_path(root, 0, 1)).unwrap();
    replace(&pose_path(root, 1, 2), "1 2 3");
    fs::write(image_path(root, 2, 3), b"no image").unwrap();
    let png = fs::read(image_path(root, 3, 4)).unwrap();
    fs::write(image_path(root, 3, 4), &png[..png.len() / 2]).unwrap();
    fs::write(root.join("lset001/data/notes.txt"), "hello").unwrap();
    fs::write(root.join("lset001/readme.txt"), "hello").unwrap();
    fs::create_dir(root.join("backup")).unwrap();
    Rig { width: 5, ..SMALL }.image(0, 0).write_png(&image_path(root, 2, 0)).unwrap();
    let report = check(root, &|_, _| {});
    let found = |kind, path: &str| report.faults.iter().find(|f| f.kind == kind && f.path.ends_with(path));
    let errors = [
        (FaultKind::Missing, "lset000/data/00001_image.png"),
        (FaultKind::Malformed, "lset001/data/00002_pose.txt"),
        (FaultKind::Image, "lset002/data/00003_image.png"),
        (FaultKind::Image, "lset003/data/00004_image.png"),
        (FaultKind::Size, "lset002/data/00000_image.png"),
    ];
    for (kind, path) in errors {
        let fault = found(kind, path).unwrap_or_else(|| panic!("{path} is not among {:?}", report.faults));
        assert_eq!(fault.severity, Severity::Error);
        assert!(!fault.mend.is_empty());
    }
    assert_eq!(report.count(Severity::Error), errors.len());
    assert_eq!(found(FaultKind::Extra, "data/notes.txt").unwrap().severity, Severity::Warning);
    assert_eq!(found(FaultKind::Extra, "lset001/readme.txt").unwrap().severity, Severity::Note);
    assert_eq!(found(FaultKind::Extra, "backup").unwrap().severity, Severity::Note);
    assert!(!report.is_usable());
    assert_eq!(report.images, 23 - 3);
    assert!(!root.join("splits.json").exists(), "checking writes nothing");
}

#[test]
fn black_test_images_are_explained_and_other_black_images_are_errors() {
    let folder = Rig { views: 10, lights: 8, width: 6, height: 4 }.write();
    let scene = Scene::open(folder.path()).unwrap();
    let splits = Splits::of(&scene).unwrap();
    let black = Image { width: 6, height: 4, data: vec![0; 72] };
    for &frame in splits.easy.iter().chain(&splits.hard) {
        black.write_png(&scene.frames[frame].path).unwrap();
    }
    let report = check(folder.path(), &|_, _| {});
    assert!(report.is_usable());
    let [note] = &report.faults[..] else { panic!("{:?}", report.faults) };
    assert_eq!((note.severity, note.kind), (Severity::Note, FaultKind::Black));
    assert!(note.problem.contains("8 of 8") && note.mend.contains("not corruption"), "{note}");
    assert_eq!(SceneInfo::of(&scene).unwrap().black_test_images, 8);

    let path = &scene.frames[splits.train[5]].path;
    black.write_png(path).unwrap();
    let report = check(folder.path(), &|_, _| {});
    assert_eq!(report.count(Severity::Error), 1);
    assert!(report.faults.iter().any(|fault| fault.severity == Severity::Error && fault.path == *path));
}

#[test]
fn gaps_in_the_numbering_are_warned_of() {
    let folder = SMALL.write();
    fs::remove_dir_all(lset(folder.path(), 1)).unwrap();
    for light in [0, 2, 3] {
        fs::remove_file(image_path(folder.path(), light, 2)).unwrap();
        fs::remove_file(pose_path(folder.path(), light, 2)).unwrap();
    }
    let report = check(folder.path(), &|_, _| {});
    let problems: Vec<&str> = report.faults.iter().map(|fault| fault.problem.as_str()).collect();
    let gap =
        |what, last, first| format!("1 of the {what} 0 to {last} are missing, the first of them {first}");
    assert_eq!(problems, [gap("lights", 3, 1), gap("views", 5, 2)]);
    assert!(report.is_usable());
}

#[test]
fn poses_that_differ_a_little_are_noted() {
    let folder = SMALL.write();
    let mut moved = SMALL.camera(2);
    moved.0[1][3] += 2e-5;
    replace(&pose_path(folder.path(), 3, 2), matrix_text(&moved));
    let report = check(folder.path(), &|_, _| {});
    let [note] = &report.faults[..] else { panic!("{:?}", report.faults) };
    assert_eq!((note.severity, note.kind), (Severity::Note, FaultKind::Inconsistent));
}

#[test]
fn odd_lenses_are_warned_of() {
    for (text, says) in [
        (SMALL.camera_yml("[-30.0, 0, 0, 0]"), "undone"),
        (SMALL.camera_yml("[]").replace("- 7.199999999999999", "- 72.0"), "principal point"),
    ] {
        let folder = SMALL.write();
        for light in 0..SMALL.lights {
            replace(&lset(folder.path(), light).join("camera.yml"), &text);
        }
        let report = check(folder.path(), &|_, _| {});
        let warned =
            report.faults.iter().any(|f| f.severity == Severity::Warning && f.problem.contains(says));
        assert!(warned, "{says}: {:?}", report.faults);
    }
}

#[test]
fn a_summary_says_what_is_there() {
    let folder = Rig { views: 10, lights: 8, width: 6, height: 4 }.write();
    let info = SceneInfo::of(&Scene::open(folder.path()).unwrap()).unwrap();
    assert_eq!((info.views, info.lights, info.images, info.size, info.same_size), (10, 8, 80, [6, 4], true));
    assert_eq!((info.splits.train, info.splits.val, info.splits.easy, info.splits.hard), (56, 3, 7, 1));
    assert_eq!((info.black_test_images, info.training_bytes, info.distorted), (0, 56 * 72, false));
    let json: serde_json::Value = serde_json::to_value(&info).unwrap();
    assert_eq!((&json["layout"], &json["splits"]["train"]), (&"rene".into(), &56.into()));
    assert!(json["bounds"]["lo"].is_array());
}
