//! Triangle meshes.

use std::collections::HashMap;

use glam::{DMat3, DVec2, DVec3};

/// A triangle mesh, metres. Every corner of a triangle has a position, and may have a normal and a place in the texture.
#[derive(Clone, Debug, Default)]
pub struct Mesh {
    /// Corner positions.
    pub positions: Vec<DVec3>,
    /// Unit normals, one a position, or none at all: then faces are flat.
    pub normals: Vec<DVec3>,
    /// Texture coordinates, one a position, or none at all. (0, 0) is the texture's top left, v grows downwards; the
    /// texture repeats outside the unit square.
    pub uvs: Vec<DVec2>,
    /// Triangles, as three indices of positions each.
    pub triangles: Vec<[u32; 3]>,
}

impl Mesh {
    /// A mesh with flat faces.
    pub fn flat(positions: Vec<DVec3>, triangles: Vec<[u32; 3]>) -> Self {
        Self { positions, triangles, ..Self::default() }
    }

    /// The mesh turned, then moved.
    pub fn moved(mut self, rotation: DMat3, translation: DVec3) -> Self {
        self.positions.iter_mut().for_each(|p| *p = rotation * *p + translation);
        self.normals.iter_mut().for_each(|n| *n = rotation * *n);
        self
    }

    /// The mesh moved.
    pub fn at(self, translation: DVec3) -> Self {
        self.moved(DMat3::IDENTITY, translation)
    }

    /// The mesh turned about the z axis, radians.
    pub fn turned(self, angle: f64) -> Self {
        self.moved(DMat3::from_rotation_z(angle), DVec3::ZERO)
    }

    /// The mesh stretched along the axes; smooth normals follow.
    pub fn stretched(mut self, factors: DVec3) -> Self {
        self.positions.iter_mut().for_each(|p| *p *= factors);
        self.normals.iter_mut().for_each(|n| *n = (*n / factors).normalize_or_zero());
        self
    }

    /// Positions bent by a function of the position; smooth normals are worked out anew.
    pub fn bent(mut self, bend: impl Fn(DVec3) -> DVec3, crease: f64) -> Self {
        self.positions.iter_mut().for_each(|p| *p = bend(*p));
        self.smoothed(crease)
    }

    /// Several meshes as one. Normals and texture coordinates are kept where all of them have some.
    pub fn joined(meshes: impl IntoIterator<Item = Mesh>) -> Self {
        let (mut joined, mut first) = (Mesh::default(), true);
        for mesh in meshes {
            let offset = joined.positions.len() as u32;
            let keep = |held: usize, all: usize, added: usize| (first || held == all) && added > 0;
            let keep_normals = keep(joined.normals.len(), joined.positions.len(), mesh.normals.len());
            let keep_uvs = keep(joined.uvs.len(), joined.positions.len(), mesh.uvs.len());
            joined.positions.extend(&mesh.positions);
            if keep_normals {
                joined.normals.extend(&mesh.normals);
            } else {
                joined.normals.clear();
            }
            if keep_uvs {
                joined.uvs.extend(&mesh.uvs);
            } else {
                joined.uvs.clear();
            }
            joined.triangles.extend(mesh.triangles.iter().map(|t| t.map(|i| i + offset)));
            first = false;
        }
        joined
    }

    /// The mesh with smooth normals: at each corner the area-weighted mean over the faces that meet there and lean less
    /// than `crease` radians from each other. Corners are parted, so that an edge may stay sharp.
    pub fn smoothed(&self, crease: f64) -> Self {
        let corners = |t: &[u32; 3]| t.map(|i| self.positions[i as usize]);
        let areas: Vec<DVec3> = self
            .triangles
            .iter()
            .map(|t| {
                let [a, b, c] = corners(t);
                (b - a).cross(c - a)
            })
            .collect();
        // Positions that agree to a micrometre are one.
        let key = |p: DVec3| [p.x, p.y, p.z].map(|v| (v * 1e6).round() as i64);
        let mut faces_at: HashMap<[i64; 3], Vec<usize>> = HashMap::new();
        for (face, t) in self.triangles.iter().enumerate() {
            for p in corners(t) {
                faces_at.entry(key(p)).or_default().push(face);
            }
        }
        let cosine = crease.cos();
        let mut smooth = Mesh::default();
        for (face, t) in self.triangles.iter().enumerate() {
            let own = areas[face].normalize_or_zero();
            if own == DVec3::ZERO {
                continue;
            }
            let start = smooth.positions.len() as u32;
            for &i in t {
                let p = self.positions[i as usize];
                let near = faces_at[&key(p)].iter().map(|&f| areas[f]);
                let sum: DVec3 = near.filter(|a| a.normalize_or_zero().dot(own) > cosine).sum();
                smooth.positions.push(p);
                smooth.normals.push(sum.try_normalize().unwrap_or(own));
                if let Some(&uv) = self.uvs.get(i as usize) {
                    smooth.uvs.push(uv);
                }
            }
            smooth.triangles.push([start, start + 1, start + 2]);
        }
        smooth
    }

    /// Lowest and highest corner of the box around the mesh; `None` without positions.
    pub fn extent(&self) -> Option<[DVec3; 2]> {
        let first = *self.positions.first()?;
        Some(self.positions.iter().fold([first; 2], |[lo, hi], &p| [lo.min(p), hi.max(p)]))
    }
}
