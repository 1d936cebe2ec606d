//! What the crate holds in memory at the most, told by an allocator that counts. One test, so that no other one is
//! counted with it.
#![allow(clippy::unwrap_used)]

use std::alloc::{GlobalAlloc, Layout, System};
use std::fs;
use std::ops::ControlFlow;
use std::path::Path;
use std::sync::atomic::{AtomicUsize, Ordering};

use relight_scene::{Image, PixelStore, Scene, Splits};

static HELD: AtomicUsize = AtomicUsize::new(0);
static MOST: AtomicUsize = AtomicUsize::new(0);

struct Counting;

// SAFETY: all is left to the system's allocator; counting allocates nothing.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        let held = HELD.fetch_add(layout.size(), Ordering::Relaxed) + layout.size();
        MOST.fetch_max(held, Ordering::Relaxed);
        // SAFETY: as the caller guarantees.
        unsafe { System.alloc(layout) }
    }

    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        HELD.fetch_sub(layout.size(), Ordering::Relaxed);
        // SAFETY: as the caller guarantees.
        unsafe { System.dealloc(pointer, layout) }
    }
}

#[global_allocator]
static COUNTING: Counting = Counting;

/// The most bytes that something holds at a time, beyond what was held before.
fn most_held<T>(doing: impl FnOnce() -> T) -> usize {
    let before = HELD.load(Ordering::Relaxed);
    MOST.store(before, Ordering::Relaxed);
    drop(doing());
    MOST.load(Ordering::Relaxed) - before
}

const SIDE: u32 = 96;
const LIGHTS: usize = 150;

/// One camera at the end of the x axis that looks back along it, under many lights.
fn write_capture(root: &Path) {
    let lens = format!(
        "camera_matrix: [[100, 0, 48], [0, 100, 48], [0, 0, 1]]\ndist_coeffs: []\nimage_size: [{SIDE}, {SIDE}]\n"
    );
    let image = Image { width: SIDE, height: SIDE, data: vec![90; (3 * SIDE * SIDE) as usize] };
    for light in 0..LIGHTS {
        let folder = root.join(format!("lset{light:03}"));
        fs::create_dir_all(folder.join("data")).unwrap();
        fs::write(folder.join("camera.yml"), &lens).unwrap();
        fs::write(folder.join("light.txt"), "0 0 1 0.3 0 1 0 0.2 -1 0 0 0.5 0 0 0 1").unwrap();
        fs::write(folder.join("data/00000_pose.txt"), "0 0 -1 1 1 0 0 0 0 -1 0 0 0 0 0 1").unwrap();
        image.write_png(&folder.join("data/00000_image.png")).unwrap();
    }
}

#[test]
fn memory_is_bounded() {
    let folder = tempfile::tempdir().unwrap();
    write_capture(folder.path());
    let scene = Scene::open(folder.path()).unwrap();
    let frames: Vec<usize> = (0..LIGHTS).collect();
    let pixels = LIGHTS * (3 * SIDE * SIDE) as usize;
    let pool = rayon::ThreadPoolBuilder::new().num_threads(2).build().unwrap();
    let held = pool.install(|| {
        most_held(|| PixelStore::load(&scene, &frames, &|_, _| ControlFlow::Continue(())).unwrap())
    });
    assert!(held > pixels, "the store itself is counted");
    assert!(2 * held < 5 * pixels, "the store and one view, and a few images: {held} of {pixels}");

    // Unknown keys are skipped, whatever they hold.
    let unknown = format!("[{}[]]", "[],".repeat(1 << 20));
    let path = folder.path().join("splits.json");
    let text = format!(
        r#"{{"unknown": {unknown}, "format": "relight-splits", "version": 1, "train": [[0, 0]], "val": [], "easy": [], "hard": []}}"#
    );
    fs::write(&path, &text).unwrap();
    let held = most_held(|| assert_eq!(Splits::of(&scene).unwrap().train, [0]));
    assert!(held < 2 * text.len(), "{held} for {}", text.len());

    let transforms = folder.path().join("capture.json");
    let text = format!(
        r#"{{"unknown": {unknown}, "camera_angle_x": 1, "frames": [{{"unknown": {unknown}, "pl_pos": [1, 0, 2],
        "transform_matrix": [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 3], [0, 0, 0, 1]],
        "file_path": "lset000/data/00000_image.png"}}]}}"#
    );
    fs::write(&transforms, &text).unwrap();
    let held = most_held(|| assert_eq!(Scene::open(&transforms).unwrap().frames.len(), 1));
    assert!(held < 2 * text.len(), "{held} for {}", text.len());
}
