//! Triangles in a tree of boxes, and the first of them on a ray.

use std::time::Duration;

use glam::{DVec3, Vec3A};
use obvhs::BvhBuildParams;
use obvhs::bvh2::Bvh2;
use obvhs::bvh2::builder::build_bvh2_from_tris;
use obvhs::ray::{Ray, RayHit};
use obvhs::triangle::Triangle as Corners;

use super::error::RigError;
use super::mesh::Mesh;

/// How far outside a triangle's edges a hit still counts, in barycentric units: neighbours overlap rather than gape.
pub(super) const EDGE: f32 = 1e-6;
/// No position may be farther from the origin, metres: single precision would no longer tell surfaces apart.
const FARTHEST: f64 = 100.0;
/// Triangles that fit a rig.
const MOST_TRIANGLES: usize = 20_000_000;

/// All triangles of a rig.
pub(super) struct Geometry {
    pub(super) tree: Bvh2,
    /// In the order of the tree's leaves; a triangle may stand there more than once.
    pub(super) triangles: Vec<Triangle>,
    attributes: Vec<Attributes>,
}

/// A triangle, ready for intersection.
#[derive(Clone, Copy)]
pub(super) struct Triangle {
    pub corner: Vec3A,
    /// From the first corner to the second.
    pub first: Vec3A,
    /// From the first corner to the third.
    pub second: Vec3A,
    /// Their cross product.
    pub normal: Vec3A,
    attributes: u32,
}

struct Attributes {
    normals: [Vec3A; 3],
    uvs: [[f32; 2]; 3],
    surface: u32,
}

/// Where a ray met a surface.
pub(super) struct Hit {
    pub position: Vec3A,
    /// The triangle's own unit normal.
    pub geometric: Vec3A,
    /// The interpolated unit normal.
    pub shading: Vec3A,
    pub uv: [f32; 2],
    /// Which of the rig's surfaces.
    pub surface: u32,
}

impl Geometry {
    /// Puts meshes into a tree; the triangles of mesh `i` have surface `i`. Triangles without an area are left out.
    pub(super) fn new(meshes: &[&Mesh]) -> Result<Self, RigError> {
        let (mut corners, mut attributes) = (Vec::new(), Vec::new());
        for (surface, mesh) in meshes.iter().enumerate() {
            check(mesh)?;
            for t in &mesh.triangles {
                let triangle = Corners {
                    v0: single(mesh.positions[t[0] as usize]),
                    v1: single(mesh.positions[t[1] as usize]),
                    v2: single(mesh.positions[t[2] as usize]),
                };
                let normal = (triangle.v1 - triangle.v0).cross(triangle.v2 - triangle.v0);
                if normal.length_squared() < 1e-30 {
                    continue;
                }
                let flat = normal.normalize();
                attributes.push(Attributes {
                    normals: t.map(|i| mesh.normals.get(i as usize).map_or(flat, |&n| single(n))),
                    uvs: t
                        .map(|i| mesh.uvs.get(i as usize).map_or([0.0; 2], |uv| [uv.x as f32, uv.y as f32])),
                    surface: surface as u32,
                });
                corners.push(triangle);
            }
        }
        if corners.is_empty() {
            return Err(RigError::NoTriangles);
        }
        if corners.len() > MOST_TRIANGLES {
            return Err(RigError::mesh(format!("{} triangles, more than {MOST_TRIANGLES}", corners.len())));
        }
        let tree = build_bvh2_from_tris(&corners, BvhBuildParams::slow_build(), &mut Duration::default());
        let triangles = tree.primitive_indices.iter().map(|&i| Triangle::new(&corners[i as usize], i));
        Ok(Self { triangles: triangles.collect(), tree, attributes })
    }

    /// The first surface that a ray meets, from `origin` along the unit vector `direction`.
    pub(super) fn first_hit(&self, origin: Vec3A, direction: Vec3A) -> Option<Hit> {
        if !origin.is_finite() || !direction.is_finite() {
            return None;
        }
        let (mut hit, mut best) = (RayHit::none(), None);
        self.tree.ray_traverse(Ray::new(origin, direction, 0.0, f32::MAX), &mut hit, |ray, id| {
            match self.triangles[id].intersect(ray.origin, ray.direction) {
                Some((distance, weights)) if distance < ray.tmax => {
                    best = Some((id, weights));
                    distance
                }
                _ => f32::INFINITY,
            }
        });
        best.map(|(id, weights)| self.hit(&self.triangles[id], weights))
    }

    fn hit(&self, triangle: &Triangle, [u, v]: [f32; 2]) -> Hit {
        let attributes = &self.attributes[triangle.attributes as usize];
        let w = 1.0 - u - v;
        let [a, b, c] = attributes.normals;
        let geometric = triangle.normal.normalize();
        let uv = |k: usize| {
            let [a, b, c] = attributes.uvs;
            w * a[k] + u * b[k] + v * c[k]
        };
        Hit {
            position: triangle.corner + u * triangle.first + v * triangle.second,
            geometric,
            shading: (w * a + u * b + v * c).try_normalize().unwrap_or(geometric),
            uv: [uv(0), uv(1)],
            surface: attributes.surface,
        }
    }
}

impl Triangle {
    fn new(corners: &Corners, attributes: u32) -> Self {
        let (first, second) = (corners.v1 - corners.v0, corners.v2 - corners.v0);
        Self { corner: corners.v0, first, second, normal: first.cross(second), attributes }
    }

    /// Distance and barycentric weights of the second and third corner (Moeller and Trumbore 1997).
    fn intersect(&self, origin: Vec3A, direction: Vec3A) -> Option<(f32, [f32; 2])> {
        let across = self.normal.dot(direction);
        if across == 0.0 {
            return None;
        }
        let inverse = 1.0 / across;
        let to_corner = self.corner - origin;
        let r = direction.cross(to_corner);
        let (u, v) = (-r.dot(self.second) * inverse, r.dot(self.first) * inverse);
        let distance = self.normal.dot(to_corner) * inverse;
        let inside = u >= -EDGE && v >= -EDGE && u + v <= 1.0 + EDGE;
        (inside && distance > 0.0).then_some((distance, [u, v]))
    }
}

fn single(v: DVec3) -> Vec3A {
    Vec3A::new(v.x as f32, v.y as f32, v.z as f32)
}

fn check(mesh: &Mesh) -> Result<(), RigError> {
    let held = mesh.positions.len();
    if let Some(index) = mesh.triangles.iter().flatten().find(|&&i| i as usize >= held) {
        return Err(RigError::mesh(format!("a triangle names position {index}, and there are {held}")));
    }
    for (what, there) in [("normals", mesh.normals.len()), ("texture coordinates", mesh.uvs.len())] {
        if there != 0 && there != held {
            return Err(RigError::mesh(format!("{there} {what} for {held} positions")));
        }
    }
    // NaN fails the comparison too.
    if !mesh.positions.iter().all(|p| p.abs().max_element() <= FARTHEST && !p.is_nan()) {
        return Err(RigError::mesh(format!("a position is no number or beyond {FARTHEST} m")));
    }
    if !mesh.normals.iter().all(|n| n.is_finite()) || !mesh.uvs.iter().all(|uv| uv.is_finite()) {
        return Err(RigError::mesh("a normal or a texture coordinate is not a finite number"));
    }
    Ok(())
}
