//! Depths of a made scene.

#![allow(clippy::unwrap_used)]

mod common;

use std::ops::ControlFlow;
use std::sync::atomic::{AtomicUsize, Ordering};

use common::{BOUNDS, BOX, Rig, go_on, hit, rig};
use relight_scene::{Bounds, Intrinsics, PixelStore, Scene};
use relight_stereo::{DepthPrior, StereoSettings};

/// Photographs all and reads it back. `missing(view, light)` says which photographs are not there to learn from.
fn capture(rig: &Rig, missing: impl Fn(usize, usize) -> bool) -> (Scene, PixelStore) {
    let folder = rig.write();
    let scene = Scene::open(folder.path()).unwrap();
    let kept = |&f: &usize| !missing(scene.frames[f].camera, scene.frames[f].light);
    let frames: Vec<usize> = (0..scene.frames.len()).filter(kept).collect();
    let store = PixelStore::load(&scene, &frames, &|_, _| ControlFlow::Continue(())).unwrap();
    (scene, store)
}

/// Relative errors of all known distances.
fn errors(rig: &Rig, scene: &Scene, store: &PixelStore, prior: &DepthPrior) -> Vec<f64> {
    let mut errors = Vec::new();
    for view in 0..store.views() {
        for y in 0..rig.lens.height as usize {
            for x in 0..rig.lens.width as usize {
                let distance = f64::from(prior.distance(view, x, y));
                let label = scene.cameras[store.camera(view)].label;
                let (origin, direction) = rig.ray(label, x as f64, y as f64);
                if !distance.is_nan() {
                    // Where there is nothing, any distance is wrong.
                    let truth = hit(origin, direction).map_or(f64::INFINITY, |(t, _)| t);
                    errors.push((distance / truth - 1.0).abs());
                }
            }
        }
    }
    errors
}

/// Share of the errors within a limit.
fn within(errors: &[f64], limit: f64) -> f64 {
    errors.iter().filter(|&&e| e < limit).count() as f64 / errors.len() as f64
}

#[test]
fn most_known_distances_are_right() {
    let rig = rig();
    let (scene, store) = capture(&rig, |_, _| false);
    let prior = DepthPrior::estimate(&scene, &store, &BOUNDS, &StereoSettings::default(), &go_on).unwrap();
    let errors = errors(&rig, &scene, &store, &prior);
    assert!(prior.coverage() > 0.3, "{}", prior.coverage());
    assert_eq!(errors.len(), prior.points.len());
    let (fine, coarse) = (within(&errors, 0.01), within(&errors, 0.05));
    assert!(fine > 0.85 && coarse > 0.97, "{fine} within 1 %, {coarse} within 5 %");

    // Points lie on the floor or on the box, and the cube around them holds the box.
    let near_surface = |p: &&[f32; 3]| {
        let outside = (0..3).map(|a| (BOX.lo[a] - p[a]).max(p[a] - BOX.hi[a])).fold(f32::MIN, f32::max);
        p[2].abs() < 0.01 || outside.abs() < 0.01
    };
    let share = prior.points.iter().filter(near_surface).count() as f64 / prior.points.len() as f64;
    assert!(share > 0.9, "{share}");
    let found = prior.bounds().unwrap();
    assert!((0..3).all(|a| found.lo[a] < BOX.lo[a] + 0.01 && BOX.hi[a] - 0.01 < found.hi[a]), "{found:?}");
    let edges: [f32; 3] = std::array::from_fn(|a| found.hi[a] - found.lo[a]);
    assert!(edges.iter().all(|e| (e - edges[0]).abs() < 1e-5 && *e < 0.8), "{edges:?}");
}

/// Pictures reduced to a half still give depths good to their pixels, for every pixel of the photographs.
#[test]
fn reduced_pictures_serve_all_pixels() {
    let rig = rig();
    let (scene, store) = capture(&rig, |_, _| false);
    let settings = StereoSettings { side: 40, ..StereoSettings::default() };
    let prior = DepthPrior::estimate(&scene, &store, &BOUNDS, &settings, &go_on).unwrap();
    let errors = errors(&rig, &scene, &store, &prior);
    assert_eq!(errors.len(), 4 * prior.points.len());
    assert!(prior.coverage() > 0.15, "{}", prior.coverage());
    assert!(within(&errors, 0.03) > 0.8, "{}", within(&errors, 0.03));
}

#[test]
fn a_distorting_lens_is_allowed_for() {
    let mut rig = rig();
    rig.lens.distortion = vec![-0.8, 0.3, 0.002, -0.003, 0.0];
    let (scene, store) = capture(&rig, |_, _| false);
    let prior = DepthPrior::estimate(&scene, &store, &BOUNDS, &StereoSettings::default(), &go_on).unwrap();
    let errors = errors(&rig, &scene, &store, &prior);
    assert!(prior.coverage() > 0.2, "{}", prior.coverage());
    let (fine, coarse) = (within(&errors, 0.01), within(&errors, 0.05));
    assert!(fine > 0.75 && coarse > 0.95, "{fine} within 1 %, {coarse} within 5 %");
}

#[test]
fn too_few_views_or_lights_give_nothing() {
    let rig = Rig { views: 3, lens: Intrinsics { width: 24, height: 18, ..rig().lens }, ..rig() };
    let settings = StereoSettings { planes: 16, ..StereoSettings::default() };
    let estimate = |missing: &dyn Fn(usize, usize) -> bool| {
        let (scene, store) = capture(&rig, missing);
        DepthPrior::estimate(&scene, &store, &BOUNDS, &settings, &go_on)
    };
    assert!(estimate(&|_, _| false).is_some());
    assert!(estimate(&|view, _| view == 1).is_none(), "two views");
    // Each view has four lights, but no more than two are common to all.
    assert!(estimate(&|view, light| light == view || light == view + 3).is_none(), "no common lights");
    assert!(estimate(&|_, light| light > 1).is_none(), "two lights");
    assert!(estimate(&|view, light| view == 2 && light > 2).is_some(), "three common lights");
}

#[test]
fn stereo_that_is_not_wanted_any_more_ends_at_the_next_view() {
    let rig = Rig { views: 6, lens: Intrinsics { width: 24, height: 18, ..rig().lens }, ..rig() };
    let (scene, store) = capture(&rig, |_, _| false);
    let settings = StereoSettings { planes: 16, ..StereoSettings::default() };
    let one = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
    // Each of six views is described, then swept.
    for (wanted, asked) in [(0, 1), (3, 4), (6, 7), (9, 10), (12, 12)] {
        let count = AtomicUsize::new(0);
        let go_on = || {
            let before = count.fetch_add(1, Ordering::Relaxed);
            if before < wanted { ControlFlow::Continue(()) } else { ControlFlow::Break(()) }
        };
        let found = one.install(|| DepthPrior::estimate(&scene, &store, &BOUNDS, &settings, &go_on));
        assert_eq!((found.is_some(), count.into_inner()), (wanted == 12, asked));
    }
}

#[test]
fn pictures_without_texture_or_shading_say_nothing() {
    let rig = Rig { contrast: 0.0, shaded: false, ..rig() };
    let (scene, store) = capture(&rig, |_, _| false);
    let prior = DepthPrior::estimate(&scene, &store, &BOUNDS, &StereoSettings::default(), &go_on).unwrap();
    assert!(prior.coverage() < 0.01, "{}", prior.coverage());
    assert!(prior.bounds().is_none());
}

/// A box that no camera sees, pictures of a few pixels, a single plane: nothing is found, and nothing panics.
#[test]
fn odd_scenes_and_settings_are_harmless() {
    let rig = Rig { views: 4, lens: Intrinsics { width: 24, height: 18, ..rig().lens }, ..rig() };
    let (scene, store) = capture(&rig, |_, _| false);
    let small = StereoSettings { planes: 16, ..StereoSettings::default() };
    let behind = Bounds { lo: [5.0, -1.0, 5.0], hi: [6.0, 1.0, 6.0] };
    let prior = DepthPrior::estimate(&scene, &store, &behind, &small, &go_on).unwrap();
    assert!(prior.points.is_empty() && prior.bounds().is_none() && prior.coverage() == 0.0);
    assert!(prior.distance(0, 3, 3).is_nan());
    for settings in [
        StereoSettings { side: 1, ..small },
        StereoSettings { side: 0, ..small },
        StereoSettings { planes: 0, ..small },
        StereoSettings { planes: 1, ..small },
        StereoSettings { planes: 2, ..small },
        StereoSettings { neighbours: 0, ..small },
        StereoSettings { neighbours: 100, confirmations: 0, ..small },
    ] {
        let prior = DepthPrior::estimate(&scene, &store, &BOUNDS, &settings, &go_on);
        let known = prior.as_ref().map_or(0.0, DepthPrior::coverage);
        assert!((0.0..=1.0).contains(&known), "{settings:?}");
        // The last pixel has an entry, too.
        prior.inspect(|p| assert!(!p.distance(3, 23, 17).is_infinite()));
    }
}
