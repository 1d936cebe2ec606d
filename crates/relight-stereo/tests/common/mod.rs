//! A made scene: a textured floor and a box, photographed by a small rig, with shading and cast shadows.

use std::f64::consts::TAU;
use std::fs;
use std::ops::ControlFlow;
use std::path::Path;

use relight_scene::{Bounds, Image, Intrinsics, Pose};
use tempfile::TempDir;

pub const BOX: Bounds = Bounds { lo: [-0.07, -0.05, 0.0], hi: [0.05, 0.06, 0.09] };
/// Where depths are looked for.
pub const BOUNDS: Bounds = Bounds { lo: [-0.4, -0.4, -0.3], hi: [0.4, 0.4, 0.5] };

/// Never stops stereo.
pub fn go_on() -> ControlFlow<()> {
    ControlFlow::Continue(())
}

/// What is photographed, and how.
#[derive(Clone)]
pub struct Rig {
    pub views: usize,
    pub lights: usize,
    /// Contrast of the texture, 0 for none.
    pub contrast: f64,
    /// Whether surfaces are lit, rather than all of one brightness.
    pub shaded: bool,
    pub lens: Intrinsics,
}

pub fn rig() -> Rig {
    let lens = Intrinsics {
        width: 80,
        height: 60,
        fx: 118.0,
        fy: 120.0,
        cx: 41.0,
        cy: 27.5,
        distortion: Vec::new(),
    };
    Rig { views: 8, lights: 6, contrast: 0.8, shaded: true, lens }
}

fn dome(radius: f64, azimuth: f64, elevation: f64) -> [f64; 3] {
    let (s, c) = elevation.sin_cos();
    [radius * c * azimuth.cos(), radius * c * azimuth.sin(), radius * s]
}

/// A number in 0..1 for each corner of a lattice.
fn lattice(v: [i64; 3]) -> f64 {
    let mut h = v.iter().fold(0x9E37_79B9_u64, |h, &v| (h ^ v as u64).wrapping_mul(0xBF58_476D_1CE4_E5B9));
    h ^= h >> 31;
    h = h.wrapping_mul(0x94D0_49BB_1331_11EB);
    (h >> 40) as f64 / (1u64 << 24) as f64
}

/// Smooth noise of a scale, 0..1.
fn noise(p: [f64; 3], scale: f64) -> f64 {
    let p = p.map(|v| v / scale + 1000.0);
    let (cell, f) = (p.map(|v| v.floor() as i64), p.map(|v| v - v.floor()));
    (0..8)
        .map(|corner: i64| {
            let bit = |a: usize| corner >> a & 1;
            let weight: f64 = (0..3).map(|a| if bit(a) == 1 { f[a] } else { 1.0 - f[a] }).product();
            weight * lattice([cell[0] + bit(0), cell[1] + bit(1), cell[2] + bit(2)])
        })
        .sum()
}

/// Distance along a ray to the box or the floor, and the normal there.
pub fn hit(origin: [f64; 3], direction: [f64; 3]) -> Option<(f64, [f64; 3])> {
    let (mut near, mut far, mut axis) = (1e-6, f64::INFINITY, 2);
    for a in 0..3 {
        let [t0, t1] = [BOX.lo[a], BOX.hi[a]].map(|v| (f64::from(v) - origin[a]) / direction[a]);
        if t0.min(t1) > near {
            (near, axis) = (t0.min(t1), a);
        }
        far = far.min(t0.max(t1));
    }
    if near > 1e-6 && near < far {
        let mut normal = [0.0; 3];
        normal[axis] = -direction[axis].signum();
        return Some((near, normal));
    }
    let floor = -origin[2] / direction[2];
    (floor > 1e-6).then_some((floor, [0.0, 0.0, 1.0]))
}

fn along(origin: [f64; 3], direction: [f64; 3], t: f64) -> [f64; 3] {
    std::array::from_fn(|a| origin[a] + t * direction[a])
}

fn difference(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    std::array::from_fn(|i| a[i] - b[i])
}

fn norm(v: [f64; 3]) -> f64 {
    v.iter().map(|x| x * x).sum::<f64>().sqrt()
}

impl Rig {
    /// Cameras 0.6 m away, 0.2 rad from their neighbours.
    fn camera(&self, view: usize) -> Pose {
        let elevation = 0.6 + 0.2 * (view % 2) as f64;
        Pose::look_at(dome(0.6, -0.5 + 0.17 * view as f64, elevation), [0.0, 0.0, 0.02])
    }

    fn light(&self, light: usize) -> Pose {
        let share = light as f64 / self.lights as f64;
        Pose::look_at(dome(0.39, TAU * share, 0.8 + 0.4 * (light % 2) as f64), [0.0; 3])
    }

    /// The ray of a pixel; its direction is a unit vector.
    pub fn ray(&self, view: usize, u: f64, v: f64) -> ([f64; 3], [f64; 3]) {
        let pose = self.camera(view);
        let direction = pose.rotate(self.lens.unproject(u, v));
        let length = norm(direction);
        (pose.position(), direction.map(|d| d / length))
    }

    fn colour(&self, (origin, direction): ([f64; 3], [f64; 3]), light: [f64; 3]) -> [f64; 3] {
        let Some((t, normal)) = hit(origin, direction) else { return [0.2; 3] };
        let p = along(origin, direction, t);
        let texture = 0.5 * noise(p, 0.035) + 0.3 * noise(p, 0.016) + 0.2 * noise(p, 0.009);
        let albedo = 0.5 + self.contrast * (texture - 0.5) * 1.5;
        let tint = 0.2 * self.contrast * (noise(p, 0.05) - 0.5);
        let brightness = if self.shaded {
            let to_light = difference(light, p);
            let distance = norm(to_light);
            let l = to_light.map(|v| v / distance);
            let start = along(p, normal, 1e-5);
            let lit = hit(start, l).is_none_or(|(t, _)| t > distance);
            let cosine: f64 = normal.iter().zip(l).map(|(n, l)| n * l).sum::<f64>().max(0.0);
            0.1 + if lit { 0.9 * cosine * (0.39 / distance).powi(2) } else { 0.0 }
        } else {
            0.8
        };
        [albedo + tint, albedo, albedo - tint].map(|c| c * brightness)
    }

    fn image(&self, view: usize, light: usize) -> Image {
        let (width, height) = (self.lens.width, self.lens.height);
        let light = self.light(light).position();
        let mut data = Vec::new();
        for y in 0..height {
            for x in 0..width {
                let mut sum = [0.0; 3];
                for (du, dv) in [(-0.25, -0.25), (0.25, -0.25), (-0.25, 0.25), (0.25, 0.25)] {
                    let colour = self.colour(self.ray(view, f64::from(x) + du, f64::from(y) + dv), light);
                    sum.iter_mut().zip(colour).for_each(|(s, c)| *s += c / 4.0);
                }
                data.extend(sum.map(|c| (255.0 * c.clamp(0.01, 1.0)).round() as u8));
            }
        }
        Image { width, height, data }
    }

    /// Photographs all.
    pub fn write(&self) -> TempDir {
        let folder = TempDir::new().unwrap();
        for light in 0..self.lights {
            let lset = folder.path().join(format!("lset{light:03}"));
            fs::create_dir_all(lset.join("data")).unwrap();
            fs::write(lset.join("camera.yml"), self.camera_yml()).unwrap();
            write_pose(&lset.join("light.txt"), &self.light(light));
            for view in 0..self.views {
                write_pose(&lset.join(format!("data/{view:05}_pose.txt")), &self.camera(view));
                let image = self.image(view, light);
                image.write_png(&lset.join(format!("data/{view:05}_image.png"))).unwrap();
            }
        }
        folder
    }

    fn camera_yml(&self) -> String {
        let Intrinsics { width, height, fx, fy, cx, cy, distortion } = &self.lens;
        format!(
            "intrinsics:\n  camera_matrix: [[{fx}, 0.0, {cx}], [0.0, {fy}, {cy}], [0.0, 0.0, 1.0]]\n  \
             dist_coeffs: {distortion:?}\n  image_size: [{width}, {height}]\n"
        )
    }
}

fn write_pose(path: &Path, pose: &Pose) {
    let row = |row: &[f64; 4]| row.map(|v| format!("{v:.17e}")).join(" ");
    let text = pose.0.iter().map(row).chain(["0 0 0 1".to_owned()]).collect::<Vec<_>>().join("\n");
    fs::write(path, text).unwrap();
}
