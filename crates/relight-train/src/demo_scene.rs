//! A small scene that needs no download: a box and a ball in a papered corner, traced ray by ray and written as a
//! folder in the layout of ReNe.
//!
//! Cameras and lights stand where the real rig has them (cameras 0.61 m from the centre in a wedge of 57 degrees,
//! lights 0.38 m from it on all sides). The light is a small disc that falls off with the square of the distance, so
//! shadows have soft edges; a dim ambient light fills them.

use std::f64::consts::PI;
use std::path::Path;

use rayon::prelude::*;
use relight_scene::{Image, Pose};

use crate::TrainError;
use crate::run::write_whole;

type Vec3 = [f64; 3];

/// How far a hit point is lifted off its surface before a shadow ray starts, metres.
const LIFT: f64 = 1e-6;
/// Radius of the light's disc, metres.
const LIGHT_RADIUS: f64 = 0.008;
/// Radiant intensity of the light over that of white at one metre.
const INTENSITY: f64 = 0.17;
/// Ambient light, as a share of white.
const AMBIENT: f64 = 0.05;

/// How large a scene to make.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct DemoScene {
    /// Cameras.
    pub views: usize,
    /// Lights.
    pub lights: usize,
    /// Pixels across.
    pub width: u32,
    /// Pixels down.
    pub height: u32,
}

impl DemoScene {
    /// Writes the scene to `root`: one image for each view and light.
    ///
    /// # Errors
    /// [`TrainError::Io`] or [`TrainError::Render`] if a file cannot be written.
    pub fn write(&self, root: &Path) -> Result<(), TrainError> {
        let cameras: Vec<Vec3> =
            spread(self.views).map(|[a, e]| polar(0.61, (a - 0.5) * 57.0 - 45.0, 22.0 + 20.0 * e)).collect();
        let lights: Vec<Vec3> =
            spread(self.lights).map(|[a, e]| polar(0.38, a * 360.0, 47.0 + 38.0 * e)).collect();
        let text = |path: &Path, text: &str| {
            write_whole(path, |file| std::io::Write::write_all(file, text.as_bytes()))
        };
        (0..self.lights * self.views).into_par_iter().try_for_each(|i| {
            let (light, view) = (i / self.views, i % self.views);
            let folder = root.join(format!("lset{light:03}"));
            if view == 0 {
                text(&folder.join("camera.yml"), &self.intrinsics())?;
                text(&folder.join("light.txt"), &matrix(&looking(lights[light])))?;
            }
            let data = folder.join("data");
            text(&data.join(format!("{view:05}_pose.txt")), &matrix(&looking(cameras[view])))?;
            let image = self.image(cameras[view], lights[light]);
            Ok(image.write_png(&data.join(format!("{view:05}_image.png")))?)
        })
    }

    /// Focal length, pixels.
    fn focal(&self) -> f64 {
        1.3 * f64::from(self.width)
    }

    fn centre(&self) -> [f64; 2] {
        [f64::from(self.width - 1) / 2.0, f64::from(self.height - 1) / 2.0]
    }

    fn intrinsics(&self) -> String {
        let (f, [cx, cy]) = (self.focal(), self.centre());
        format!(
            "intrinsics:\n  camera_matrix:\n  - [{f:?}, 0.0, {cx:?}]\n  - [0.0, {f:?}, {cy:?}]\n  - [0.0, 0.0, 1.0]\n  \
             dist_coeffs: [0.0, 0.0, 0.0, 0.0, 0.0]\n  image_size: [{}, {}]\n",
            self.width, self.height
        )
    }

    /// The picture of the camera at `eye` under the light at `light`; both look at the origin.
    fn image(&self, eye: Vec3, light: Vec3) -> Image {
        let (f, [cx, cy]) = (self.focal(), self.centre());
        let camera = looking(eye);
        let disc = looking(light);
        let mut data = Vec::with_capacity(3 * self.width as usize * self.height as usize);
        for v in 0..self.height {
            for u in 0..self.width {
                let mut sum = [0.0; 3];
                // Four samples a pixel, each with a point of the light's disc of its own.
                for s in 0..4 {
                    let (du, dv) = (f64::from(s & 1) * 0.5 - 0.25, f64::from(s >> 1) * 0.5 - 0.25);
                    let x = (f64::from(u) + du - cx) / f;
                    let y = (f64::from(v) + dv - cy) / f;
                    let direction = unit(camera.rotate([x, y, 1.0]));
                    let angle = PI / 2.0 * f64::from(s) + f64::from((u * 7 + v * 13) % 16) * PI / 32.0;
                    let offset = [LIGHT_RADIUS * angle.cos(), LIGHT_RADIUS * angle.sin(), 0.0];
                    let source = disc.transform(offset);
                    let colour = radiance(eye, direction, source);
                    (0..3).for_each(|c| sum[c] += colour[c] / 4.0);
                }
                data.extend(sum.map(srgb));
            }
        }
        Image { width: self.width, height: self.height, data }
    }
}

/// `n` points spread evenly over the unit square (the R2 sequence of Roberts 2018).
fn spread(n: usize) -> impl Iterator<Item = [f64; 2]> {
    (0..n).map(|i| {
        let i = i as f64 + 0.5;
        [(0.754_877_666_246_693 * i).fract(), (0.569_840_290_998_053 * i).fract()]
    })
}

fn polar(radius: f64, azimuth_degrees: f64, elevation_degrees: f64) -> Vec3 {
    let (a, e) = (azimuth_degrees.to_radians(), elevation_degrees.to_radians());
    [radius * e.cos() * a.cos(), radius * e.cos() * a.sin(), radius * e.sin()]
}

/// The pose of a camera or light at `eye` that looks at the centre.
fn looking(eye: Vec3) -> Pose {
    Pose::look_at(eye, [0.0; 3])
}

/// A pose as ReNe's files have it.
fn matrix(pose: &Pose) -> String {
    let row = |[a, b, c, d]: [f64; 4]| format!("{a:?} {b:?} {c:?} {d:?}\n");
    pose.0.map(row).concat() + "0.0 0.0 0.0 1.0\n"
}

/// What a ray sees.
fn radiance(origin: Vec3, direction: Vec3, light: Vec3) -> Vec3 {
    let Some(hit) = nearest(origin, direction) else { return [0.0; 3] };
    let to_light = sub(light, hit.point);
    let distance = dot(to_light, to_light).sqrt();
    let l = to_light.map(|c| c / distance);
    let facing = dot(hit.normal, l);
    let start = add(hit.point, hit.normal.map(|c| c * LIFT));
    let lit = facing > 0.0 && nearest(start, l).is_none_or(|blocker| blocker.distance > distance);
    let mut colour = hit.albedo.map(|a| a * AMBIENT);
    if lit {
        let power = INTENSITY / (distance * distance);
        let half = unit(sub(l, direction));
        let gloss = hit.gloss * dot(hit.normal, half).max(0.0).powi(40);
        (0..3).for_each(|c| colour[c] += power * (hit.albedo[c] * facing + gloss));
    }
    colour
}

/// Where a ray meets a surface.
struct Hit {
    distance: f64,
    point: Vec3,
    normal: Vec3,
    albedo: Vec3,
    gloss: f64,
}

/// The first surface along a ray: floor, two walls, box or ball.
fn nearest(origin: Vec3, direction: Vec3) -> Option<Hit> {
    let at = |t: f64| [0, 1, 2].map(|a| origin[a] + t * direction[a]);
    let mut best: Option<Hit> = None;
    let mut offer = |t: f64, normal: Vec3, gloss: f64, albedo: &dyn Fn(Vec3) -> Vec3| {
        if t > 0.0 && best.as_ref().is_none_or(|b| t < b.distance) {
            let point = at(t);
            best = Some(Hit { distance: t, point, normal, albedo: albedo(point), gloss });
        }
    };
    let plane = |axis: usize, at: f64| (at - origin[axis]) / direction[axis];
    offer(plane(2, 0.0), [0.0, 0.0, 1.0], 0.0, &|p| {
        let tile = ((p[0] / 0.05).floor() + (p[1] / 0.05).floor()).rem_euclid(2.0);
        paint([0.75, 0.68, 0.55], [0.35, 0.22, 0.16], tile, [p[0], p[1]])
    });
    offer(plane(0, -0.32), [1.0, 0.0, 0.0], 0.0, &|p| {
        paint(
            [0.35, 0.5, 0.65],
            [0.8, 0.8, 0.72],
            f64::from((p[2] / 0.06).rem_euclid(2.0) < 0.6),
            [p[1], p[2]],
        )
    });
    offer(plane(1, 0.32), [0.0, -1.0, 0.0], 0.0, &|p| {
        paint(
            [0.5, 0.62, 0.42],
            [0.82, 0.76, 0.6],
            f64::from((p[0] / 0.06).rem_euclid(2.0) < 0.6),
            [p[0], p[2]],
        )
    });
    if let Some((t, normal)) = ball(origin, direction, [0.09, -0.04, 0.055], 0.055) {
        offer(t, normal, 0.25, &|p| {
            paint(
                [0.75, 0.2, 0.15],
                [0.85, 0.75, 0.25],
                f64::from((p[2] / 0.03).rem_euclid(2.0) < 1.0),
                [p[0] + p[2], p[1]],
            )
        });
    }
    if let Some((t, normal)) = block(origin, direction) {
        offer(t, normal, 0.0, &|p| {
            paint([0.25, 0.45, 0.7], [0.8, 0.82, 0.85], 0.0, [p[0] + p[2], p[1] - p[2]])
        });
    }
    best
}

fn ball(origin: Vec3, direction: Vec3, centre: Vec3, radius: f64) -> Option<(f64, Vec3)> {
    let to = sub(origin, centre);
    let b = dot(to, direction);
    let root = b * b - dot(to, to) + radius * radius;
    let t = -b - root.max(0.0).sqrt();
    let normal = || [0, 1, 2].map(|a| (to[a] + t * direction[a]) / radius);
    (root > 0.0 && t > 0.0).then(|| (t, normal()))
}

/// The box, turned about the vertical.
fn block(origin: Vec3, direction: Vec3) -> Option<(f64, Vec3)> {
    let (sin, cos) = 0.4f64.sin_cos();
    let turn = |v: Vec3| [cos * v[0] + sin * v[1], cos * v[1] - sin * v[0], v[2]];
    let (o, d) = (turn(sub(origin, [-0.07, 0.06, 0.07])), turn(direction));
    let half = [0.05, 0.06, 0.07];
    let (mut enter, mut leave, mut axis) = (0.0, f64::INFINITY, 0);
    for a in 0..3 {
        let (near, far) = ((-half[a] * d[a].signum() - o[a]) / d[a], (half[a] * d[a].signum() - o[a]) / d[a]);
        if near > enter {
            (enter, axis) = (near, a);
        }
        leave = leave.min(far);
    }
    let mut normal = [0.0; 3];
    normal[axis] = -d[axis].signum();
    let back = [cos * normal[0] - sin * normal[1], sin * normal[0] + cos * normal[1], normal[2]];
    (enter > 0.0 && enter < leave).then_some((enter, back))
}

/// Albedo between `a` (at `mix` 0) and `b`, mottled at several scales so that every place looks like no other.
fn paint(a: Vec3, b: Vec3, mix: f64, at: [f64; 2]) -> Vec3 {
    let mottle: f64 = [0.06, 0.03, 0.015].iter().map(|&scale| noise(at, scale)).sum::<f64>() / 3.0;
    [0, 1, 2].map(|c| (a[c] + (b[c] - a[c]) * mix) * (0.35 + 0.9 * mottle))
}

/// Smooth noise in 0..1 whose features are `scale` metres wide.
fn noise(at: [f64; 2], scale: f64) -> f64 {
    let (x, y) = (at[0] / scale, at[1] / scale);
    let corner = |dx: f64, dy: f64| {
        let h = ((x.floor() + dx) * 127.1 + (y.floor() + dy) * 311.7 + scale * 1e4).sin() * 43_758.545_3;
        h - h.floor()
    };
    let smooth = |t: f64| t * t * (3.0 - 2.0 * t);
    let (fx, fy) = (smooth(x - x.floor()), smooth(y - y.floor()));
    let lerp = |a: f64, b: f64, t: f64| a + (b - a) * t;
    lerp(lerp(corner(0.0, 0.0), corner(1.0, 0.0), fx), lerp(corner(0.0, 1.0), corner(1.0, 1.0), fx), fy)
}

/// 8-bit sRGB of a linear value, clipped.
fn srgb(linear: f64) -> u8 {
    let x = linear.clamp(0.0, 1.0);
    let encoded = if x <= 0.003_130_8 { 12.92 * x } else { 1.055 * x.powf(1.0 / 2.4) - 0.055 };
    (encoded * 255.0).round() as u8
}

fn dot(a: Vec3, b: Vec3) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

fn add(a: Vec3, b: Vec3) -> Vec3 {
    [a[0] + b[0], a[1] + b[1], a[2] + b[2]]
}

fn sub(a: Vec3, b: Vec3) -> Vec3 {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}

fn unit(v: Vec3) -> Vec3 {
    let norm = dot(v, v).sqrt();
    v.map(|c| c / norm)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_ball_and_the_block_stand_on_the_floor_and_cast_shadows() {
        let down = [0.0, 0.0, -1.0];
        assert!((nearest([0.09, -0.04, 1.0], down).unwrap().distance - 0.89).abs() < 1e-9);
        assert!((nearest([-0.07, 0.06, 1.0], down).unwrap().distance - 0.86).abs() < 1e-9);
        assert!((nearest([0.0, -0.2, 1.0], down).unwrap().distance - 1.0).abs() < 1e-9);
        // Beside the block, the light from behind it leaves only ambient light.
        let eye = [0.02, 0.0, 0.5];
        let lit = radiance(eye, down, [0.1, 0.0, 0.35]);
        let shadowed = radiance(eye, down, [-0.25, 0.15, 0.2]);
        assert!(shadowed[0] < 0.3 * lit[0], "{shadowed:?} {lit:?}");
    }
}
