//! Rough interfaces: GGX facets, Smith's height-correlated masking, and a matt lobe that returns what the facets do not.
//!
//! Both interfaces share one form. With `E(c)` the share of light that the facets reflect directly under the cosine `c`,
//! `f = F D G / (4 c_i c_o) + base (1 - E(c_i)) (1 - E(c_o)) / pi`: for a dielectric coat the second term is the base that
//! the coat's transmitted light reaches, for a metal it is the light that facets pass among themselves (Kulla and Conty
//! 2017). It is reciprocal, and white over white loses nothing.

use std::f32::consts::PI;

use glam::Vec3A;

use super::bsdf::Bsdf;

/// Entries of the table of `1 - E`, at the squares of evenly spaced numbers from 0 to 1: the smoother a surface is, the nearer
/// to the horizon `1 - E` changes.
const ENTRIES: usize = 64;
/// Facets that an entry is a mean of.
const FACETS: u32 = 2048;

/// What the facets are made of.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Interface {
    /// Clear, of an index of refraction.
    Dielectric { ior: f32 },
    /// Metal; its colour is the surface's.
    Conductor,
}

/// A rough interface of one roughness.
#[derive(Clone, Debug)]
pub(super) struct Microfacets {
    alpha: f32,
    interface: Interface,
    /// `1 - E` of the interface (of a white one, for metals).
    unreflected: [f32; ENTRIES],
    /// `1 - E` averaged over the cosine-weighted hemisphere.
    mean_unreflected: f32,
}

impl Microfacets {
    pub(super) fn new(alpha: f64, interface: Interface) -> Self {
        let alpha = alpha as f32;
        let unreflected = std::array::from_fn(|i| {
            let root = i as f32 / (ENTRIES - 1) as f32;
            unreflected(alpha, interface, (root * root).max(1e-4))
        });
        let mut facets = Self { alpha, interface, unreflected, mean_unreflected: 0.0 };
        // 2 c dc over [0, 1], by the midpoint rule in the root of c.
        let steps = 4096;
        let roots = (0..steps).map(|i| (i as f32 + 0.5) / steps as f32);
        let sum: f32 = roots.map(|root| 4.0 * root.powi(3) * facets.unreflected(root * root)).sum();
        facets.mean_unreflected = sum / steps as f32;
        facets
    }

    /// The scattering of a surface of this interface and a colour: that of the base, or of the metal.
    pub(super) fn bsdf(&self, colour: Vec3A) -> Bsdf<'_> {
        let (normal_incidence, base) = match self.interface {
            Interface::Dielectric { ior } => {
                let entering = self.mean_unreflected / (ior * ior);
                // Inside, 1 - entering is thrown back to the base each time.
                (
                    Vec3A::ZERO,
                    colour / (ior * ior) / (Vec3A::ONE - colour * (1.0 - entering)).max(Vec3A::splat(1e-6)),
                )
            }
            Interface::Conductor => {
                let mean = colour + (Vec3A::ONE - colour) / 21.0;
                let among_facets = mean * mean * (1.0 - self.mean_unreflected)
                    / (Vec3A::ONE - mean * self.mean_unreflected).max(Vec3A::splat(1e-6));
                (colour, among_facets / self.mean_unreflected.max(1e-6))
            }
        };
        Bsdf::Microfacet { facets: self, normal_incidence, base }
    }

    /// `1 - E` at a cosine.
    pub(super) fn unreflected(&self, cosine: f32) -> f32 {
        let x = cosine.clamp(0.0, 1.0).sqrt() * (ENTRIES - 1) as f32;
        let i = (x as usize).min(ENTRIES - 2);
        let (low, high) = (self.unreflected[i], self.unreflected[i + 1]);
        low + (high - low) * (x - i as f32)
    }

    /// `1 - E`, averaged over the cosine-weighted hemisphere.
    pub(super) fn mean_unreflected(&self) -> f32 {
        self.mean_unreflected
    }

    /// Reflectance of a facet whose normal has a cosine with the light.
    pub(super) fn fresnel(&self, cosine: f32, normal_incidence: Vec3A) -> Vec3A {
        match self.interface {
            Interface::Dielectric { ior } => Vec3A::splat(fresnel_dielectric(cosine, ior)),
            Interface::Conductor => {
                let away = (1.0 - cosine).clamp(0.0, 1.0);
                let fifth = away * away * away * away * away;
                normal_incidence + (Vec3A::ONE - normal_incidence) * fifth
            }
        }
    }

    /// `D G / (4 c_i c_o)` for directions in the frame whose z axis is the normal, both with positive z.
    pub(super) fn lobe(&self, to_light: Vec3A, to_viewer: Vec3A, half: Vec3A) -> f32 {
        distribution(self.alpha, half) * visibility(self.alpha, to_light.z, to_viewer.z)
    }

    /// A facet normal, of those that `to_viewer` sees, for a random point (Heitz 2018).
    pub(super) fn sample_facet(&self, to_viewer: Vec3A, u: [f32; 2]) -> Vec3A {
        visible_normal(self.alpha, to_viewer, u)
    }

    /// Density over directions of the light that [`Self::sample_facet`] leads to.
    pub(super) fn density(&self, to_viewer: Vec3A, half: Vec3A) -> f32 {
        shadowing(self.alpha, to_viewer.z) * distribution(self.alpha, half) / (4.0 * to_viewer.z)
    }
}

/// Share of light under a cosine that the facets do not reflect directly: a mean over visible facets.
///
/// A smooth surface loses light by its few steep facets, those at the rim of the disc that facets are drawn from. So the points,
/// a Fibonacci lattice, crowd there: their squared radius is `1 - t^4` for even `t`, weighted with its derivative.
fn unreflected(alpha: f32, interface: Interface, cosine: f32) -> f32 {
    let golden = 0.5 * (5f64.sqrt() - 1.0);
    let viewer = Vec3A::new((1.0 - cosine * cosine).max(0.0).sqrt(), 0.0, cosine);
    let mut sum = 0.0;
    for k in 0..FACETS {
        let t = (k as f32 + 0.5) / FACETS as f32;
        let half = visible_normal(alpha, viewer, [1.0 - t.powi(4), (f64::from(k) * golden).fract() as f32]);
        let light = 2.0 * viewer.dot(half) * half - viewer;
        let mut lost = 1.0;
        if light.z > 0.0 {
            let facet = match interface {
                Interface::Dielectric { ior } => fresnel_dielectric(viewer.dot(half), ior),
                Interface::Conductor => 1.0,
            };
            let both = visibility(alpha, light.z, viewer.z) * 4.0 * light.z * viewer.z;
            lost -= facet * both / shadowing(alpha, viewer.z);
        }
        sum += 4.0 * t.powi(3) * lost;
    }
    (sum / FACETS as f32).max(0.0)
}

/// GGX: density of facet normals, over solid angle.
fn distribution(alpha: f32, half: Vec3A) -> f32 {
    let squared = alpha * alpha;
    // The sine is squared by itself: one minus the cosine's square would cancel where the surface is smooth.
    let (sine2, cosine2) = (half.x * half.x + half.y * half.y, half.z * half.z);
    let spread = sine2 + squared * cosine2;
    squared / (PI * spread * spread)
}

/// Smith's height-correlated masking and shadowing over `4 c_i c_o`.
fn visibility(alpha: f32, light: f32, viewer: f32) -> f32 {
    let squared = alpha * alpha;
    let root = |c: f32| (squared + (1.0 - squared) * c * c).sqrt();
    0.5 / (light * root(viewer) + viewer * root(light)).max(1e-12)
}

/// Smith's masking of one direction.
fn shadowing(alpha: f32, cosine: f32) -> f32 {
    let squared = alpha * alpha;
    2.0 * cosine / (cosine + (squared + (1.0 - squared) * cosine * cosine).sqrt())
}

fn visible_normal(alpha: f32, viewer: Vec3A, [u, v]: [f32; 2]) -> Vec3A {
    let stretched = Vec3A::new(alpha * viewer.x, alpha * viewer.y, viewer.z).normalize();
    let across = stretched.x * stretched.x + stretched.y * stretched.y;
    let first =
        if across > 1e-12 { Vec3A::new(-stretched.y, stretched.x, 0.0) / across.sqrt() } else { Vec3A::X };
    let second = stretched.cross(first);
    let (radius, angle) = (u.sqrt(), 2.0 * PI * v);
    let a = radius * angle.cos();
    let share = 0.5 * (1.0 + stretched.z);
    let b = (1.0 - share) * (1.0 - a * a).max(0.0).sqrt() + share * radius * angle.sin();
    let normal = a * first + b * second + (1.0 - a * a - b * b).max(0.0).sqrt() * stretched;
    Vec3A::new(alpha * normal.x, alpha * normal.y, normal.z.max(1e-6)).normalize()
}

/// Fresnel's reflectance of unpolarised light that comes from outside.
fn fresnel_dielectric(cosine: f32, ior: f32) -> f32 {
    let cosine = cosine.clamp(0.0, 1.0);
    let inside = (1.0 - (1.0 - cosine * cosine) / (ior * ior)).max(0.0).sqrt();
    let parallel = (ior * cosine - inside) / (ior * cosine + inside);
    let perpendicular = (cosine - ior * inside) / (cosine + ior * inside);
    0.5 * (parallel * parallel + perpendicular * perpendicular)
}
