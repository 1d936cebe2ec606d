//! The shared estimators against a tracer that shares nothing: every pixel and light by itself, even directions on the
//! hemisphere, points on the lamp's sphere, and a walk through all triangles, in double precision.

use std::f64::consts::PI;

use glam::{DVec3, dvec3};

use super::super::random::hash;
use super::super::{Material, Model, Settings, shapes};
use super::{camera, floor, light, rig, settings, white_lamp};

struct Brute {
    triangles: Vec<([DVec3; 3], DVec3)>,
    lamp: DVec3,
    radius: f64,
    draws: u64,
}

impl Brute {
    fn uniform(&mut self) -> f64 {
        self.draws += 1;
        (hash(&[self.draws]) >> 11) as f64 / (1u64 << 53) as f64
    }

    fn sphere(&mut self) -> DVec3 {
        let (z, angle) = (2.0 * self.uniform() - 1.0, 2.0 * PI * self.uniform());
        let ring = (1.0 - z * z).sqrt();
        dvec3(ring * angle.cos(), ring * angle.sin(), z)
    }

    /// Distance, normal towards the origin and colour of the first triangle.
    fn hit(&self, origin: DVec3, direction: DVec3) -> Option<(f64, DVec3, DVec3)> {
        let mut first: Option<(f64, DVec3, DVec3)> = None;
        for &([a, b, c], colour) in &self.triangles {
            let normal = (b - a).cross(c - a);
            let distance = normal.dot(a - origin) / normal.dot(direction);
            let p = origin + distance * direction;
            let inside =
                [(a, b), (b, c), (c, a)].iter().all(|&(s, t)| (t - s).cross(p - s).dot(normal) >= 0.0);
            if distance > 1e-7 && inside && first.is_none_or(|(d, ..)| distance < d) {
                let n = normal.normalize();
                first = Some((distance, if n.dot(direction) < 0.0 { n } else { -n }, colour));
            }
        }
        first
    }

    /// Direct light that a matt place sends out, one draw: a point of the lamp's whole sphere.
    fn direct(&mut self, p: DVec3, normal: DVec3, colour: DVec3) -> DVec3 {
        let out = self.sphere();
        let to = self.lamp + self.radius * out - p;
        let (distance, direction) = (to.length(), to.normalize());
        let (here, there) = (normal.dot(direction), -out.dot(direction));
        let covered = self.hit(p, direction).is_some_and(|(d, ..)| d < distance);
        if here <= 0.0 || there <= 0.0 || covered {
            return DVec3::ZERO;
        }
        // Radiance 1 / (pi r^2) over an area of 4 pi r^2.
        colour / PI * here * there / (distance * distance) * 4.0
    }

    fn sample(&mut self, origin: DVec3, direction: DVec3) -> DVec3 {
        let Some((distance, normal, colour)) = self.hit(origin, direction) else { return DVec3::ZERO };
        let p = origin + distance * direction;
        let mut sum = self.direct(p, normal, colour);
        let mut bounce = self.sphere();
        if bounce.dot(normal) < 0.0 {
            bounce = -bounce;
        }
        if let Some((distance, facing, other)) = self.hit(p, bounce) {
            // Scattering colour / pi, density 1 / (2 pi).
            let arriving = self.direct(p + distance * bounce, facing, other);
            sum += 2.0 * colour * bounce.dot(normal) * arriving;
        }
        sum
    }
}

fn scene() -> Model {
    let mut model = floor(0.6, Material::matt([0.7, 0.6, 0.5]));
    model.push(
        shapes::quad(dvec3(-0.12, 0.3, 0.0), DVec3::NEG_Y * 0.6, DVec3::Z * 0.3),
        Material::matt([0.8, 0.2, 0.1]),
    );
    model.push(
        shapes::block(dvec3(0.02, 0.0, 0.03), dvec3(0.04, 0.05, 0.06)),
        Material::matt([0.2, 0.5, 0.8]),
    );
    model
}

#[test]
fn sharing_changes_no_mean() {
    let model = scene();
    let view = camera(dvec3(0.35, -0.3, 0.35), DVec3::ZERO, [3, 2], 9.0);
    let lights = [
        light(0, dvec3(0.1, -0.1, 0.3)),
        light(17, dvec3(-0.05, 0.12, 0.25)),
        light(40, dvec3(0.2, 0.1, 0.3)),
    ];
    let radius = 0.02;
    let mut brute = Brute { triangles: Vec::new(), lamp: DVec3::ZERO, radius, draws: 0 };
    for part in &model.parts {
        let Material::Lambert { reflectance: super::super::Texture::Uniform(c) } = part.material else {
            panic!("matt only");
        };
        let colour = DVec3::from_array(c.map(f64::from));
        let corners = |t: &[u32; 3]| t.map(|i| part.mesh.positions[i as usize]);
        brute.triangles.extend(part.mesh.triangles.iter().map(|t| (corners(t), colour)));
    }
    let shared: Vec<_> = [1, 3]
        .map(|bounce_share| {
            let settings = Settings { bounce_share, ..settings(8192) };
            rig(&model, white_lamp(radius), settings).radiance(&view, &lights)
        })
        .into();
    let eye = DVec3::from_array(view.pose.position());
    let count = 40_000;
    for (l, source) in lights.iter().enumerate() {
        brute.lamp = DVec3::from_array(source.pose.position());
        for (x, y) in [(0, 0), (1, 0), (1, 1), (2, 1)] {
            let (mut sum, mut squares) = (DVec3::ZERO, DVec3::ZERO);
            for _ in 0..count {
                let (u, v) = (f64::from(x) + brute.uniform() - 0.5, f64::from(y) + brute.uniform() - 0.5);
                let ray = DVec3::from_array(view.pose.rotate(view.intrinsics.unproject(u, v))).normalize();
                let value = brute.sample(eye, ray);
                sum += value;
                squares += value * value;
            }
            let mean = sum / f64::from(count);
            let deviation =
                ((squares / f64::from(count) - mean * mean) / f64::from(count)).max(DVec3::splat(1e-12));
            for pictures in &shared {
                let ours = DVec3::from_array(pictures[l].at(x, y));
                let error = (ours - mean) / deviation.map(f64::sqrt);
                // Four deviations of the brute-force mean, and one in a hundred for our own noise.
                let allowed = DVec3::splat(4.0) + 0.01 * mean / deviation.map(f64::sqrt);
                assert!(error.abs().cmple(allowed).all(), "light {l}, pixel {x} {y}: {ours} {mean} {error}");
            }
        }
    }
}
