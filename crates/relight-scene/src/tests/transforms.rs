use std::fs;
use std::path::Path;

use serde_json::{Value, json};
use tempfile::TempDir;

use super::{Rig, fault, from_angles, mended, rows};
use crate::vector::{angle, norm, sub};
use crate::{FaultKind, Layout, Pose, Scene, Severity, Split, Splits, check, contact_sheet, scene_bounds};

const SIZE: Rig = Rig { views: 1, lights: 1, width: 16, height: 10 };

/// Cameras and lights of Blender's size: 4 m from the object, all around above it; each frame has its own light.
fn camera(index: usize) -> Pose {
    let share = index as f64 * 0.618_034;
    Pose::look_at(
        from_angles(4.0, std::f64::consts::TAU * share.fract(), 0.2 + 1.2 * (share * 2.7).fract()),
        [0.0; 3],
    )
}

fn light(index: usize) -> [f64; 3] {
    from_angles(5.0, 1.1 * index as f64, 0.4 + 0.1 * (index % 9) as f64)
}

fn frame(index: usize, file_path: &str) -> Value {
    json!({
        "file_path": file_path,
        "transform_matrix": rows(&camera(index).flip_camera_axes()),
        "pl_pos": light(index),
    })
}

fn write_images(root: &Path, folder: &str, count: usize) -> Vec<String> {
    fs::create_dir_all(root.join(folder)).unwrap();
    let write = |index| {
        SIZE.image(index, index).write_png(&root.join(folder).join(format!("r_{index}.png"))).unwrap();
        format!("./{folder}/r_{index}")
    };
    (0..count).map(write).collect()
}

fn blender(count: usize) -> (TempDir, Value) {
    let root = TempDir::new().unwrap();
    let names = write_images(root.path(), "train", count);
    let frames: Vec<Value> = names.iter().enumerate().map(|(index, name)| frame(index, name)).collect();
    (root, json!({"camera_angle_x": 0.6911, "frames": frames}))
}

fn open(root: &TempDir, file: &Value) -> Result<Scene, crate::SceneError> {
    fs::write(root.path().join("transforms.json"), file.to_string()).unwrap();
    Scene::open(root.path())
}

#[test]
fn blender_captures_are_read() {
    let (root, file) = blender(7);
    let scene = open(&root, &file).unwrap();
    assert_eq!((scene.layout, scene.declared.clone()), (Layout::Transforms, None));
    assert_eq!((scene.cameras.len(), scene.lights.len(), scene.frames.len()), (7, 7, 7));
    let lens = &scene.cameras[0].intrinsics;
    assert_eq!((lens.width, lens.height, lens.distortion.len()), (16, 10, 0));
    assert!((lens.fx - 8.0 / (0.6911f64 / 2.0).tan()).abs() < 1e-9 && lens.fx == lens.fy);
    assert_eq!((lens.cx, lens.cy), (7.5, 4.5), "the middle, counted from the first pixel's centre");
    for (index, frame) in scene.frames.iter().enumerate() {
        assert_eq!((frame.camera, frame.light), (index, index));
        let (read, meant) = (scene.cameras[index].pose, camera(index));
        assert!(read.0.iter().flatten().zip(meant.0.iter().flatten()).all(|(a, b)| (a - b).abs() < 1e-12));
        let pose = scene.lights[index].pose;
        assert!(norm(sub(pose.position(), light(index))) < 1e-12);
        assert!(angle(pose.axis(2), sub([0.0; 3], light(index))) < 1e-3, "lights look at the focus");
        assert_eq!(scene.read_frame(index).unwrap(), SIZE.image(index, index));
    }
}

#[test]
fn the_file_itself_may_be_named() {
    let (root, file) = blender(3);
    fs::write(root.path().join("other.json"), file.to_string()).unwrap();
    assert_eq!(Scene::open(&root.path().join("other.json")).unwrap().frames.len(), 3);
}

#[test]
fn nerfstudio_lenses_are_read_and_frames_may_have_their_own() {
    let (root, mut file) = blender(4);
    file["camera_model"] = json!("OPENCV");
    for (key, value) in [
        ("fl_x", 20.0),
        ("fl_y", 21.0),
        ("cx", 8.25),
        ("cy", 5.5),
        ("w", 16.0),
        ("h", 10.0),
        ("k1", 0.1),
        ("k2", -0.02),
        ("p1", 0.001),
        ("p2", 0.002),
    ] {
        file[key] = json!(value);
    }
    file["frames"][1]["fl_x"] = json!(30.0);
    file["frames"][2]["camera_intrinsics"] = json!([7.0, 6.0, 31.0, 32.0]);
    file["frames"][3]["w"] = json!(16);
    let scene = open(&root, &file).unwrap();
    let lens = |index: usize| &scene.cameras[index].intrinsics;
    assert_eq!((lens(0).fx, lens(0).fy, lens(0).cx, lens(0).cy), (20.0, 21.0, 7.75, 5.0));
    assert_eq!(lens(0).distortion, [0.1, -0.02, 0.001, 0.002, 0.0]);
    assert_eq!((lens(1).fx, lens(1).fy, lens(1).cx), (30.0, 30.0, 7.75));
    assert_eq!((lens(2).fx, lens(2).fy, lens(2).cx, lens(2).cy), (31.0, 32.0, 6.5, 5.5));
    assert_eq!(lens(3), lens(0));
}

#[test]
fn equal_cameras_and_lights_are_one() {
    let (root, mut file) = blender(6);
    for index in 0..6 {
        let (view, lamp) = (index / 3, index % 3);
        let path = file["frames"][index]["file_path"].clone();
        file["frames"][index] = frame(view, path.as_str().unwrap());
        file["frames"][index]["pl_pos"] = json!(light(lamp));
    }
    let scene = open(&root, &file).unwrap();
    assert_eq!((scene.cameras.len(), scene.lights.len(), scene.frames.len()), (2, 3, 6));
    assert_eq!(scene.frame(1, 2), Some(5));
    file["frames"][5] = file["frames"][0].clone();
    assert_eq!(open(&root, &file).unwrap().frames.len(), 5, "a frame that is there twice is left out once");
}

#[test]
fn pairs_of_files_declare_the_splits() {
    let (root, mut file) = blender(30);
    let test = write_images(root.path(), "test", 5);
    fs::write(root.path().join("transforms_train.json"), file.to_string()).unwrap();
    let scene = Scene::open(root.path()).unwrap();
    assert_eq!(scene.declared, None, "without a test file the splits are drawn");
    file["frames"] = test.iter().enumerate().map(|(index, name)| frame(40 + index, name)).collect();
    fs::write(root.path().join("transforms_test.json"), file.to_string()).unwrap();
    let scene = Scene::open(root.path()).unwrap();
    let splits = Splits::of(&scene).unwrap();
    assert_eq!(splits.hard, [30, 31, 32, 33, 34], "under lights that training does not see");
    assert_eq!((splits.train.len(), splits.val.len(), splits.easy.len()), (28, 2, 0));
    assert!(splits.val.iter().all(|&frame| frame < 30));
    assert!(!root.path().join("splits.json").exists());

    for index in [1, 3] {
        let seen = splits.train[index];
        file["frames"][index]["pl_pos"] = json!(scene.lights[scene.frames[seen].light].pose.position());
    }
    fs::write(root.path().join("transforms_test.json"), file.to_string()).unwrap();
    let splits = Splits::of(&Scene::open(root.path()).unwrap()).unwrap();
    assert_eq!((&splits.easy[..], &splits.hard[..]), (&[31, 33][..], &[30, 32, 34][..]));

    fs::remove_file(root.path().join("transforms_train.json")).unwrap();
    let fault = fault(Splits::of(&Scene::open(root.path()).unwrap()));
    assert!(fault.kind == FaultKind::Split && fault.mend.contains("transforms_train.json"), "{fault}");
}

#[test]
fn rounding_makes_no_new_cameras_or_lights() {
    let (root, mut file) = blender(24);
    for index in 0..24 {
        let (view, lamp) = (index / 4, index % 4);
        let noise = |k: usize| 2e-5 * ((index * 7 + k * 5) % 9) as f64 / 9.0;
        let path = file["frames"][index]["file_path"].clone();
        let mut pose = camera(view).flip_camera_axes();
        pose.0.iter_mut().flatten().enumerate().for_each(|(k, entry)| *entry += noise(k));
        file["frames"][index] = frame(view, path.as_str().unwrap());
        file["frames"][index]["transform_matrix"] = json!(rows(&pose));
        let position = light(lamp);
        file["frames"][index]["pl_pos"] = json!([0, 1, 2].map(|k| position[k] + noise(k + 12)));
    }
    let scene = open(&root, &file).unwrap();
    assert_eq!((scene.cameras.len(), scene.lights.len(), scene.frames.len()), (6, 4, 24));
    assert_eq!(scene.frame(5, 3), Some(23));
    let report = check(root.path(), &|_, _| {});
    let [note] = &report.faults[..] else { panic!("{:?}", report.faults) };
    assert!(note.severity == Severity::Note && note.problem.contains("by rounding"), "{note}");
    // Two that lie on both sides of a border between cells, or of several, are one as well.
    for (index, x) in [0.002, 0.002 - 4e-5, -0.001, -0.001 + 4e-5].into_iter().enumerate() {
        file["frames"][4 * index]["pl_pos"] = json!([x, -x, 5.0 + x]);
    }
    let scene = open(&root, &file).unwrap();
    let of_frames: Vec<usize> = (0..4).map(|view| scene.frames[4 * view].light).collect();
    assert!(of_frames[0] == of_frames[1] && of_frames[2] == of_frames[3] && of_frames[1] != of_frames[2]);
    // Focal lengths are rounded too.
    for index in 0..24 {
        file["frames"][index]["fl_x"] = json!(20.0 + 1e-7 * index as f64);
    }
    assert_eq!(open(&root, &file).unwrap().cameras.len(), 6);
    // What differs by more is another.
    file["frames"][23]["transform_matrix"][0][3] = json!(camera(5).position()[0] + 1e-3);
    assert_eq!(open(&root, &file).unwrap().cameras.len(), 7);
}

#[test]
fn odd_lenses_are_warned_of_once() {
    for (key, value, says) in [("k1", -5.0, "undone"), ("cx", 80.0, "principal point")] {
        let (root, mut file) = blender(5);
        for index in 1..5 {
            file["frames"][index][key] = json!(value + 0.1 * index as f64);
        }
        open(&root, &file).unwrap();
        let report = check(root.path(), &|_, _| {});
        let warned = report.faults.iter().filter(|fault| fault.kind == FaultKind::Lens);
        let [warning] = &warned.collect::<Vec<_>>()[..] else { panic!("{:?}", report.faults) };
        assert!(warning.problem.contains(says) && warning.problem.contains("train/r_1"), "{warning}");
        assert!(warning.problem.contains("3 more"), "{warning}");
    }
}

#[test]
fn splits_that_were_drawn_do_not_come_to_mean_other_images() {
    let (root, mut file) = blender(12);
    let scene = open(&root, &file).unwrap();
    let splits = Splits::of(&scene).unwrap();
    assert_eq!(Splits::of(&open(&root, &file).unwrap()).unwrap(), splits);
    let names = |scene: &Scene, frames: &[usize]| {
        let mut names: Vec<_> = frames.iter().map(|&frame| scene.frames[frame].path.clone()).collect();
        names.sort();
        names
    };
    file["frames"].as_array_mut().unwrap().reverse();
    let reordered = open(&root, &file).unwrap();
    let of_it = Splits::of(&reordered).unwrap();
    assert_ne!(of_it.hard, splits.hard, "other frames by number");
    for split in [Split::Train, Split::Val, Split::Easy, Split::Hard] {
        assert_eq!(names(&reordered, of_it.get(split)), names(&scene, splits.get(split)));
    }
    let lost = splits.hard[0];
    file["frames"].as_array_mut().unwrap().remove(11 - lost);
    let fault = fault(Splits::of(&open(&root, &file).unwrap()));
    assert_eq!((fault.kind, &fault.path), (FaultKind::Inconsistent, &root.path().join("splits.json")));
    assert!(
        fault.problem.contains(&format!("train/r_{lost}.png")) && fault.mend.contains("Remove"),
        "{fault}"
    );
}

#[test]
fn a_light_a_frame_is_split_by_frames() {
    let (root, file) = blender(40);
    let scene = open(&root, &file).unwrap();
    let splits = Splits::of(&scene).unwrap();
    assert_eq!((splits.train.len(), splits.val.len(), splits.easy.len(), splits.hard.len()), (36, 2, 0, 2));
    assert_eq!(Splits::of(&scene).unwrap(), splits, "as written to the file");
    let sheet = contact_sheet(&scene).unwrap();
    assert!(sheet.data.chunks_exact(3).any(|pixel| pixel == [255, 80, 80]), "test cameras are red");
}

#[test]
fn faults_name_the_frame() {
    let (root, good) = blender(4);
    let with = |change: &dyn Fn(&mut Value)| {
        let mut file = good.clone();
        change(&mut file);
        let fault = fault(open(&root, &file));
        assert!(!fault.mend.is_empty());
        (fault.kind, fault.to_string())
    };
    let (kind, says) = with(&|file| file["frames"][2]["pl_pos"] = Value::Null);
    assert!(kind == FaultKind::Missing && says.contains("r_2") && says.contains("pl_pos"), "{says}");
    let (kind, says) = with(&|file| file["frames"][1]["file_path"] = json!("train/none"));
    assert!(kind == FaultKind::Missing && says.contains("train/none"), "{says}");
    let (_, says) = with(&|file| file["frames"][1]["file_path"] = json!("ä".repeat(1 << 20)));
    assert!(says.len() < 2000 && says.contains("ä […] ä") && says.contains("is missing"), "{says}");
    let (kind, _) =
        with(&|file| file["frames"][1]["transform_matrix"] = json!([[1, 0, 0], [0, 1, 0], [0, 0, 1]]));
    assert_eq!(kind, FaultKind::Malformed);
    let (kind, _) = with(&|file| file["frames"][1]["transform_matrix"][0][0] = json!(5.0));
    assert_eq!(kind, FaultKind::Pose);
    let (kind, _) = with(&|file| file["frames"][0]["pl_pos"] = json!([1e9, 0, 0]));
    assert_eq!(kind, FaultKind::Malformed);
    let (kind, _) = with(&|file| file["camera_angle_x"] = json!(7.0));
    assert_eq!(kind, FaultKind::Lens);
    let (kind, _) = with(&|file| file["camera_model"] = json!("OPENCV_FISHEYE"));
    assert_eq!(kind, FaultKind::Lens);
    let (kind, _) = with(&|file| (file["w"], file["h"]) = (json!(60_000), json!(10)));
    assert_eq!(kind, FaultKind::Lens);
    let (kind, _) = with(&|file| file["frames"] = json!([]));
    assert_eq!(kind, FaultKind::Missing);
    let (kind, _) = with(&|file| *file = json!({"frames": 3}));
    assert_eq!(kind, FaultKind::Malformed);
}

#[test]
fn conventions_are_those_of_the_file_and_the_mend_mends() {
    type Written = fn(&Pose) -> Pose;
    let cases: [(Written, &str); 3] = [
        (|pose| *pose, "seem to be of OpenCV's axes"),
        (|pose| pose.flip_camera_axes().inverse(), "seem to be world-to-camera:"),
        (Pose::inverse, "seem to be world-to-camera of OpenCV's axes"),
    ];
    let of_all = |written: &dyn Fn(&Pose) -> Pose, which: &dyn Fn(usize) -> bool| {
        let (root, mut file) = blender(12);
        for index in (0..12).filter(|&index| which(index)) {
            file["frames"][index]["transform_matrix"] = json!(rows(&written(&camera(index))));
        }
        let opened = open(&root, &file);
        (root, opened)
    };
    for (written, says) in cases {
        let (root, opened) = of_all(&written, &|_| true);
        let all = fault(opened);
        assert_eq!((all.kind, &all.path), (FaultKind::Convention, &root.path().join("transforms.json")));
        assert!(all.problem.contains(says) && all.mend.contains("OpenGL's axes"), "{says}: {all}");
        let (root, _) = of_all(&|pose| mended(&written(pose), &all.mend), &|_| true);
        assert_eq!(check(root.path(), &|_, _| {}).count(Severity::Error), 0, "{all}");

        let (root, opened) = of_all(&written, &|index| index == 7);
        let one = fault(opened);
        assert_eq!((one.kind, &one.path), (FaultKind::Convention, &root.path().join("transforms.json")));
        assert!(one.problem.contains("train/r_7.png"), "{one}");
        let (root, _) = of_all(&|pose| mended(&written(pose), &one.mend), &|index| index == 7);
        assert_eq!(check(root.path(), &|_, _| {}).count(Severity::Error), 0, "{one}");
    }
}

#[test]
fn lights_out_of_place_name_the_file_that_places_them() {
    let cases = [
        (
            [3.0, 0.5, -0.25],
            Severity::Warning,
            "the light at [3.0, 0.5, -0.25] stands 0.250 m below the floor",
        ),
        ([0.25, 0.0, 0.5], Severity::Warning, "inside"),
        ([3000.0, 0.0, 4000.0], Severity::Error, "stands 5000.0 m from the scene"),
    ];
    for (position, severity, says) in cases {
        let (root, mut train) = blender(12);
        let mut test = train.clone();
        test["frames"] = train["frames"].as_array_mut().unwrap().split_off(6).into();
        test["frames"][2]["pl_pos"] = json!(position);
        fs::write(root.path().join("transforms_train.json"), train.to_string()).unwrap();
        fs::write(root.path().join("transforms_test.json"), test.to_string()).unwrap();
        let report = check(root.path(), &|_, _| {});
        let placed = report.faults.iter().find(|fault| fault.problem.contains(says));
        let fault = placed.unwrap_or_else(|| panic!("{says}: {:?}", report.faults));
        assert_eq!((fault.severity, &fault.path), (severity, &root.path().join("transforms_test.json")));
        assert!(fault.mend.contains("pl_pos"));
        assert_eq!(report.faults.iter().filter(|fault| fault.severity != Severity::Note).count(), 1);
    }
}

#[test]
fn the_box_of_cameras_all_around_is_what_they_frame() {
    let (root, file) = blender(40);
    let scene = open(&root, &file).unwrap();
    let bounds = scene_bounds(&scene);
    let half = f64::from(bounds.hi[0] - bounds.lo[0]) / 2.0;
    // Horizontally the cameras frame 4 tan(0.6911 / 2) = 1.44 m to each side of the middle.
    assert!((1.2..2.4).contains(&half), "{bounds:?}");
    let middle = [0, 1, 2].map(|i| f64::from(bounds.lo[i] + bounds.hi[i]) / 2.0);
    assert!(norm(middle) < 0.8, "{bounds:?}");
}
