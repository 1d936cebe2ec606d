//! Tests, and the small captures that they are made on.

mod bounds;
mod cache_files;
mod cameras;
mod checks;
mod conventions;
mod drawing;
mod frusta;
mod hostile;
mod images;
mod parsers;
mod pixels;
mod poses;
mod rene;
mod sheets;
mod splits;
mod transforms;

use std::f64::consts::TAU;
use std::fs;
use std::path::{Path, PathBuf};

use tempfile::TempDir;

use crate::formats::camera_file;
use crate::{Camera, Frame, Image, Layout, Light, Pose, Scene, SceneError};

/// A capture's size.
#[derive(Clone, Copy)]
pub(crate) struct Rig {
    pub(crate) views: usize,
    pub(crate) lights: usize,
    pub(crate) width: u32,
    pub(crate) height: u32,
}

pub(crate) const SMALL: Rig = Rig { views: 6, lights: 4, width: 12, height: 9 };

pub(crate) fn from_angles(radius: f64, azimuth: f64, elevation: f64) -> [f64; 3] {
    let (s, c) = elevation.sin_cos();
    [radius * c * azimuth.cos(), radius * c * azimuth.sin(), radius * s]
}

impl Rig {
    /// Cameras on a wedge like the real rig's: 0.6 m from the object, 22 to 42 degrees up, 57 degrees wide.
    pub(crate) fn camera(&self, view: usize) -> Pose {
        let share = (view as f64 + 0.5) / self.views as f64;
        let azimuth = (-50.0 + 57.0 * share).to_radians();
        let elevation = (22.0 + 20.0 * (share * 7.3).fract()).to_radians();
        let radius = 0.602 + 0.021 * (share * 3.1).fract();
        Pose::look_at(from_angles(radius, azimuth, elevation), [0.0, 0.0, 0.05])
    }

    /// Lights on a dome, 0.39 m from the object, 47 to 85 degrees up.
    pub(crate) fn light(&self, light: usize) -> Pose {
        let share = (light as f64 + 0.5) / self.lights as f64;
        let elevation = (47.0 + 38.0 * share).to_radians();
        Pose::look_at(from_angles(0.39, TAU * (share * 5.7).fract(), elevation), [0.0; 3])
    }

    pub(crate) fn image(&self, view: usize, light: usize) -> Image {
        let pixels = (0..self.height).flat_map(|y| (0..self.width).map(move |x| (x, y)));
        let colour = |(x, y): (u32, u32)| [10 + view as u8, 100 + light as u8, (x * 7 + y * 13) as u8];
        Image { width: self.width, height: self.height, data: pixels.flat_map(colour).collect() }
    }

    /// The scene as [`write_to`](Rig::write_to) would have it, without a file.
    pub(crate) fn scene(&self, root: &Path) -> Scene {
        let intrinsics = camera_file::parse(&self.camera_yml("[]")).unwrap();
        let camera = |label| Camera { label, intrinsics: intrinsics.clone(), pose: self.camera(label) };
        let pairs = (0..self.lights).flat_map(|light| (0..self.views).map(move |camera| (camera, light)));
        Scene {
            name: "test".to_owned(),
            root: root.to_owned(),
            layout: Layout::Rene,
            cameras: (0..self.views).map(camera).collect(),
            lights: (0..self.lights).map(|label| Light { label, pose: self.light(label) }).collect(),
            frames: pairs
                .map(|(camera, light)| Frame { camera, light, path: image_path(root, light, camera) })
                .collect(),
            declared: None,
        }
    }

    /// Writes the official layout to a new folder.
    pub(crate) fn write(&self) -> TempDir {
        let folder = TempDir::new().unwrap();
        self.write_to(folder.path());
        folder
    }

    pub(crate) fn write_to(&self, root: &Path) {
        for light in 0..self.lights {
            let data = lset(root, light).join("data");
            fs::create_dir_all(&data).unwrap();
            fs::write(lset(root, light).join("camera.yml"), self.camera_yml("[0.0, 0.0, 0.0, 0.0, 0.0]"))
                .unwrap();
            fs::write(lset(root, light).join("light.txt"), matrix_text(&self.light(light))).unwrap();
            for view in 0..self.views {
                fs::write(pose_path(root, light, view), matrix_text(&self.camera(view))).unwrap();
                self.image(view, light).write_png(&image_path(root, light, view)).unwrap();
            }
        }
    }

    pub(crate) fn camera_yml(&self, dist_coeffs: &str) -> String {
        let (w, h) = (f64::from(self.width), f64::from(self.height));
        format!(
            "intrinsics:\n  camera_matrix:\n  - - {f}\n    - 0.0\n    - {cx}\n  - - 0.0\n    - {f}\n    - {cy}\n  \
             - - 0.0\n    - 0.0\n    - 1.0\n  dist_coeffs: {dist_coeffs}\n  image_size:\n  - {}\n  - {}\n",
            self.width,
            self.height,
            f = 1.6 * w,
            cx = 0.6 * w,
            cy = 0.42 * h,
        )
    }
}

pub(crate) fn lset(root: &Path, light: usize) -> PathBuf {
    root.join(format!("lset{light:03}"))
}

pub(crate) fn image_path(root: &Path, light: usize, view: usize) -> PathBuf {
    lset(root, light).join("data").join(format!("{view:05}_image.png"))
}

pub(crate) fn pose_path(root: &Path, light: usize, view: usize) -> PathBuf {
    lset(root, light).join("data").join(format!("{view:05}_pose.txt"))
}

/// Puts another file in a file's place. (Overwriting one makes some file systems wait for the disk.)
pub(crate) fn replace(path: &Path, contents: impl AsRef<[u8]>) {
    if path.exists() {
        fs::remove_file(path).unwrap();
    }
    fs::write(path, contents).unwrap();
}

pub(crate) fn rows(pose: &Pose) -> [[f64; 4]; 4] {
    [pose.0[0], pose.0[1], pose.0[2], [0.0, 0.0, 0.0, 1.0]]
}

pub(crate) fn matrix_text(pose: &Pose) -> String {
    rows(pose).map(|row| row.map(|v| format!("{v:.18e}")).join(" ")).join("\n") + "\n"
}

/// A matrix after what a mend says has been done to it.
pub(crate) fn mended(matrix: &Pose, mend: &str) -> Pose {
    let inverted = if mend.contains("invert it") { matrix.inverse() } else { *matrix };
    if mend.contains("negate its second and third column") { inverted.flip_camera_axes() } else { inverted }
}

/// The fault in an error.
pub(crate) fn fault<T>(result: Result<T, SceneError>) -> crate::Fault {
    match result {
        Err(SceneError::Fault(fault)) => fault,
        Err(other) => panic!("a fault was expected, not {other}"),
        Ok(_) => panic!("a fault was expected"),
    }
}
