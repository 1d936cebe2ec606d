use std::fs;

use image::ImageFormat;

use super::{Rig, SMALL, fault, image_path, lset, matrix_text, pose_path, replace};
use crate::{FaultKind, Layout, Pose, Scene};

#[test]
fn a_scene_is_read_whole() {
    let folder = SMALL.write();
    let scene = Scene::open(folder.path()).unwrap();
    assert_eq!(scene.layout, Layout::Rene);
    assert_eq!((scene.cameras.len(), scene.lights.len(), scene.frames.len()), (6, 4, 24));
    for (view, camera) in scene.cameras.iter().enumerate() {
        assert_eq!(camera.label, view);
        assert_eq!(camera.pose, SMALL.camera(view));
        assert_eq!((camera.intrinsics.width, camera.intrinsics.height), (12, 9));
        assert_eq!(camera.intrinsics.distortion, [0.0; 5]);
    }
    for (index, light) in scene.lights.iter().enumerate() {
        assert_eq!((light.label, light.pose), (index, SMALL.light(index)));
    }
    let frame = scene.frame(5, 3).unwrap();
    assert_eq!(scene.read_frame(frame).unwrap(), SMALL.image(5, 3));
    assert_eq!(scene.frame(6, 0), None);
}

#[test]
fn labels_are_the_numbers_in_the_folder() {
    let folder = SMALL.write();
    fs::rename(lset(folder.path(), 1), lset(folder.path(), 17)).unwrap();
    for light in [0, 17, 2, 3] {
        fs::rename(image_path(folder.path(), light, 2), image_path(folder.path(), light, 31)).unwrap();
        fs::rename(pose_path(folder.path(), light, 2), pose_path(folder.path(), light, 31)).unwrap();
    }
    let scene = Scene::open(folder.path()).unwrap();
    assert_eq!(scene.lights.iter().map(|light| light.label).collect::<Vec<_>>(), [0, 2, 3, 17]);
    assert_eq!(scene.cameras.iter().map(|camera| camera.label).collect::<Vec<_>>(), [0, 1, 3, 4, 5, 31]);
    assert_eq!(scene.lights[3].pose, SMALL.light(1));
    assert_eq!(scene.cameras[5].pose, SMALL.camera(2));
    assert_eq!(scene.read_frame(scene.frame(5, 3).unwrap()).unwrap(), SMALL.image(2, 1));
}

#[test]
fn jpeg_and_webp_stand_in_for_png() {
    let folder = SMALL.write();
    for (view, extension, format) in
        [(0, "jpg", ImageFormat::Jpeg), (1, "webp", ImageFormat::WebP), (2, "JPEG", ImageFormat::Jpeg)]
    {
        let png = image_path(folder.path(), 2, view);
        image::open(&png).unwrap().save_with_format(png.with_extension(extension), format).unwrap();
        fs::remove_file(png).unwrap();
    }
    let scene = Scene::open(folder.path()).unwrap();
    assert_eq!(scene.frames.len(), 24);
    assert_eq!(scene.read_frame(scene.frame(1, 2).unwrap()).unwrap(), SMALL.image(1, 2));
    let jpeg = scene.read_frame(scene.frame(0, 2).unwrap()).unwrap();
    let differences = jpeg.data.iter().zip(SMALL.image(0, 2).data).map(|(&a, b)| a.abs_diff(b));
    assert!(differences.max().unwrap() < 90, "JPEG loses, but not everything");
}

#[test]
fn camera_files_may_be_written_in_many_ways() {
    let folder = SMALL.write();
    let texts = [
        SMALL.camera_yml("[[0.1, -0.2, 0.001, 0.002]]"),
        SMALL.camera_yml("\n  - - 0.1\n  - - -0.2\n  - - 0.001\n  - - 0.002"),
        SMALL
            .camera_yml("[1.0e-1, '-0.2', 1e-3, .002]")
            .replace("intrinsics:\n", "")
            .replace("\n  ", "\n")
            .trim_start()
            .to_owned(),
        "{\"intrinsics\": {\"camera_matrix\": [[19.2, 0, 7.2], [0, 19.2, 3.78], [0, 0, 1]], \
         \"dist_coeffs\": [0.1, -0.2, 0.001, 0.002], \"image_size\": [12, 9]}}"
            .to_owned(),
    ];
    for text in texts {
        for light in 0..4 {
            replace(&lset(folder.path(), light).join("camera.yml"), &text);
        }
        let scene = Scene::open(folder.path()).unwrap();
        let lens = &scene.cameras[3].intrinsics;
        assert_eq!(lens.distortion, [0.1, -0.2, 0.001, 0.002], "{text}");
        assert!((lens.fx - 19.2).abs() < 1e-9 && (lens.cy - 3.78).abs() < 1e-9);
    }
}

#[test]
fn broken_camera_files_are_named() {
    let folder = SMALL.write();
    let good = SMALL.camera_yml("[]");
    let path = lset(folder.path(), 2).join("camera.yml");
    for (text, says) in [
        (good.replace("camera_matrix", "matrix"), "camera_matrix"),
        (good.replace("image_size", "size"), "image_size"),
        (good.replace("- 12\n", "- 12.5\n"), "image_size"),
        (good.replace("[]", "[0.1, 0.2]"), "2 distortion coefficients"),
        (good.replace("[]", "[.nan, 0, 0, 0]"), "dist_coeffs"),
        (good.replace("- - 19.2", "- - -19.2"), "focal length"),
        (good.replace("    - 1.0\n", "    - 7.0\n"), "camera_matrix"),
        ("\u{1}\u{2}: [".to_owned(), "YAML"),
        (String::new(), "camera_matrix"),
    ] {
        replace(&path, &text);
        let fault = fault(Scene::open(folder.path()));
        assert_eq!((fault.kind, &fault.path), (FaultKind::Lens, &path), "{fault}");
        assert!(fault.to_string().contains(says), "{says}: {fault}");
        assert!(!fault.mend.is_empty());
    }
}

#[test]
fn missing_halves_of_frames_are_errors_and_missing_frames_are_not() {
    let folder = SMALL.write();
    fs::remove_file(image_path(folder.path(), 1, 4)).unwrap();
    let missing = fault(Scene::open(folder.path()));
    assert_eq!((missing.kind, missing.path), (FaultKind::Missing, image_path(folder.path(), 1, 4)));
    fs::remove_file(pose_path(folder.path(), 1, 4)).unwrap();
    let scene = Scene::open(folder.path()).unwrap();
    assert_eq!(scene.frames.len(), 23);
    assert_eq!(scene.frame(4, 1), None);
    fs::remove_file(pose_path(folder.path(), 3, 0)).unwrap();
    let missing = fault(Scene::open(folder.path()));
    assert_eq!((missing.kind, missing.path), (FaultKind::Missing, pose_path(folder.path(), 3, 0)));
}

#[test]
fn missing_lights_and_camera_files_are_named() {
    for name in ["light.txt", "camera.yml", "data"] {
        let folder = SMALL.write();
        let path = lset(folder.path(), 2).join(name);
        if path.is_dir() {
            fs::remove_dir_all(&path).unwrap()
        } else {
            fs::remove_file(&path).unwrap()
        }
        let fault = fault(Scene::open(folder.path()));
        assert_eq!((fault.kind, fault.path), (FaultKind::Missing, path));
    }
}

#[test]
fn a_camera_that_moves_between_lights_is_an_error() {
    let folder = SMALL.write();
    let path = pose_path(folder.path(), 3, 2);
    let mut moved = SMALL.camera(2);
    moved.0[1][3] += 2e-5;
    replace(&path, matrix_text(&moved));
    assert_eq!(
        Scene::open(folder.path()).unwrap().cameras[2].pose,
        SMALL.camera(2),
        "the robots' repeatability"
    );
    moved.0[1][3] += 0.02;
    replace(&path, matrix_text(&moved));
    let fault = fault(Scene::open(folder.path()));
    assert_eq!((fault.kind, fault.path), (FaultKind::Inconsistent, path));
}

#[test]
fn lenses_that_differ_between_lights_are_an_error() {
    let folder = SMALL.write();
    let path = lset(folder.path(), 1).join("camera.yml");
    replace(&path, SMALL.camera_yml("[0.1, 0, 0, 0]"));
    let fault = fault(Scene::open(folder.path()));
    assert_eq!((fault.kind, fault.path), (FaultKind::Inconsistent, path));
}

#[test]
fn matrices_of_wrong_shape_are_named() {
    let folder = SMALL.write();
    let path = pose_path(folder.path(), 0, 1);
    let identity = matrix_text(&Pose::IDENTITY);
    for (text, kind) in [
        ("1 2 3".to_owned(), FaultKind::Malformed),
        (identity.replacen("1", "x", 1), FaultKind::Malformed),
        (format!("{identity} 5"), FaultKind::Malformed),
        (identity.replacen("1.0", "2.0", 1), FaultKind::Pose),
        (identity.replacen("1.000000000000000000e0", "nan", 1), FaultKind::Pose),
    ] {
        replace(&path, &text);
        let fault = fault(Scene::open(folder.path()));
        assert_eq!((fault.kind, &fault.path), (kind, &path), "{text}");
    }
}

#[test]
fn one_number_cannot_name_two_lights_or_images() {
    let folder = SMALL.write();
    let twin = folder.path().join("lset1");
    fs::create_dir(&twin).unwrap();
    assert_eq!(fault(Scene::open(folder.path())).kind, FaultKind::Extra);
    fs::remove_dir(twin).unwrap();
    let png = image_path(folder.path(), 0, 0);
    fs::copy(&png, png.with_extension("jpg")).unwrap();
    let fault = fault(Scene::open(folder.path()));
    assert_eq!((fault.kind, fault.path), (FaultKind::Extra, png));
}

#[test]
fn an_image_of_another_size_is_refused_when_read() {
    let folder = SMALL.write();
    let path = image_path(folder.path(), 0, 3);
    Rig { width: 8, ..SMALL }.image(3, 0).write_png(&path).unwrap();
    let scene = Scene::open(folder.path()).unwrap();
    let fault = fault(scene.read_frame(scene.frame(3, 0).unwrap()));
    assert_eq!((fault.kind, &fault.path), (FaultKind::Size, &path));
    assert!(fault.problem.contains("8x9") && fault.problem.contains("12x9"), "{fault}");
}

#[test]
fn the_folder_above_points_to_its_scenes() {
    let above = tempfile::tempdir().unwrap();
    SMALL.write_to(&above.path().join("cube"));
    let fault = fault(Scene::open(above.path()));
    assert!(fault.mend.contains("cube"), "{fault}");
}
