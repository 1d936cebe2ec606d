//! Pictures depend on what they show, and on nothing else.

use fearless_simd::Level;
use glam::{DVec3, Vec3A, dvec3};
use proptest::prelude::*;

use super::super::geometry::Geometry;
use super::super::occlusion::{LANES, Packet};
use super::super::random::{hash, uniform};
use super::super::{Material, Mesh, Model, Sensor, Settings, VirtualRig, shapes};
use super::{camera, floor, light, white_lamp};

fn small_rig(seed: u64) -> VirtualRig {
    let mut model: Model = floor(0.8, Material::matt([0.6; 3]));
    model.push(shapes::sphere(0.05, 32).at(dvec3(0.0, 0.0, 0.05)), Material::plastic([0.6, 0.1, 0.1], 0.2));
    model.push(shapes::torus(0.1, 0.01, 32, 12).at(dvec3(0.0, 0.0, 0.01)), Material::metal([0.9; 3], 0.1));
    let settings = Settings { samples: 8, bounce_share: 2, seed, ..Settings::default() };
    VirtualRig::new(&model, white_lamp(0.005), Sensor::default(), settings).unwrap()
}

#[test]
fn a_picture_does_not_depend_on_threads_or_on_other_lights() {
    let rig = small_rig(1);
    let view = camera(dvec3(0.4, -0.3, 0.3), DVec3::ZERO, [24, 20], 30.0);
    let lights: Vec<_> = (0..40)
        .map(|k| {
            let angle = f64::from(k) * 0.7;
            light(k as usize, dvec3(0.3 * angle.cos(), 0.3 * angle.sin(), 0.25))
        })
        .collect();
    let pool = |threads| rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
    let all = pool(1).install(|| rig.photograph(&view, &lights));
    assert!(all == pool(3).install(|| rig.photograph(&view, &lights)));
    for k in [0, 15, 16, 39] {
        assert!(rig.photograph(&view, &lights[k..=k])[0] == all[k], "light {k}");
    }
    assert!(all[0] != all[1]);
    assert!(small_rig(2).photograph(&view, &lights[..1])[0] != all[0], "another seed, another noise");
}

#[test]
fn noise_has_the_deviation_that_the_sensor_states() {
    let sensor = Sensor { exposure: 1.0, full_well: 1000.0, read_noise: 10.0 };
    let model = floor(2.0, Material::matt([0.5; 3]));
    let settings = Settings { samples: 1, ..Settings::default() };
    let rig = VirtualRig::new(&model, white_lamp(0.0), sensor, settings).unwrap();
    // So narrow a view that the floor is evenly bright.
    let view = camera(dvec3(0.0, -0.2, 0.5), DVec3::ZERO, [100, 100], 1e6);
    let lamp = [light(0, dvec3(0.0, 0.0, 0.5))];
    let (signal, radiance) = (&rig.signals(&view, &lamp)[0], rig.radiance(&view, &lamp)[0].mean(0));
    let mean = signal.mean(0);
    let variance = signal.pixels.iter().map(|p| (f64::from(p[0]) - mean).powi(2)).sum::<f64>() / 1e4;
    let expected = radiance / 1000.0 + 1e-4;
    assert!((mean - radiance).abs() < 4.0 * (expected / 1e4).sqrt(), "{mean} {radiance}");
    assert!((variance / expected - 1.0).abs() < 0.06, "{variance} {expected}");
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(40))]
    #[test]
    fn packets_find_what_single_rays_find(seed in 0u64..1_000_000, triangles in 1usize..60) {
        let draw = |k: usize, j: usize| f64::from(uniform(hash(&[seed, k as u64, j as u64]))) - 0.5;
        let point = |k: usize| dvec3(draw(k, 0), draw(k, 1), draw(k, 2));
        let positions: Vec<DVec3> = (0..3 * triangles).map(point).collect();
        let faces = (0..triangles as u32).map(|t| [3 * t, 3 * t + 1, 3 * t + 2]).collect();
        let geometry = Geometry::new(&[&Mesh::flat(positions, faces)]).unwrap();
        let single = |v: DVec3| Vec3A::new(v.x as f32, v.y as f32, v.z as f32);
        let mut packet = Packet {
            origin: [[0.0; LANES]; 3],
            direction: [[0.0; LANES]; 3],
            length: [0.4; LANES],
            asked: 0x7FFF,
        };
        let mut expected = 0;
        for lane in 0..LANES {
            let origin = single(point(10_000 + lane) * 2.0);
            // Some rays run along an axis exactly.
            let direction = if lane < 3 { Vec3A::AXES[lane] } else { single(point(20_000 + lane)).normalize() };
            for k in 0..3 {
                packet.origin[k][lane] = origin[k];
                packet.direction[k][lane] = direction[k];
            }
            let hit = geometry.first_hit(origin, direction);
            if lane < 15 && hit.is_some_and(|hit| hit.position.distance(origin) < 0.4) {
                expected |= 1 << lane;
            }
        }
        for level in [Level::new(), Level::baseline()] {
            prop_assert_eq!(geometry.occluded(level, &packet, &mut Vec::new()), expected);
        }
    }
}
