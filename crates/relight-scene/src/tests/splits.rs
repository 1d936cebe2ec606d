use std::collections::HashSet;
use std::fs;
use std::path::PathBuf;

use tempfile::TempDir;

use super::{Rig, SMALL, fault, image_path, replace};
use crate::{FaultKind, Frame, Image, Scene, Severity, Split, Splits, check};

fn pairs(scene: &Scene, frames: &[usize]) -> Vec<(usize, usize)> {
    frames.iter().map(|&frame| (scene.frames[frame].camera, scene.frames[frame].light)).collect()
}

#[test]
fn official_scenes_have_the_published_splits() {
    let folder = TempDir::new().unwrap();
    let scene = Rig { views: 50, lights: 40, ..SMALL }.scene(folder.path());
    let splits = Splits::of(&scene).unwrap();
    let counts = [Split::Train, Split::Val, Split::Easy, Split::Hard].map(|split| splits.get(split).len());
    assert_eq!(counts, [1628, 9, 111, 9]);
    let mut val = pairs(&scene, &splits.val);
    val.sort();
    let published = [(25, 10), (25, 12), (25, 27), (42, 3), (42, 20), (42, 23), (47, 26), (47, 30), (47, 39)];
    assert_eq!(val, published);
    let (test_cameras, test_lights) = ([4, 8, 15], [2, 21, 34]);
    for (camera, light) in pairs(&scene, &splits.train) {
        assert!(
            !test_cameras.contains(&camera)
                && ![25, 42, 47].contains(&camera)
                && !test_lights.contains(&light)
        );
    }
    assert!(
        pairs(&scene, &splits.easy).iter().all(|(c, l)| test_cameras.contains(c) && !test_lights.contains(l))
    );
    assert!(
        pairs(&scene, &splits.hard).iter().all(|(c, l)| test_cameras.contains(c) && test_lights.contains(l))
    );
    assert!(!folder.path().join("splits.json").exists());
}

/// Leaves out what was not fetched.
fn without(mut scene: Scene, is_absent: impl Fn(usize, usize) -> bool) -> Scene {
    let labels = |frame: &Frame| (scene.cameras[frame.camera].label, scene.lights[frame.light].label);
    let kept: Vec<(usize, usize, PathBuf)> = scene
        .frames
        .iter()
        .map(|f| (labels(f), f.path.clone()))
        .filter(|((camera, light), _)| !is_absent(*camera, *light))
        .map(|((camera, light), path)| (camera, light, path))
        .collect();
    scene.cameras.retain(|camera| kept.iter().any(|&(label, ..)| label == camera.label));
    scene.lights.retain(|light| kept.iter().any(|&(_, label, _)| label == light.label));
    let camera = |label| scene.cameras.iter().position(|camera| camera.label == label).unwrap();
    let light = |label| scene.lights.iter().position(|light| light.label == label).unwrap();
    scene.frames =
        kept.into_iter().map(|(c, l, path)| Frame { camera: camera(c), light: light(l), path }).collect();
    scene
}

fn labels(scene: &Scene, frames: &[usize]) -> Vec<(usize, usize)> {
    let label = |(camera, light): (usize, usize)| (scene.cameras[camera].label, scene.lights[light].label);
    pairs(scene, frames).into_iter().map(label).collect()
}

#[test]
fn official_scenes_not_fetched_whole_keep_the_published_splits() {
    let folder = TempDir::new().unwrap();
    let whole = Rig { views: 50, lights: 40, ..SMALL }.scene(folder.path());
    let published = Splits::of(&whole).unwrap();
    type Absent = fn(usize, usize) -> bool;
    let absences: [Absent; 6] = [
        |_, light| light == 39,
        |_, light| light == 7,
        |_, light| light == 2,
        |camera, _| camera == 4 || camera == 20,
        |camera, light| camera >= 45 || light >= 30,
        |camera, light| camera == 30 && light == 3,
    ];
    for is_absent in absences {
        let scene = without(whole.clone(), is_absent);
        let splits = Splits::of(&scene).unwrap();
        for split in [Split::Train, Split::Val, Split::Easy, Split::Hard] {
            let mut expected = labels(&whole, published.get(split));
            expected.retain(|&(camera, light)| !is_absent(camera, light));
            assert_eq!(labels(&scene, splits.get(split)), expected);
        }
        assert!(!folder.path().join("splits.json").exists());
    }
    let no_validation = without(whole, |camera, _| [25, 42, 47].contains(&camera));
    let splits = Splits::of(&no_validation).unwrap();
    assert_eq!((splits.val.len(), splits.easy.len(), splits.hard.len()), (9, 111, 9));
}

#[test]
fn a_small_part_of_an_official_scene_is_known_by_its_black_test() {
    let rig = Rig { views: 10, lights: 4, ..SMALL };
    let folder = rig.write();
    let scene = Scene::open(folder.path()).unwrap();
    let own = Splits::peek(&scene).unwrap();
    let black = Image { data: vec![0; 3 * 12 * 9], ..rig.image(0, 0) };
    for light in 0..4 {
        black.write_png(&image_path(folder.path(), light, 4)).unwrap();
    }
    assert_eq!(Splits::peek(&scene).unwrap(), own, "view 8 is not black");
    for light in 0..4 {
        black.write_png(&image_path(folder.path(), light, 8)).unwrap();
    }
    let splits = Splits::of(&scene).unwrap();
    assert!(pairs(&scene, &splits.easy).iter().all(|&(c, l)| [4, 8].contains(&c) && l != 2));
    assert_eq!(pairs(&scene, &splits.hard), [(4, 2), (8, 2)]);
    assert_eq!((splits.easy.len(), splits.train.len() + splits.val.len()), (6, 8 * 3));
    assert!(!folder.path().join("splits.json").exists());
}

#[test]
fn other_scenes_have_drawn_splits_that_stay() {
    let folder = TempDir::new().unwrap();
    let scene = Rig { views: 10, lights: 8, ..SMALL }.scene(folder.path());
    let drawn = Splits::peek(&scene).unwrap();
    assert!(!folder.path().join("splits.json").exists(), "peeking writes nothing");
    let splits = Splits::of(&scene).unwrap();
    assert_eq!(splits, drawn);
    // One test camera, one validation camera, one test light.
    assert_eq!(
        [splits.train.len(), splits.val.len(), splits.easy.len(), splits.hard.len()],
        [8 * 7, 3, 7, 1]
    );
    let cameras =
        |frames: &[usize]| pairs(&scene, frames).into_iter().map(|(c, _)| c).collect::<HashSet<_>>();
    assert!(cameras(&splits.train).is_disjoint(&cameras(&splits.easy)));
    assert!(cameras(&splits.train).is_disjoint(&cameras(&splits.val)));
    assert_eq!(cameras(&splits.hard), cameras(&splits.easy));
    assert!(folder.path().join("splits.json").exists());
    assert_eq!(Splits::of(&scene).unwrap(), splits);
    // What the file says counts, not what would be drawn.
    let text = r#"{"format": "relight-splits", "version": 1, "train": [[0, 1], [2, 3]], "val": [[1, 1]], "easy": [], "hard": []}"#;
    fs::write(folder.path().join("splits.json"), text).unwrap();
    let edited = Splits::of(&scene).unwrap();
    assert_eq!(pairs(&scene, &edited.train), [(0, 1), (2, 3)]);
    assert_eq!(pairs(&scene, &edited.val), [(1, 1)]);
}

#[test]
fn small_captures_keep_enough_to_train_on() {
    for views in 1..8 {
        for lights in 1..8 {
            let folder = TempDir::new().unwrap();
            let scene = Rig { views, lights, ..SMALL }.scene(folder.path());
            let splits = Splits::of(&scene).unwrap();
            assert!(!splits.train.is_empty(), "{views} x {lights}");
            assert_eq!(splits.easy.is_empty(), views == 1, "{views} x {lights}");
            assert!(2 * splits.train.len() >= views * lights - views.max(lights), "{views} x {lights}");
            assert_eq!(
                splits.val.is_empty(),
                splits.val.len() + splits.train.len() == 1,
                "{views} x {lights}"
            );
            let all = [&splits.train, &splits.val, &splits.easy, &splits.hard];
            let distinct: HashSet<_> = all.iter().flat_map(|split| split.iter()).collect();
            assert_eq!(
                distinct.len(),
                all.iter().map(|split| split.len()).sum::<usize>(),
                "no frame is in two splits"
            );
        }
    }
}

#[test]
fn unknown_and_broken_split_files_are_refused_by_name() {
    let folder = TempDir::new().unwrap();
    let scene = SMALL.scene(folder.path());
    let path = folder.path().join("splits.json");
    let good =
        r#"{"format": "relight-splits", "version": 1, "train": [[0, 0]], "val": [], "easy": [], "hard": []}"#;
    for (text, kind) in [
        (good.replace("1,", "2,"), FaultKind::Version),
        (good.replace("relight-splits", "other"), FaultKind::Version),
        (good.replace("[[0, 0]]", "[[0, 99]]"), FaultKind::Inconsistent),
        (good.replace("[[0, 0]]", "[[0, 0], [0, 0]]"), FaultKind::Inconsistent),
        (good.replace("[[0, 0]]", "7"), FaultKind::Malformed),
        ("[".repeat(100_000), FaultKind::Malformed),
    ] {
        replace(&path, text);
        let fault = fault(Splits::of(&scene));
        assert_eq!((fault.kind, &fault.path), (kind, &path));
        assert!(fault.mend.contains("emove"));
    }
}

#[test]
fn images_that_came_later_are_told_of() {
    let folder = TempDir::new().unwrap();
    let small = Rig { views: 10, lights: 7, ..SMALL };
    small.write_to(folder.path());
    let told = || {
        let faults = check(folder.path(), &|_, _| {}).faults;
        faults.into_iter().find(|fault| fault.problem.contains("stand in no split"))
    };
    assert_eq!(told(), None, "nothing is drawn yet");
    Splits::of(&Scene::open(folder.path()).unwrap()).unwrap();
    assert_eq!(told(), None);
    Rig { lights: 8, ..small }.write_to(folder.path());
    let fault = told().unwrap();
    assert_eq!((fault.severity, &fault.path), (Severity::Warning, &folder.path().join("splits.json")));
    assert!(fault.problem.starts_with("10 images") && fault.mend.contains("Remove"), "{fault}");
}

#[test]
fn splits_that_leave_nothing_to_train_on_are_refused() {
    let folder = SMALL.write();
    let scene = Scene::open(folder.path()).unwrap();
    let path = folder.path().join("splits.json");
    let text =
        r#"{"format": "relight-splits", "version": 1, "train": [], "val": [[0, 0]], "easy": [], "hard": []}"#;
    replace(&path, text);
    let named = fault(Splits::of(&scene));
    assert_eq!((named.kind, &named.path), (FaultKind::Split, &path));
    assert!(named.mend.contains("Remove"), "{named}");
    assert!(check(folder.path(), &|_, _| {}).faults.contains(&named));
}

#[test]
fn splits_need_no_writable_folder() {
    let file = tempfile::NamedTempFile::new().unwrap();
    let folder = TempDir::new().unwrap();
    let mut scene = SMALL.scene(folder.path());
    let splits = Splits::of(&scene).unwrap();
    // Not even a folder: nothing can be written there.
    scene.root = file.path().to_owned();
    assert_eq!(Splits::of(&scene).unwrap(), splits);
}

#[test]
fn splits_have_names() {
    for split in [Split::Train, Split::Val, Split::Easy, Split::Hard] {
        assert_eq!(split.to_string().parse::<Split>().unwrap(), split);
    }
    assert!("test".parse::<Split>().unwrap_err().to_string().contains("train, val, easy and hard"));
}
