//! Folders that no capture ever made: every one must be refused, or read, without a panic, a hang or much memory.

use std::fs;
use std::ops::ControlFlow;
use std::path::Path;

use proptest::prelude::*;
use tempfile::TempDir;

use super::{Rig, SMALL, fault, image_path, lset, matrix_text, pose_path, replace};
use crate::pixel_store::Limits;
use crate::{
    FaultKind, PixelStore, Pose, Scene, SceneInfo, Severity, Splits, check, contact_sheet, read_text,
    scene_bounds,
};

/// Does to a folder all that the crate can do.
fn try_all(path: &Path) {
    let report = check(path, &|_, _| {});
    let Ok(scene) = Scene::open(path) else {
        assert!(!report.is_usable());
        return;
    };
    assert!(scene_bounds(&scene).lo.iter().chain(&scene_bounds(&scene).hi).all(|v| v.is_finite()));
    let _ = SceneInfo::of(&scene);
    let _ = contact_sheet(&scene);
    if let Ok(splits) = Splits::of(&scene) {
        let _ = PixelStore::load_by(
            &scene,
            &splits.train,
            &|_, _| ControlFlow::Continue(()),
            None,
            &Limits::USUAL,
        );
    }
}

#[test]
fn empty_and_absent_folders() {
    let folder = TempDir::new().unwrap();
    assert_eq!(fault(Scene::open(folder.path())).kind, FaultKind::Missing);
    assert_eq!(fault(Scene::open(&folder.path().join("none"))).kind, FaultKind::Missing);
    fs::write(folder.path().join("file"), "").unwrap();
    fault(Scene::open(&folder.path().join("file")));
    fs::create_dir(folder.path().join("lset000")).unwrap();
    fault(Scene::open(folder.path()));
    try_all(folder.path());
}

#[test]
fn one_camera_and_one_light() {
    for (views, lights) in [(1, 1), (1, 5), (5, 1), (2, 2)] {
        let folder = Rig { views, lights, ..SMALL }.write();
        assert!(check(folder.path(), &|_, _| {}).is_usable());
        try_all(folder.path());
        assert!(contact_sheet(&Scene::open(folder.path()).unwrap()).is_ok());
    }
}

#[test]
fn text_files_of_garbage() {
    let garbage: [&[u8]; 8] = [
        b"",
        b"\0\0\0\0",
        b"\xff\xfe\xfd",
        b"nan nan nan nan nan nan nan nan nan nan nan nan nan nan nan nan",
        b"1e308 0 0 1e308 0 1e308 0 0 0 0 1e308 0 0 0 0 1",
        b"inf 0 0 0 0 1 0 0 0 0 1 0 0 0 0 1",
        b"{[}]:\n\t- &a *a",
        b"1e999999999999999999999999999999999999999999999999",
    ];
    for bytes in garbage {
        for name in ["light.txt", "camera.yml", "data/00002_pose.txt"] {
            let folder = SMALL.write();
            let path = lset(folder.path(), 1).join(name);
            replace(&path, bytes);
            assert_eq!(fault(Scene::open(folder.path())).path, path);
            try_all(folder.path());
        }
    }
}

#[test]
fn text_files_without_end() {
    let folder = SMALL.write();
    let path = lset(folder.path(), 1).join("light.txt");
    replace(&path, "1 ".repeat(1 << 20));
    assert_eq!(fault(Scene::open(folder.path())).path, path);
}

#[test]
fn only_short_regular_files_are_read_as_text() {
    let folder = TempDir::new().unwrap();
    let path = folder.path().join("text");
    fs::write(&path, "twelve bytes").unwrap();
    assert_eq!(read_text(&path, 12).unwrap(), "twelve bytes");
    let refused = |path: &Path, kind, says: &str| {
        let fault = fault(read_text(path, 11));
        assert_eq!((fault.kind, fault.path.as_path()), (kind, path));
        assert!(fault.problem.contains(says) && !fault.mend.is_empty(), "{fault}");
    };
    refused(&path, FaultKind::Malformed, "longer than the 11 bytes");
    replace(&path, b"\xff\xfe");
    refused(&path, FaultKind::Malformed, "not text");
    refused(folder.path(), FaultKind::Unreadable, "not a file");
    refused(&folder.path().join("none"), FaultKind::Missing, "cannot be read");
    #[cfg(unix)]
    {
        refused(Path::new("/dev/zero"), FaultKind::Unreadable, "not a file");
        let pipe = folder.path().join("pipe");
        let made = std::process::Command::new("mkfifo").arg(&pipe).status();
        if made.is_ok_and(|status| status.success()) {
            refused(&pipe, FaultKind::Unreadable, "not a file");
        }
    }
}

#[test]
fn transforms_files_of_great_length_are_refused_unread() {
    let folder = TempDir::new().unwrap();
    let path = folder.path().join("transforms.json");
    fs::File::create(&path).unwrap().set_len((1 << 26) + 1).unwrap();
    let fault = fault(Scene::open(folder.path()));
    assert!(fault.path == path && fault.problem.contains("longer than"), "{fault}");
}

#[test]
fn numbers_without_measure() {
    let folder = SMALL.write();
    for name in ["lset99999999999999999999999999", "lset", "lset-1", "lset 4", "lset٣"] {
        fs::create_dir(folder.path().join(name)).unwrap();
    }
    let data = lset(folder.path(), 0).join("data");
    for name in
        ["99999999999999999999999999_image.png", "_image.png", "-1_pose.txt", "00001_image", "00001_pose.png"]
    {
        fs::write(data.join(name), "").unwrap();
    }
    assert_eq!(Scene::open(folder.path()).unwrap().frames.len(), 24, "what is no number names nothing");
    let big = usize::MAX;
    for light in 0..SMALL.lights {
        fs::rename(image_path(folder.path(), light, 0), image_path(folder.path(), light, big)).unwrap();
        fs::rename(pose_path(folder.path(), light, 0), pose_path(folder.path(), light, big)).unwrap();
    }
    assert_eq!(Scene::open(folder.path()).unwrap().cameras[5].label, big);
    try_all(folder.path());
}

#[cfg(unix)]
#[test]
fn links_pipes_and_devices() {
    use std::os::unix::fs::symlink;
    let folder = SMALL.write();
    let data = lset(folder.path(), 1).join("data");
    symlink(folder.path(), data.join("loop")).unwrap();
    symlink("self", folder.path().join("self")).unwrap();
    assert!(Scene::open(folder.path()).is_ok());
    for target in ["/dev/zero", "00003_image.png", "nowhere"] {
        let path = data.join("00003_image.png");
        fs::remove_file(&path).unwrap();
        symlink(target, &path).unwrap();
        let scene = Scene::open(folder.path()).unwrap();
        assert_eq!(fault(scene.read_frame(scene.frame(3, 1).unwrap())).path, path);
        try_all(folder.path());
    }
    let pose = data.join("00002_pose.txt");
    fs::remove_file(&pose).unwrap();
    let made = std::process::Command::new("mkfifo").arg(&pose).status();
    if made.is_ok_and(|status| status.success()) {
        assert_eq!(fault(Scene::open(folder.path())).path, pose);
        try_all(folder.path());
    }
    let looped = TempDir::new().unwrap();
    symlink("lset000", looped.path().join("lset000")).unwrap();
    assert_eq!(fault(Scene::open(looped.path())).kind, FaultKind::Unreadable);
}

#[test]
fn thousands_of_lights() {
    let folder = Rig { views: 1, lights: 1, ..SMALL }.write();
    for light in 1..1200 {
        fs::create_dir(lset(folder.path(), light)).unwrap();
    }
    let report = check(folder.path(), &|_, _| {});
    assert!(report.count(Severity::Error) >= 1199);
    try_all(folder.path());
}

#[test]
fn poses_all_in_one_place_or_far_away() {
    for pose in [Pose::IDENTITY, Pose([[1.0, 0.0, 0.0, 9e5], [0.0, 1.0, 0.0, -9e5], [0.0, 0.0, 1.0, 9e5]])] {
        let folder = SMALL.write();
        for light in 0..SMALL.lights {
            replace(&lset(folder.path(), light).join("light.txt"), matrix_text(&pose));
            for view in 0..SMALL.views {
                replace(&pose_path(folder.path(), light, view), matrix_text(&pose));
            }
        }
        try_all(folder.path());
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(40))]

    #[test]
    fn any_bytes_in_any_file(bytes in prop::collection::vec(any::<u8>(), 0..200), which in 0usize..5) {
        let rig = Rig { views: 3, lights: 2, width: 4, height: 3 };
        let folder = rig.write();
        let path = match which {
            0 => lset(folder.path(), 1).join("light.txt"),
            1 => lset(folder.path(), 0).join("camera.yml"),
            2 => pose_path(folder.path(), 1, 1),
            3 => image_path(folder.path(), 0, 2),
            _ => folder.path().join("splits.json"),
        };
        replace(&path, &bytes);
        try_all(folder.path());
    }

    #[test]
    fn any_poses(angles in prop::collection::vec(-7.0..7.0f64, 12), places in prop::collection::vec(-1e3..1e3f64, 12)) {
        let rig = Rig { views: 4, lights: 2, width: 4, height: 3 };
        let folder = rig.write();
        for view in 0..4 {
            let (position, towards) = (&places[3 * view..3 * view + 3], &angles[3 * view..3 * view + 3]);
            let position = [position[0], position[1], position[2]];
            let target = [0, 1, 2].map(|i| position[i] + towards[i]);
            for light in 0..2 {
                replace(&pose_path(folder.path(), light, view), matrix_text(&Pose::look_at(position, target)));
            }
        }
        try_all(folder.path());
    }
}
