use std::fs::{self, File};
use std::ops::ControlFlow;
use std::path::Path;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::{Duration, SystemTime};

use super::{Rig, SMALL, fault, image_path};
use crate::pixel_store::Limits;
use crate::{FaultKind, Image, PixelStore, Scene, SceneError};

const LIMITS: Limits = Limits { worth_caching: 0, ..Limits::USUAL };

fn load(scene: &Scene, frames: &[usize], cache: Option<&Path>) -> Result<PixelStore, SceneError> {
    PixelStore::load_by(scene, frames, &|_, _| ControlFlow::Continue(()), cache, &LIMITS)
}

fn cached_files(cache: &Path) -> Vec<String> {
    let names = fs::read_dir(cache).unwrap().map(|entry| entry.unwrap().file_name().into_string().unwrap());
    names.collect()
}

/// Asserts that a store of [`SMALL`] holds just what the images show.
fn assert_holds(store: &PixelStore, scene: &Scene, frames: &[usize]) {
    let mut held = 0;
    for view in 0..store.views() {
        let camera = store.camera(view);
        assert_eq!(store.pixels(view), 12 * 9);
        assert!(store.lights(view).is_sorted());
        let images: Vec<Image> = (0..SMALL.lights).map(|light| SMALL.image(camera, light)).collect();
        for pixel in 0..store.pixels(view) {
            let colours = store.pixel(view, pixel);
            assert_eq!(colours.len(), store.lights(view).len());
            for (colour, &light) in colours.iter().zip(store.lights(view)) {
                assert_eq!(colour[..], images[light as usize].data[3 * pixel..3 * pixel + 3]);
            }
        }
        let lights = store.lights(view).iter();
        assert!(lights.clone().all(|&light| frames.contains(&scene.frame(camera, light as usize).unwrap())));
        held += lights.len();
    }
    assert_eq!(held, frames.len());
}

#[test]
fn all_lights_of_a_pixel_lie_together() {
    let folder = SMALL.write();
    let scene = Scene::open(folder.path()).unwrap();
    let frames: Vec<usize> = (0..24).filter(|frame| ![0, 6, 12, 18, 7, 9, 22].contains(frame)).collect();
    let store = load(&scene, &frames, None).unwrap();
    assert_eq!(store.views(), 5, "camera 0 is not asked for");
    assert_holds(&store, &scene, &frames);
    assert_eq!(load(&scene, &[], None).unwrap().views(), 0);
    assert!(matches!(load(&scene, &[24], None), Err(SceneError::NoSuchFrame { frame: 24, frames: 24 })));
}

#[test]
fn blocks_of_pixels_are_interleaved_right() {
    // More pixels than one task interleaves, and not a multiple.
    let rig = Rig { views: 3, lights: 3, width: 67, height: 53 };
    let folder = rig.write();
    let scene = Scene::open(folder.path()).unwrap();
    let frames: Vec<usize> = (0..9).collect();
    let store = load(&scene, &frames, None).unwrap();
    for view in 0..3 {
        let images: Vec<Image> = (0..3).map(|light| rig.image(view, light)).collect();
        assert_eq!(store.lights(view), [0, 1, 2]);
        for pixel in 0..store.pixels(view) {
            for (colour, image) in store.pixel(view, pixel).iter().zip(&images) {
                assert_eq!(colour[..], image.data[3 * pixel..3 * pixel + 3]);
            }
        }
    }
}

#[test]
fn progress_counts_every_image() {
    let folder = SMALL.write();
    let scene = Scene::open(folder.path()).unwrap();
    let cache = tempfile::tempdir().unwrap();
    for calls in [24, 1] {
        let (count, last) = (AtomicUsize::new(0), AtomicUsize::new(0));
        let progress = |done, total| {
            assert!(done <= total && total == 24);
            count.fetch_add(1, Ordering::Relaxed);
            last.fetch_max(done, Ordering::Relaxed);
            ControlFlow::Continue(())
        };
        PixelStore::load_by(&scene, &(0..24).collect::<Vec<_>>(), &progress, Some(cache.path()), &LIMITS)
            .unwrap();
        assert_eq!((count.into_inner(), last.into_inner()), (calls, 24));
    }
}

#[test]
fn loading_that_is_stopped_leaves_nothing() {
    let folder = SMALL.write();
    let scene = Scene::open(folder.path()).unwrap();
    let cache = tempfile::tempdir().unwrap();
    let frames: Vec<usize> = (0..24).collect();
    let stop_at = |last: usize| {
        let progress = |done, _| if done < last { ControlFlow::Continue(()) } else { ControlFlow::Break(()) };
        PixelStore::load_by(&scene, &frames, &progress, Some(cache.path()), &LIMITS)
    };
    for last in [1, 13, 24] {
        assert!(matches!(stop_at(last), Err(SceneError::Cancelled)));
        assert_eq!(cached_files(cache.path()), [""; 0]);
    }
    stop_at(25).unwrap();
    assert!(matches!(stop_at(1), Err(SceneError::Cancelled)), "from the cache too");
}

#[test]
fn the_second_start_reads_no_image() {
    let folder = SMALL.write();
    let scene = Scene::open(folder.path()).unwrap();
    let cache = tempfile::tempdir().unwrap();
    let frames: Vec<usize> = (0..24).collect();
    assert_holds(&load(&scene, &frames, Some(cache.path())).unwrap(), &scene, &frames);
    assert_eq!(cached_files(cache.path()).len(), 1);

    // Damage an image so that nothing shows from outside: the cache is used.
    let path = image_path(folder.path(), 1, 1);
    let metadata = fs::metadata(&path).unwrap();
    fs::write(&path, vec![0; metadata.len() as usize]).unwrap();
    File::options().write(true).open(&path).unwrap().set_modified(metadata.modified().unwrap()).unwrap();
    assert_holds(&load(&scene, &frames, Some(cache.path())).unwrap(), &scene, &frames);

    // Once its time has changed the image is read again.
    File::options().write(true).open(&path).unwrap().set_modified(SystemTime::now()).unwrap();
    assert_eq!(fault(load(&scene, &frames, Some(cache.path())).map(drop)).path, path);
    SMALL.image(1, 1).write_png(&path).unwrap();
    assert_holds(&load(&scene, &frames, Some(cache.path())).unwrap(), &scene, &frames);
    assert_eq!(cached_files(cache.path()).len(), 1, "the stale file is replaced");

    // Other frames of the same scene have their own file.
    assert_holds(&load(&scene, &frames[..10], Some(cache.path())).unwrap(), &scene, &frames[..10]);
    assert_eq!(cached_files(cache.path()).len(), 2);
}

#[test]
fn damaged_cache_files_are_made_anew() {
    let folder = SMALL.write();
    let scene = Scene::open(folder.path()).unwrap();
    let cache = tempfile::tempdir().unwrap();
    let frames: Vec<usize> = (0..24).collect();
    load(&scene, &frames, Some(cache.path())).unwrap();
    let path = cache.path().join(&cached_files(cache.path())[0]);
    let good = fs::read(&path).unwrap();
    let mut other_version = good.clone();
    other_version[8] = 99;
    for damaged in [other_version, good[..good.len() - 1].to_vec(), Vec::new(), vec![0; good.len()]] {
        fs::write(&path, damaged).unwrap();
        assert_holds(&load(&scene, &frames, Some(cache.path())).unwrap(), &scene, &frames);
        assert_eq!(fs::read(&path).unwrap(), good);
    }
}

#[test]
fn without_a_cache_folder_memory_holds_the_pixels() {
    let folder = SMALL.write();
    let scene = Scene::open(folder.path()).unwrap();
    let frames: Vec<usize> = (0..24).collect();
    let file = tempfile::NamedTempFile::new().unwrap();
    assert_holds(&load(&scene, &frames, Some(&file.path().join("inside-a-file"))).unwrap(), &scene, &frames);
    let inside = folder.path().join("cache");
    assert_holds(&load(&scene, &frames, Some(&inside)).unwrap(), &scene, &frames);
    assert!(!inside.exists(), "nothing is written into the dataset");
}

#[test]
fn what_a_killed_program_left_is_removed() {
    let folder = SMALL.write();
    let scene = Scene::open(folder.path()).unwrap();
    let cache = tempfile::tempdir().unwrap();
    for (name, age) in [("old.unfinished", 7200), ("new.unfinished", 60)] {
        let file = File::create(cache.path().join(name)).unwrap();
        file.set_modified(SystemTime::now() - Duration::from_secs(age)).unwrap();
    }
    load(&scene, &[0, 1, 2], Some(cache.path())).unwrap();
    let names = cached_files(cache.path());
    assert!(names.iter().any(|name| name == "new.unfinished"), "somebody may be at it");
    assert!(!names.iter().any(|name| name == "old.unfinished"));
}

#[test]
fn faulty_training_images_are_refused_by_name_and_leave_no_cache() {
    let cache = tempfile::tempdir().unwrap();
    let folder = SMALL.write();
    let scene = Scene::open(folder.path()).unwrap();
    let path = image_path(folder.path(), 3, 5);
    let black = Image { width: 12, height: 9, data: vec![0; 3 * 12 * 9] };
    black.write_png(&path).unwrap();
    let frames: Vec<usize> = (0..24).collect();
    for cache in [None, Some(cache.path())] {
        let fault = fault(load(&scene, &frames, cache).map(drop));
        assert_eq!((fault.kind, &fault.path), (FaultKind::Black, &path));
    }
    fs::write(&path, b"no image").unwrap();
    assert_eq!(fault(load(&scene, &frames, Some(cache.path())).map(drop)).kind, FaultKind::Image);
    assert_eq!(cached_files(cache.path()), [""; 0]);
}

#[test]
fn large_views_are_put_together_in_parts() {
    let folder = SMALL.write();
    let scene = Scene::open(folder.path()).unwrap();
    let frames: Vec<usize> = (0..24).collect();
    let cache = tempfile::tempdir().unwrap();
    // Less than a pixel, a few pixels, and not a multiple of a pixel.
    for part in [1, 60, 1000] {
        for folder in [None, Some(cache.path())] {
            let done = AtomicUsize::new(0);
            let progress = |images, total| {
                assert!(images <= total && total == 24);
                done.fetch_max(images, Ordering::Relaxed);
                ControlFlow::Continue(())
            };
            let limits = Limits { part, ..LIMITS };
            let store = PixelStore::load_by(&scene, &frames, &progress, folder, &limits).unwrap();
            assert_holds(&store, &scene, &frames);
            assert_eq!(done.into_inner(), 24);
            if folder.is_some() {
                fs::remove_file(cache.path().join(&cached_files(cache.path())[0])).unwrap();
            }
        }
    }
}

#[test]
fn more_pixels_than_memory_and_disk_can_hold_are_refused_at_once() {
    let folder = SMALL.write();
    let mut scene = Rig { views: 200, lights: 200, ..SMALL }.scene(folder.path());
    for frame in &mut scene.frames {
        frame.path = image_path(folder.path(), 0, 0);
    }
    for camera in &mut scene.cameras {
        (camera.intrinsics.width, camera.intrinsics.height) = (16384, 16384);
    }
    let frames: Vec<usize> = (0..scene.frames.len()).collect();
    let cache = tempfile::tempdir().unwrap();
    for (folder, says) in [(None, "no folder"), (Some(cache.path()), "bytes free")] {
        let error = load(&scene, &frames, folder).map(drop).unwrap_err();
        assert!(matches!(error, SceneError::Memory { .. }), "{error}");
        let error = error.to_string();
        assert!(error.contains("32212254720000 bytes") && error.contains("RELIGHT_CACHE"), "{error}");
        assert!(error.contains(says), "{error}");
    }
    assert_eq!(cached_files(cache.path()), [""; 0]);
}
