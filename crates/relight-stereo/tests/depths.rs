//! Depths of a made scene: a textured floor and a box, photographed by a small rig, with shading and cast shadows.

#![allow(clippy::unwrap_used)]

use std::f64::consts::TAU;
use std::fs;
use std::ops::ControlFlow;
use std::path::Path;

use relight_scene::{Bounds, Image, Intrinsics, PixelStore, Pose, Scene};
use relight_stereo::{DepthPrior, StereoSettings};
use tempfile::TempDir;

const BOX: Bounds = Bounds { lo: [-0.07, -0.05, 0.0], hi: [0.05, 0.06, 0.09] };
/// Where depths are looked for.
const BOUNDS: Bounds = Bounds { lo: [-0.4, -0.4, -0.3], hi: [0.4, 0.4, 0.5] };

/// What is photographed, and how.
#[derive(Clone)]
struct Rig {
    views: usize,
    lights: usize,
    /// Contrast of the texture, 0 for none.
    contrast: f64,
    /// Whether surfaces are lit, rather than all of one brightness.
    shaded: bool,
    lens: Intrinsics,
}

fn rig() -> Rig {
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
fn hit(origin: [f64; 3], direction: [f64; 3]) -> Option<(f64, [f64; 3])> {
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
    fn ray(&self, view: usize, u: f64, v: f64) -> ([f64; 3], [f64; 3]) {
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

    /// Photographs all and reads it back. `missing(view, light)` says which photographs are not there to learn from.
    fn capture(&self, missing: impl Fn(usize, usize) -> bool) -> (Scene, PixelStore) {
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
        let scene = Scene::open(folder.path()).unwrap();
        let kept = |&f: &usize| !missing(scene.frames[f].camera, scene.frames[f].light);
        let frames: Vec<usize> = (0..scene.frames.len()).filter(kept).collect();
        let store = PixelStore::load(&scene, &frames, &|_, _| ControlFlow::Continue(())).unwrap();
        (scene, store)
    }

    fn camera_yml(&self) -> String {
        let Intrinsics { width, height, fx, fy, cx, cy, distortion } = &self.lens;
        format!(
            "intrinsics:\n  camera_matrix: [[{fx}, 0.0, {cx}], [0.0, {fy}, {cy}], [0.0, 0.0, 1.0]]\n  \
             dist_coeffs: {distortion:?}\n  image_size: [{width}, {height}]\n"
        )
    }

    /// Relative errors of all known distances.
    fn errors(&self, scene: &Scene, store: &PixelStore, prior: &DepthPrior) -> Vec<f64> {
        let mut errors = Vec::new();
        for view in 0..store.views() {
            for y in 0..self.lens.height as usize {
                for x in 0..self.lens.width as usize {
                    let distance = f64::from(prior.distance(view, x, y));
                    let label = scene.cameras[store.camera(view)].label;
                    let (origin, direction) = self.ray(label, x as f64, y as f64);
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
}

fn write_pose(path: &Path, pose: &Pose) {
    let row = |row: &[f64; 4]| row.map(|v| format!("{v:.17e}")).join(" ");
    let text = pose.0.iter().map(row).chain(["0 0 0 1".to_owned()]).collect::<Vec<_>>().join("\n");
    fs::write(path, text).unwrap();
}

/// Share of the errors within a limit.
fn within(errors: &[f64], limit: f64) -> f64 {
    errors.iter().filter(|&&e| e < limit).count() as f64 / errors.len() as f64
}

#[test]
fn most_known_distances_are_right() {
    let rig = rig();
    let (scene, store) = rig.capture(|_, _| false);
    let prior = DepthPrior::estimate(&scene, &store, &BOUNDS, &StereoSettings::default()).unwrap();
    let errors = rig.errors(&scene, &store, &prior);
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
    let (scene, store) = rig.capture(|_, _| false);
    let settings = StereoSettings { width: 40, ..StereoSettings::default() };
    let prior = DepthPrior::estimate(&scene, &store, &BOUNDS, &settings).unwrap();
    let errors = rig.errors(&scene, &store, &prior);
    assert_eq!(errors.len(), 4 * prior.points.len());
    assert!(prior.coverage() > 0.15, "{}", prior.coverage());
    assert!(within(&errors, 0.03) > 0.8, "{}", within(&errors, 0.03));
}

#[test]
fn a_distorting_lens_is_allowed_for() {
    let mut rig = rig();
    rig.lens.distortion = vec![-0.8, 0.3, 0.002, -0.003, 0.0];
    let (scene, store) = rig.capture(|_, _| false);
    let prior = DepthPrior::estimate(&scene, &store, &BOUNDS, &StereoSettings::default()).unwrap();
    let errors = rig.errors(&scene, &store, &prior);
    assert!(prior.coverage() > 0.2, "{}", prior.coverage());
    let (fine, coarse) = (within(&errors, 0.01), within(&errors, 0.05));
    assert!(fine > 0.75 && coarse > 0.95, "{fine} within 1 %, {coarse} within 5 %");
}

#[test]
fn too_few_views_or_lights_give_nothing() {
    let rig = Rig { views: 3, lens: Intrinsics { width: 24, height: 18, ..rig().lens }, ..rig() };
    let settings = StereoSettings { planes: 16, ..StereoSettings::default() };
    let estimate = |missing: &dyn Fn(usize, usize) -> bool| {
        let (scene, store) = rig.capture(missing);
        DepthPrior::estimate(&scene, &store, &BOUNDS, &settings)
    };
    assert!(estimate(&|_, _| false).is_some());
    assert!(estimate(&|view, _| view == 1).is_none(), "two views");
    // Each view has four lights, but no more than two are common to all.
    assert!(estimate(&|view, light| light == view || light == view + 3).is_none(), "no common lights");
    assert!(estimate(&|_, light| light > 1).is_none(), "two lights");
    assert!(estimate(&|view, light| view == 2 && light > 2).is_some(), "three common lights");
}

#[test]
fn pictures_without_texture_or_shading_say_nothing() {
    let rig = Rig { contrast: 0.0, shaded: false, ..rig() };
    let (scene, store) = rig.capture(|_, _| false);
    let prior = DepthPrior::estimate(&scene, &store, &BOUNDS, &StereoSettings::default()).unwrap();
    assert!(prior.coverage() < 0.01, "{}", prior.coverage());
    assert!(prior.bounds().is_none());
}

/// A box that no camera sees, pictures of a few pixels, a single plane: nothing is found, and nothing panics.
#[test]
fn odd_scenes_and_settings_are_harmless() {
    let rig = Rig { views: 4, lens: Intrinsics { width: 24, height: 18, ..rig().lens }, ..rig() };
    let (scene, store) = rig.capture(|_, _| false);
    let small = StereoSettings { planes: 16, ..StereoSettings::default() };
    let behind = Bounds { lo: [5.0, -1.0, 5.0], hi: [6.0, 1.0, 6.0] };
    let prior = DepthPrior::estimate(&scene, &store, &behind, &small).unwrap();
    assert!(prior.points.is_empty() && prior.bounds().is_none() && prior.coverage() == 0.0);
    assert!(prior.distance(0, 3, 3).is_nan());
    for settings in [
        StereoSettings { width: 1, ..small },
        StereoSettings { width: 0, ..small },
        StereoSettings { planes: 0, ..small },
        StereoSettings { planes: 1, ..small },
        StereoSettings { planes: 2, ..small },
        StereoSettings { neighbours: 0, ..small },
        StereoSettings { neighbours: 100, confirmations: 0, ..small },
    ] {
        let prior = DepthPrior::estimate(&scene, &store, &BOUNDS, &settings);
        let known = prior.as_ref().map_or(0.0, DepthPrior::coverage);
        assert!((0.0..=1.0).contains(&known), "{settings:?}");
        // The last pixel has an entry, too.
        prior.inspect(|p| assert!(!p.distance(3, 23, 17).is_infinite()));
    }
}
