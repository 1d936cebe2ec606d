//! Energy, reciprocity and sampling of every material.

use std::f32::consts::PI;

use glam::Vec3A;
use serde::Deserialize;

use super::super::bsdf::Facing;
use super::super::material::Surface;
use super::super::microfacet::{Interface, Microfacets};
use super::super::random::{hash, stratified, uniform};
use super::super::{Material, Texture};

fn materials(colour: f32) -> Vec<(String, Material)> {
    let reflectance = || Texture::Uniform([colour; 3]);
    let mut all = vec![
        ("lambert".to_owned(), Material::Lambert { reflectance: reflectance() }),
        (
            "translucent".to_owned(),
            Material::Translucent {
                reflectance: Texture::Uniform([0.6 * colour; 3]),
                transmittance: Texture::Uniform([0.4 * colour; 3]),
            },
        ),
    ];
    for alpha in [0.05, 0.2, 0.5, 1.0] {
        all.push((format!("metal {alpha}"), Material::Conductor { reflectance: reflectance(), alpha }));
        for ior in [1.3, 1.5] {
            let glossy = Material::Glossy { reflectance: reflectance(), alpha, ior };
            all.push((format!("glossy {alpha} {ior}"), glossy));
        }
    }
    all
}

fn facing(cosine: f32) -> Facing {
    let viewer = Vec3A::new((1.0 - cosine * cosine).sqrt(), 0.0, cosine);
    Facing::towards(viewer, Vec3A::Z, Vec3A::Z)
}

/// Share of light from everywhere that goes to the viewer, by drawing bounces.
fn albedo(material: &Material, cosine: f32, seed: u64) -> Vec3A {
    let surface = Surface::new(material).unwrap();
    let bsdf = surface.bsdf([0.0; 2], Vec3A::ZERO, false);
    let count = 1 << 16;
    let drawn = (0..count).filter_map(|i| {
        let choice = uniform(hash(&[seed, u64::from(i)]));
        bsdf.sample(&facing(cosine), stratified(i, seed), choice)
    });
    drawn.map(|bounce| bounce.weight).sum::<Vec3A>() / count as f32
}

/// The same, by adding up what `eval` says over a grid of directions.
fn summed(material: &Material, cosine: f32) -> f32 {
    let surface = Surface::new(material).unwrap();
    let bsdf = surface.bsdf([0.0; 2], Vec3A::ZERO, false);
    let side = 1200;
    let mut sum = 0.0f64;
    for i in 0..side {
        for j in 0..side {
            let z = (2 * i + 1) as f32 / side as f32 - 1.0;
            let angle = (j as f32 + 0.5) / side as f32 * 2.0 * PI;
            let ring = (1.0 - z * z).sqrt();
            let light = Vec3A::new(ring * angle.cos(), ring * angle.sin(), z);
            sum += f64::from(bsdf.eval(&facing(cosine), light).x);
        }
    }
    (sum / f64::from(side * side)) as f32 * 4.0 * PI
}

#[test]
fn white_surfaces_in_a_white_room_vanish() {
    for (name, material) in materials(1.0) {
        for cosine in [0.08, 0.3, 0.7, 1.0] {
            let share = albedo(&material, cosine, 5).x;
            assert!((share - 1.0).abs() < 0.01, "{name} at {cosine}: {share}");
        }
    }
}

#[test]
fn dark_surfaces_keep_some_light() {
    for (name, material) in materials(0.3) {
        for cosine in [0.3, 1.0] {
            let share = albedo(&material, cosine, 5).x;
            assert!((0.1..0.8).contains(&share), "{name} at {cosine}: {share}");
        }
    }
}

#[test]
fn drawn_directions_agree_with_the_scattering_function() {
    for (name, material) in materials(0.7) {
        for cosine in [0.3, 0.9] {
            let (drawn, summed) = (albedo(&material, cosine, 9).x, summed(&material, cosine));
            assert!((drawn / summed - 1.0).abs() < 0.01, "{name} at {cosine}: {drawn} {summed}");
        }
    }
}

#[test]
fn light_and_viewer_can_be_exchanged() {
    for (name, material) in materials(0.7) {
        let surface = Surface::new(&material).unwrap();
        let bsdf = surface.bsdf([0.0; 2], Vec3A::ZERO, false);
        for i in 0..200 {
            let upper = |seed| {
                let [u, v] = stratified(i, seed);
                let z = 0.05 + 0.95 * u;
                let ring = (1.0 - z * z).sqrt();
                Vec3A::new(ring * (2.0 * PI * v).cos(), ring * (2.0 * PI * v).sin(), z)
            };
            let (a, b) = (upper(1), upper(2));
            let one = bsdf.eval(&Facing::towards(a, Vec3A::Z, Vec3A::Z), b).x / b.z;
            let other = bsdf.eval(&Facing::towards(b, Vec3A::Z, Vec3A::Z), a).x / a.z;
            assert!((one - other).abs() <= 2e-4 * one.max(other), "{name}: {one} {other}");
        }
    }
}

#[test]
fn nothing_opaque_lets_light_through() {
    for (name, material) in materials(0.7) {
        let surface = Surface::new(&material).unwrap();
        let bsdf = surface.bsdf([0.0; 2], Vec3A::ZERO, false);
        let below = bsdf.eval(&facing(0.8), Vec3A::new(0.6, 0.0, -0.8)).x;
        assert_eq!(below > 0.0, name == "translucent", "{name}: {below}");
    }
}

/// `tools/golden_microfacets.py`.
#[derive(Debug, Deserialize)]
struct Golden {
    walks: Vec<Walk>,
    lost: Vec<Lost>,
}

/// Random walks over facets under one cosine: means and their standard errors.
#[derive(Debug, Deserialize)]
struct Walk {
    kind: String,
    /// The metal's reflectance, or the index of refraction.
    value: f32,
    alpha: f64,
    cosine: f32,
    /// Share of light that leaves after one facet.
    once: [f32; 2],
    /// The same, after any number.
    ever: [f32; 2],
}

/// Share of light that does not leave after one facet, integrated over all facets.
#[derive(Debug, Deserialize)]
struct Lost {
    kind: String,
    value: f32,
    alpha: f64,
    cosine: f32,
    lost: f32,
}

fn golden() -> Golden {
    serde_json::from_str(include_str!("../../../tests/golden/microfacets.json")).unwrap()
}

fn interface(kind: &str, value: f32) -> Interface {
    if kind == "metal" { Interface::Conductor } else { Interface::Dielectric { ior: value } }
}

#[test]
fn facets_send_back_what_random_walks_over_them_do() {
    for walk in &golden().walks {
        let metal = walk.kind == "metal";
        // Tables hold the share of clear facets, and of white metal's.
        if !metal || walk.value == 1.0 {
            let facets = Microfacets::new(walk.alpha, interface(&walk.kind, walk.value));
            let share = 1.0 - facets.unreflected(walk.cosine);
            let [expected, error] = walk.once;
            assert!((share - expected).abs() < 4.0 * error + 1e-4, "{walk:?}: {share}");
        }
        // From facet to facet colour saturates, which one mean reflectance tells roughly.
        if metal {
            let colour = Texture::Uniform([walk.value; 3]);
            let material = Material::Conductor { reflectance: colour, alpha: walk.alpha };
            let short = 1.0 - albedo(&material, walk.cosine, 3).x / walk.ever[0];
            let most = if walk.alpha > 0.5 { 0.1 } else { 0.035 };
            assert!((-0.01..most).contains(&short), "{walk:?}: {short}");
        }
    }
}

#[test]
fn facets_lose_what_all_facets_together_do() {
    for expected in &golden().lost {
        let lost = Microfacets::new(expected.alpha, interface(&expected.kind, expected.value))
            .unreflected(expected.cosine);
        let miss = lost / expected.lost - 1.0;
        let most = match expected.kind.as_str() {
            "clear" => 1e-3,
            _ if expected.alpha < 0.05 => 0.015,
            _ => 5e-3,
        };
        assert!(miss.abs() < most, "{expected:?}: {lost}");
    }
    // Under light straight from above, facets as rough as can be lose the natural logarithm of two.
    let rough = Microfacets::new(1.0, Interface::Conductor).unreflected(1.0);
    assert!((rough - 2f32.ln()).abs() < 1e-4, "{rough}");
}
