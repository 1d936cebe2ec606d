//! Depths that come back at the next start: the very same, and never those of something else.

#![allow(clippy::unwrap_used)]

mod common;

use std::fs::{self, File};
use std::ops::ControlFlow;
use std::path::{Path, PathBuf};
use std::time::Duration;

use common::{BOUNDS, Rig, go_on, rig};
use proptest::prelude::*;
use proptest::test_runner::TestRunner;
use relight_scene::{Bounds, Image, Intrinsics, PixelStore, Scene};
use relight_stereo::{DepthPrior, Source, StereoSettings};
use tempfile::TempDir;

const SETTINGS: StereoSettings = StereoSettings { side: 24, planes: 32, neighbours: 3, confirmations: 1 };

/// A capture whose pixels, and depths, are kept in a folder.
struct Capture {
    folder: TempDir,
    cache: TempDir,
    scene: Scene,
    store: PixelStore,
}

impl Capture {
    /// 48x36 pixels, reduced to 24x18; the lens distorts.
    fn new() -> Self {
        let resized = rig().lens.resized(48, 36);
        let lens = Intrinsics { distortion: vec![-0.2, 0.1, 0.002, -0.003, 0.0], ..resized };
        let folder = Rig { views: 5, lens, ..rig() }.write();
        let cache = TempDir::new().unwrap();
        let (scene, store) = open(folder.path(), cache.path());
        Self { folder, cache, scene, store }
    }

    /// Another start: images are looked at again.
    fn reopen(&mut self) {
        (self.scene, self.store) = open(self.folder.path(), self.cache.path());
    }

    fn find(&self) -> (DepthPrior, Source) {
        DepthPrior::find(&self.scene, &self.store, &BOUNDS, &SETTINGS, &go_on).unwrap()
    }

    fn estimate(&self) -> DepthPrior {
        DepthPrior::estimate(&self.scene, &self.store, &BOUNDS, &SETTINGS, &go_on).unwrap()
    }

    /// The one file of depths.
    fn file(&self) -> PathBuf {
        let paths = fs::read_dir(self.cache.path()).unwrap().map(|entry| entry.unwrap().path());
        let depths: Vec<PathBuf> = paths.filter(|path| path.extension().unwrap() == "depths").collect();
        let [path] = &depths[..] else { panic!("{depths:?}") };
        path.clone()
    }

    /// All that a prior tells, bit by bit.
    fn bits(&self, prior: &DepthPrior) -> Vec<u32> {
        let lens = &self.scene.cameras[0].intrinsics;
        let pixels = (0..lens.height as usize).flat_map(|y| (0..lens.width as usize).map(move |x| (x, y)));
        let distances = (0..self.store.views())
            .flat_map(|view| pixels.clone().map(move |(x, y)| prior.distance(view, x, y)));
        let bounds = prior.bounds().unwrap();
        let cube = bounds.lo.into_iter().chain(bounds.hi);
        distances.chain(prior.points.as_flattened().iter().copied()).chain(cube).map(f32::to_bits).collect()
    }
}

fn open(folder: &Path, cache: &Path) -> (Scene, PixelStore) {
    let scene = Scene::open(folder).unwrap();
    let frames: Vec<usize> = (0..scene.frames.len()).collect();
    let progress = |_, _| ControlFlow::Continue(());
    let store = PixelStore::load_through(cache, &scene, &frames, &progress).unwrap();
    (scene, store)
}

#[test]
fn the_next_start_finds_the_very_same_depths() {
    let mut capture = Capture::new();
    let expected = capture.bits(&capture.estimate());
    assert!(capture.estimate().points.len() > 100);
    assert!(fs::read_dir(capture.cache.path()).unwrap().count() == 1, "an estimate alone keeps nothing");
    for source in [Source::Stereo, Source::Cache, Source::Cache] {
        let (prior, from) = capture.find();
        assert_eq!(from, source);
        assert!(capture.bits(&prior) == expected);
        capture.reopen();
    }
    let pixels = capture.file().with_extension("pixels");
    assert!(pixels.is_file(), "the file lies beside that of the pixels");
}

#[test]
fn depths_are_estimated_anew_when_anything_differs() {
    let mut capture = Capture::new();
    let higher = Bounds { hi: [0.4, 0.4, 0.6], ..BOUNDS };
    let mut asked = vec![(BOUNDS, SETTINGS), (higher, SETTINGS), (BOUNDS, SETTINGS)];
    asked.extend(
        [
            StereoSettings { side: 25, ..SETTINGS },
            StereoSettings { planes: 33, ..SETTINGS },
            StereoSettings { neighbours: 2, ..SETTINGS },
            StereoSettings { confirmations: 2, ..SETTINGS },
        ]
        .map(|settings| (BOUNDS, settings)),
    );
    for (bounds, settings) in asked {
        for source in [Source::Stereo, Source::Cache] {
            let found = DepthPrior::find(&capture.scene, &capture.store, &bounds, &settings, &go_on);
            assert_eq!(found.unwrap().1, source, "{bounds:?} {settings:?}");
        }
        capture.file();
    }

    let changes: [fn(&mut Scene); 6] = [
        |scene| scene.cameras[2].pose.0[1][3] += 1e-12,
        |scene| scene.cameras[1].intrinsics.fx += 1e-9,
        |scene| scene.cameras[4].intrinsics.cy -= 1e-9,
        |scene| scene.cameras[0].intrinsics.distortion[4] = -0.0,
        |scene| scene.cameras[0].intrinsics.distortion.clear(),
        |scene| scene.lights[3].pose.0[0][3] += 1e-12,
    ];
    for (i, change) in changes.iter().enumerate() {
        change(&mut capture.scene);
        assert_eq!([capture.find().1, capture.find().1], [Source::Stereo, Source::Cache], "change {i}");
    }
}

#[test]
fn changed_images_make_depths_stale() {
    let mut capture = Capture::new();
    capture.find();
    let path = capture.scene.frames[7].path.clone();
    let modified = fs::metadata(&path).unwrap().modified().unwrap();
    let set_time = |time| File::options().write(true).open(&path).unwrap().set_modified(time).unwrap();

    set_time(modified + Duration::from_nanos(1_000_000_000));
    capture.reopen();
    assert_eq!([capture.find().1, capture.find().1], [Source::Stereo, Source::Cache], "another time");

    // The time of before, but another picture in a file of another length.
    let flat = Image { width: 48, height: 36, data: vec![99; 3 * 48 * 36] };
    flat.write_png(&path).unwrap();
    set_time(modified + Duration::from_nanos(1_000_000_000));
    capture.reopen();
    let (prior, source) = capture.find();
    assert_eq!((source, capture.find().1), (Source::Stereo, Source::Cache), "another length");
    assert!(capture.bits(&prior) == capture.bits(&capture.estimate()));
}

#[test]
fn a_cache_that_cannot_be_written_is_no_error() {
    let capture = Capture::new();
    let expected = capture.bits(&capture.estimate());
    // Pixels stay mapped, but a file is where the folder was.
    fs::remove_dir_all(capture.cache.path()).unwrap();
    fs::write(capture.cache.path(), b"").unwrap();
    let (prior, source) = capture.find();
    assert_eq!(source, Source::Stereo);
    assert!(capture.bits(&prior) == expected);
    fs::remove_file(capture.cache.path()).unwrap();

    // Or a folder is where the file should be.
    let capture = Capture::new();
    capture.find();
    let path = capture.file();
    fs::remove_file(&path).unwrap();
    fs::create_dir_all(path.join("inside")).unwrap();
    assert_eq!([capture.find().1, capture.find().1], [Source::Stereo; 2]);
}

#[test]
fn pixels_in_memory_have_no_depths_on_disk() {
    let capture = Capture::new();
    let frames: Vec<usize> = (0..capture.scene.frames.len()).collect();
    let unwritable = capture.scene.frames[0].path.join("inside-a-file");
    let progress = |_, _| ControlFlow::Continue(());
    let store = PixelStore::load_through(&unwritable, &capture.scene, &frames, &progress).unwrap();
    for _ in 0..2 {
        let (_, source) = DepthPrior::find(&capture.scene, &store, &BOUNDS, &SETTINGS, &go_on).unwrap();
        assert_eq!(source, Source::Stereo);
    }
}

/// Asserts that a damaged file gives the right depths, whose bits are known, and is mended to be `whole` again.
fn assert_mended(capture: &Capture, damaged: &[u8], whole: &[u8], bits: &[u32]) {
    fs::write(capture.file(), damaged).unwrap();
    let (prior, source) = capture.find();
    assert!(capture.bits(&prior) == bits);
    assert_eq!(source == Source::Cache, damaged == whole);
    assert!(fs::read(capture.file()).unwrap() == whole);
}

#[test]
fn damage_never_shows() {
    let capture = Capture::new();
    let bits = capture.bits(&capture.find().0);
    let whole = fs::read(capture.file()).unwrap();
    let damage = (
        any::<prop::sample::Index>(),
        [any::<prop::sample::Index>(), any::<prop::sample::Index>()],
        0usize..32,
        1u8..,
        prop::collection::vec(any::<u8>(), 1..20),
    );
    let mut runner = TestRunner::new(ProptestConfig::with_cases(48));
    let outcome = runner.run(&damage, |(cut, [anywhere, in_header], in_name, flip, tail)| {
        let check = |damaged: &[u8]| assert_mended(&capture, damaged, &whole, &bits);
        check(&whole[..cut.index(whole.len())]);
        check(&[&whole[..], &tail].concat());
        for at in [anywhere.index(whole.len()), in_header.index(4096), in_name] {
            let mut flipped = whole.clone();
            flipped[at] ^= flip;
            check(&flipped);
        }
        Ok(())
    });
    outcome.unwrap();
}
