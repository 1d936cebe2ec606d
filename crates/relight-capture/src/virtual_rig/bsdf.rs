//! How one place of a surface scatters light.

use std::f32::consts::{FRAC_1_PI, PI};

use glam::Vec3A;

use super::microfacet::Microfacets;
use super::random::to_disc;

/// How one place of a surface scatters light.
#[derive(Clone, Copy, Debug)]
pub(super) enum Bsdf<'a> {
    /// Evenly, to both sides.
    Diffuse { reflectance: Vec3A, transmittance: Vec3A },
    /// By rough facets over a matt base: see [`Microfacets`].
    Microfacet { facets: &'a Microfacets, normal_incidence: Vec3A, base: Vec3A },
}

/// The directions of a place: all unit vectors of the world.
#[derive(Clone, Copy, Debug)]
pub(super) struct Facing {
    /// Shading normal, on the viewer's side.
    pub normal: Vec3A,
    /// The triangle's own normal, on the viewer's side.
    pub geometric: Vec3A,
    /// Towards the viewer, or towards where light of a bounce goes.
    pub viewer: Vec3A,
}

impl Facing {
    /// Turns both normals to the viewer's side; a shading normal that still leans away gives way to the triangle's own.
    pub(super) fn towards(viewer: Vec3A, geometric: Vec3A, shading: Vec3A) -> Self {
        let geometric = if geometric.dot(viewer) < 0.0 { -geometric } else { geometric };
        let shading = if shading.dot(geometric) < 0.0 { -shading } else { shading };
        let normal = if shading.dot(viewer) > 1e-3 { shading } else { geometric };
        Self { normal, geometric, viewer }
    }

    fn to_local(self, [x, y]: [Vec3A; 2], v: Vec3A) -> Vec3A {
        Vec3A::new(v.dot(x), v.dot(y), v.dot(self.normal))
    }
}

/// A direction drawn for a bounce.
#[derive(Clone, Copy, Debug)]
pub(super) struct Bounce {
    /// Where light comes from, unit.
    pub direction: Vec3A,
    /// Scattering times cosine over density.
    pub weight: Vec3A,
}

impl Bsdf<'_> {
    /// Scattering times the cosine of the light's direction (both unit, world).
    #[inline]
    pub(super) fn eval(&self, facing: &Facing, light: Vec3A) -> Vec3A {
        let (cosine, side) = (facing.normal.dot(light), facing.geometric.dot(light));
        match *self {
            Bsdf::Diffuse { reflectance, transmittance } => {
                if cosine > 0.0 && side > 0.0 {
                    reflectance * (cosine * FRAC_1_PI)
                } else if cosine < 0.0 && side < 0.0 {
                    transmittance * (-cosine * FRAC_1_PI)
                } else {
                    Vec3A::ZERO
                }
            }
            Bsdf::Microfacet { facets, normal_incidence, base } => {
                if cosine <= 0.0 || side <= 0.0 {
                    return Vec3A::ZERO;
                }
                let axes = tangents(facing.normal);
                let (to_light, to_viewer) =
                    (facing.to_local(axes, light), facing.to_local(axes, facing.viewer));
                scattering(facets, normal_incidence, base, to_light, to_viewer) * cosine
            }
        }
    }

    /// Draws a direction for light to come from; `None` where all of it is absorbed.
    pub(super) fn sample(&self, facing: &Facing, u: [f32; 2], choice: f32) -> Option<Bounce> {
        let axes = tangents(facing.normal);
        let to_world = |v: Vec3A| (axes[0] * v.x + axes[1] * v.y + facing.normal * v.z).normalize();
        match *self {
            Bsdf::Diffuse { reflectance, transmittance } => {
                let [back, through] = [reflectance, transmittance].map(Vec3A::max_element);
                if back + through <= 0.0 {
                    return None;
                }
                let share = back / (back + through);
                let local = cosine_hemisphere(u);
                let reflects = choice < share;
                let direction =
                    to_world(if reflects { local } else { Vec3A::new(local.x, local.y, -local.z) });
                let consistent = (facing.geometric.dot(direction) > 0.0) == reflects;
                let weight = if reflects { reflectance / share } else { transmittance / (1.0 - share) };
                consistent.then_some(Bounce { direction, weight })
            }
            Bsdf::Microfacet { facets, normal_incidence, base } => {
                let to_viewer = facing.to_local(axes, facing.viewer);
                let under = facets.unreflected(to_viewer.z);
                let (facet, matt) = (
                    facets.fresnel(to_viewer.z, normal_incidence).max_element(),
                    base.max_element() * under * facets.mean_unreflected(),
                );
                let share = (facet / (facet + matt).max(1e-9)).clamp(0.1, 0.95);
                let to_light = if choice < share {
                    let half = facets.sample_facet(to_viewer, u);
                    2.0 * to_viewer.dot(half) * half - to_viewer
                } else {
                    cosine_hemisphere(u)
                };
                if to_light.z <= 0.0 {
                    return None;
                }
                let half = (to_light + to_viewer).normalize();
                let density =
                    share * facets.density(to_viewer, half) + (1.0 - share) * to_light.z * FRAC_1_PI;
                let value = scattering(facets, normal_incidence, base, to_light, to_viewer) * to_light.z;
                let direction = to_world(to_light);
                (facing.geometric.dot(direction) > 0.0)
                    .then_some(Bounce { direction, weight: value / density })
            }
        }
    }
}

/// Facets and base together, for local directions with positive z.
#[inline]
fn scattering(
    facets: &Microfacets,
    normal_incidence: Vec3A,
    base: Vec3A,
    to_light: Vec3A,
    to_viewer: Vec3A,
) -> Vec3A {
    let half = (to_light + to_viewer).normalize();
    let fresnel = facets.fresnel(to_light.dot(half), normal_incidence);
    let under = facets.unreflected(to_light.z) * facets.unreflected(to_viewer.z) / PI;
    fresnel * facets.lobe(to_light, to_viewer, half) + base * under
}

/// Two unit vectors that are square to a unit vector and to each other (Duff et al. 2017).
pub(super) fn tangents(n: Vec3A) -> [Vec3A; 2] {
    let sign = 1f32.copysign(n.z);
    let a = -1.0 / (sign + n.z);
    let b = n.x * n.y * a;
    [Vec3A::new(1.0 + sign * n.x * n.x * a, sign * b, -sign * n.x), Vec3A::new(b, sign + n.y * n.y * a, -n.y)]
}

/// A direction of the upper hemisphere, with a density of its cosine over pi.
fn cosine_hemisphere(u: [f32; 2]) -> Vec3A {
    let [x, y] = to_disc(u);
    Vec3A::new(x, y, (1.0 - x * x - y * y).max(1e-12).sqrt())
}
