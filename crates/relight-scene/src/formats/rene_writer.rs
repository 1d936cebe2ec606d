//! Writing a capture as an official ReNe folder, frame by frame.

use std::fs;
use std::io::Write;
use std::path::{Path, PathBuf};

use crate::camera::Intrinsics;
use crate::error::SceneError;
use crate::files::write_whole;
use crate::pose::Pose;

/// A ReNe folder that is being filled. A frame's pose is there before its image, and both are whole, at any moment.
pub struct ReneWriter {
    root: PathBuf,
    cameras: Vec<Pose>,
}

impl ReneWriter {
    /// Makes the folders of all lights with their `camera.yml` and `light.txt`, or writes those two anew. Poses are
    /// to-world, metres.
    ///
    /// # Errors
    /// The file that cannot be written.
    pub fn create(
        root: &Path,
        intrinsics: &Intrinsics,
        cameras: Vec<Pose>,
        lights: &[Pose],
    ) -> Result<ReneWriter, SceneError> {
        let writer = ReneWriter { root: root.to_owned(), cameras };
        for (light, pose) in lights.iter().enumerate() {
            let folder = writer.light_folder(light);
            let data = folder.join("data");
            fs::create_dir_all(&data).map_err(|error| SceneError::io(&data, "be made", &error))?;
            put(&folder.join("camera.yml"), lens_text(intrinsics).as_bytes())?;
            put(&folder.join("light.txt"), pose_text(pose).as_bytes())?;
        }
        Ok(writer)
    }

    /// Where the image of a view under a light lies.
    pub fn image_path(&self, view: usize, light: usize) -> PathBuf {
        self.light_folder(light).join("data").join(format!("{view:05}_image.png"))
    }

    /// Writes the pose of a view and its image, a PNG file's bytes.
    ///
    /// # Errors
    /// The file that cannot be written.
    pub fn write_frame(&self, view: usize, light: usize, png: &[u8]) -> Result<(), SceneError> {
        let image = self.image_path(view, light);
        put(&image.with_file_name(format!("{view:05}_pose.txt")), pose_text(&self.cameras[view]).as_bytes())?;
        put(&image, png)
    }

    fn light_folder(&self, light: usize) -> PathBuf {
        self.root.join(format!("lset{light:03}"))
    }
}

fn put(path: &Path, bytes: &[u8]) -> Result<(), SceneError> {
    write_whole(path, |file| file.write_all(bytes))
        .map_err(|error| SceneError::io(path, "be written", &error))
}

/// A lens as `camera.yml` has it.
fn lens_text(lens: &Intrinsics) -> String {
    let Intrinsics { width, height, fx, fy, cx, cy, distortion } = lens;
    format!(
        "intrinsics:\n  camera_matrix:\n  - [{fx:?}, 0.0, {cx:?}]\n  - [0.0, {fy:?}, {cy:?}]\n  - [0.0, 0.0, 1.0]\n  \
         dist_coeffs: {distortion:?}\n  image_size: [{width}, {height}]\n"
    )
}

/// A pose as ReNe's files have it: four rows of four numbers.
fn pose_text(pose: &Pose) -> String {
    let row = |[a, b, c, d]: [f64; 4]| format!("{a:?} {b:?} {c:?} {d:?}\n");
    pose.0.map(row).concat() + "0.0 0.0 0.0 1.0\n"
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::image_file::Image;
    use crate::scene::Scene;

    #[test]
    fn what_is_written_is_read_back() {
        let folder = tempfile::tempdir().unwrap();
        let lens = Intrinsics {
            width: 6,
            height: 4,
            fx: 7.25,
            fy: 7.5,
            cx: 2.1,
            cy: 1.9,
            distortion: vec![-0.1, 0.02, 1e-3, -2e-4, 0.0],
        };
        let at = |x: f64| Pose::look_at([x, -0.5, 0.4], [0.0; 3]);
        let (cameras, lights) = (vec![at(0.1), at(0.2)], vec![at(0.0), at(-0.3)]);
        let writer = ReneWriter::create(folder.path(), &lens, cameras.clone(), &lights).unwrap();
        let image = Image { width: 6, height: 4, data: (0..72).collect() };
        for (view, light) in [(0, 0), (0, 1), (1, 0), (1, 1)] {
            writer.write_frame(view, light, &image.png().unwrap()).unwrap();
        }
        let scene = Scene::open(folder.path()).unwrap();
        let poses: Vec<Pose> = scene.cameras.iter().map(|camera| camera.pose).collect();
        let shone: Vec<Pose> = scene.lights.iter().map(|light| light.pose).collect();
        assert_eq!((poses, shone), (cameras, lights));
        assert_eq!(scene.cameras[1].intrinsics, lens);
        assert_eq!(scene.read_frame(3).unwrap(), image);
        let report = crate::check::check(folder.path(), &|_, _| {});
        assert_eq!(report.count(crate::error::Severity::Error), 0, "{:?}", report.faults);
    }
}
