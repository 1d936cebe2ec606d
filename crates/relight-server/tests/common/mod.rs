//! A small benchmark, and zips for it.

use std::fs;
use std::path::{Path, PathBuf};

use relight_scene::{Image, Intrinsics, Pose, ReneWriter, Split};
use relight_server::benchmark::Benchmark;

/// Pixels a row and rows of the benchmark's images.
pub const SIZE: (u32, u32) = (16, 12);

/// Writes a scene of 6 views and 5 lights. The images differ, and are black where `is_black` says so.
pub fn scene(folder: &Path, is_black: impl Fn(usize, usize) -> bool) {
    let (width, height) = SIZE;
    let lens = Intrinsics { width, height, fx: 20.0, fy: 20.0, cx: 7.5, cy: 5.5, distortion: vec![0.0; 5] };
    let at = |i: usize, radius: f64, z: f64| {
        let angle = i as f64;
        Pose::look_at([radius * angle.cos(), radius * angle.sin(), z], [0.0; 3])
    };
    let cameras: Vec<Pose> = (0..6).map(|i| at(i, 0.5, 0.3)).collect();
    let lights: Vec<Pose> = (0..5).map(|i| at(i, 0.2, 0.35)).collect();
    let writer = ReneWriter::create(folder, &lens, cameras, &lights).unwrap();
    for view in 0..6 {
        for light in 0..5 {
            let image = if is_black(view, light) {
                Image { width, height, data: vec![0; 3 * (width * height) as usize] }
            } else {
                picture(10 * view + light)
            };
            writer.write_frame(view, light, &image.png().unwrap()).unwrap();
        }
    }
}

/// A textured picture.
pub fn picture(seed: usize) -> Image {
    let (width, height) = SIZE;
    let bytes = 3 * (width * height) as usize;
    let data = (0..bytes).map(|i| ((i * (7 + seed) + i * i / (3 + seed) + 31 * seed) % 251) as u8).collect();
    Image { width, height, data }
}

/// A benchmark of two scenes, `box` and `café`, in a folder that lives as long as the first value.
pub fn benchmark() -> (tempfile::TempDir, Benchmark) {
    let folder = tempfile::tempdir().unwrap();
    for name in ["box", "café"] {
        scene(&folder.path().join(name), |_, _| false);
    }
    let benchmark = Benchmark::open(folder.path()).unwrap();
    (folder, benchmark)
}

/// Names and PNG files of the benchmark's test images, with validation if asked: each a little off the ground truth.
pub fn answers(benchmark: &Benchmark, with_validation: bool) -> Vec<(String, Vec<u8>)> {
    let images = benchmark.scenes.iter().flat_map(|scene| &scene.images);
    let asked = images.filter(|image| with_validation || image.split != Split::Val);
    let answer = |(i, image): (usize, &relight_server::benchmark::TestImage)| {
        let mut picture = image.read_truth().unwrap();
        picture.data.iter_mut().step_by(2 + i % 5).for_each(|byte| *byte ^= 5);
        (image.entry.clone(), picture.png().unwrap())
    };
    asked.enumerate().map(answer).collect()
}

/// Writes bytes as a file in a folder.
pub fn file(folder: &Path, name: &str, bytes: &[u8]) -> PathBuf {
    let path = folder.join(name);
    fs::write(&path, bytes).unwrap();
    path
}
