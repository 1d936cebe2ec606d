//! Shapes to build models from, metres.

use std::f64::consts::TAU;

use glam::{DMat3, DVec2, DVec3, dvec2, dvec3};

use super::mesh::Mesh;

/// Edges of faces that lean less than this from each other are rounded, radians.
const CREASE: f64 = 0.6;

/// A parallelogram from a corner along two edges; texture coordinates run from 0 to 1 along each.
pub fn quad(corner: DVec3, across: DVec3, down: DVec3) -> Mesh {
    let positions = vec![corner, corner + across, corner + across + down, corner + down];
    let uvs = vec![dvec2(0.0, 0.0), dvec2(1.0, 0.0), dvec2(1.0, 1.0), dvec2(0.0, 1.0)];
    Mesh { positions, uvs, triangles: vec![[0, 1, 2], [0, 2, 3]], normals: Vec::new() }
}

/// A box between two opposite corners; each face holds the whole texture.
pub fn cuboid(low: DVec3, high: DVec3) -> Mesh {
    let [x, y, z] = [DVec3::X, DVec3::Y, DVec3::Z].map(|axis| axis * (high - low));
    Mesh::joined([
        quad(low + y, x, -y),
        quad(low + z, x, y),
        quad(low + z, x, -z),
        quad(low + y + z, x, -z),
        quad(low + z, y, -z),
        quad(low + x + z, y, -z),
    ])
}

/// A box around a centre.
pub fn block(centre: DVec3, size: DVec3) -> Mesh {
    cuboid(centre - size / 2.0, centre + size / 2.0)
}

/// A grid of `columns` x `rows` quads over the unit square of (u, v), mapped by a function; smooth.
pub fn patch(columns: usize, rows: usize, place: impl Fn(f64, f64) -> DVec3) -> Mesh {
    let mut mesh = Mesh::default();
    for j in 0..=rows {
        for i in 0..=columns {
            let (u, v) = (i as f64 / columns as f64, j as f64 / rows as f64);
            mesh.positions.push(place(u, v));
            mesh.uvs.push(dvec2(u, v));
        }
    }
    let index = |i: usize, j: usize| (j * (columns + 1) + i) as u32;
    for j in 0..rows {
        for i in 0..columns {
            let [a, b, c, d] = [index(i, j), index(i + 1, j), index(i + 1, j + 1), index(i, j + 1)];
            mesh.triangles.extend([[a, b, c], [a, c, d]]);
        }
    }
    mesh.smoothed(CREASE)
}

/// A surface of revolution about the z axis: (radius, height) points, joined in order. Edges sharper than some 35 degrees
/// stay sharp.
pub fn lathe(profile: &[[f64; 2]], segments: usize) -> Mesh {
    let mut mesh = Mesh::default();
    let last = (profile.len().max(2) - 1) as f64;
    for (k, &[radius, height]) in profile.iter().enumerate() {
        for i in 0..=segments {
            let turn = i as f64 / segments as f64;
            let (sine, cosine) = (TAU * turn).sin_cos();
            mesh.positions.push(dvec3(radius * cosine, radius * sine, height));
            mesh.uvs.push(dvec2(turn, k as f64 / last));
        }
    }
    let row = segments as u32 + 1;
    for k in 0..profile.len().saturating_sub(1) as u32 {
        for i in 0..segments as u32 {
            let [a, b] = [k * row + i, (k + 1) * row + i];
            mesh.triangles.extend([[a, a + 1, b + 1], [a, b + 1, b]]);
        }
    }
    mesh.smoothed(CREASE)
}

/// A sphere about the origin, `segments` around and half as many from pole to pole; normals are exact.
pub fn sphere(radius: f64, segments: usize) -> Mesh {
    let half = segments.div_ceil(2);
    let profile: Vec<[f64; 2]> = (0..=half)
        .map(|k| {
            let (sine, cosine) = (TAU / 2.0 * k as f64 / half as f64).sin_cos();
            [radius * sine, -radius * cosine]
        })
        .collect();
    let mut mesh = lathe(&profile, segments);
    mesh.normals = mesh.positions.iter().map(|p| p.normalize_or(DVec3::Z)).collect();
    mesh
}

/// A closed cylinder on the plane z = 0 with a small bevel.
pub fn cylinder(radius: f64, height: f64, segments: usize) -> Mesh {
    let bevel = 0.08 * radius.min(height);
    lathe(
        &[
            [0.0, 0.0],
            [radius - bevel, 0.0],
            [radius, bevel],
            [radius, height - bevel],
            [radius - bevel, height],
            [0.0, height],
        ],
        segments,
    )
}

/// A ring about the z axis: distance of its tube's centre line, and the tube's radius.
pub fn torus(distance: f64, radius: f64, segments: usize, around: usize) -> Mesh {
    let profile: Vec<[f64; 2]> = (0..=around)
        .map(|k| {
            let (sine, cosine) = (TAU * k as f64 / around as f64).sin_cos();
            [distance + radius * cosine, radius * sine]
        })
        .collect();
    lathe(&profile, segments)
}

/// A section (counter-clockwise, in the plane across) swept along a path, scaled at each point, closed at both ends. The
/// section does not turn about the path more than the path itself bends.
pub fn sweep(path: &[DVec3], section: &[DVec2], scale: impl Fn(f64) -> f64) -> Mesh {
    let (count, around) = (path.len(), section.len());
    if count < 2 || around < 3 {
        return Mesh::default();
    }
    let tangent =
        |i: usize| (path[(i + 1).min(count - 1)] - path[i.saturating_sub(1)]).normalize_or(DVec3::Z);
    let mut side = tangent(0).any_orthonormal_vector();
    if tangent(0).z.abs() < 0.9 {
        side = tangent(0).cross(DVec3::Z).normalize();
    }
    let mut mesh = Mesh::default();
    for (i, &point) in path.iter().enumerate() {
        let along = tangent(i);
        side = (side - along * along.dot(side)).normalize_or(along.any_orthonormal_vector());
        let up = side.cross(along);
        let share = i as f64 / (count - 1) as f64;
        let size = scale(share);
        for (k, s) in section.iter().chain(&section[..1]).enumerate() {
            mesh.positions.push(point + size * (s.x * side + s.y * up));
            mesh.uvs.push(dvec2(k as f64 / around as f64, share));
        }
    }
    let row = around as u32 + 1;
    for i in 0..count as u32 - 1 {
        for k in 0..around as u32 {
            let [a, b] = [i * row + k, (i + 1) * row + k];
            mesh.triangles.extend([[a, a + 1, b + 1], [a, b + 1, b]]);
        }
    }
    for (start, end) in [(0, path[0]), ((count as u32 - 1) * row, path[count - 1])] {
        let centre = mesh.positions.len() as u32;
        mesh.positions.push(end);
        mesh.uvs.push(dvec2(0.5, 0.5));
        mesh.triangles.extend((0..around as u32).map(|k| [centre, start + k, start + k + 1]));
    }
    mesh.smoothed(CREASE)
}

/// A round section for [`sweep`].
pub fn circle(radius: f64, points: usize) -> Vec<DVec2> {
    (0..points).map(|k| radius * DVec2::from_angle(TAU * k as f64 / points as f64)).collect()
}

/// A rectangular section for [`sweep`]: width across, height along the path's up side.
pub fn strip(width: f64, height: f64) -> Vec<DVec2> {
    let (x, y) = (width / 2.0, height / 2.0);
    vec![dvec2(-x, -y), dvec2(x, -y), dvec2(x, y), dvec2(-x, y)]
}

/// A round rod between two points.
pub fn rod(from: DVec3, to: DVec3, radius: f64, points: usize) -> Mesh {
    sweep(&[from, to], &circle(radius, points), |_| 1.0)
}

/// A flat outline (seen whole from its centre) of some thickness upwards from z = 0.
pub fn plate(outline: &[DVec2], thickness: f64) -> Mesh {
    let count = outline.len() as u32;
    if count < 3 {
        return Mesh::default();
    }
    let centre = outline.iter().sum::<DVec2>() / f64::from(count);
    let mut mesh = Mesh::default();
    for z in [0.0, thickness] {
        mesh.positions.extend(outline.iter().map(|p| p.extend(z)));
    }
    mesh.positions.extend([centre.extend(0.0), centre.extend(thickness)]);
    for k in 0..count {
        let next = (k + 1) % count;
        mesh.triangles.extend([
            [k, next, count + next],
            [k, count + next, count + k],
            [2 * count, next, k],
            [2 * count + 1, count + k, count + next],
        ]);
    }
    mesh.smoothed(CREASE)
}

/// A smooth curve through points (Catmull and Rom 1974), `steps` pieces between each two.
pub fn curve(points: &[DVec3], steps: usize) -> Vec<DVec3> {
    let Some(last) = points.len().checked_sub(1) else { return Vec::new() };
    let at = |i: usize| points[i.min(last)];
    let mut path = Vec::new();
    for i in 0..last {
        let [a, b, c, d] = [at(i.saturating_sub(1)), at(i), at(i + 1), at(i + 2)];
        path.extend((0..steps).map(|k| {
            let t = k as f64 / steps as f64;
            let (t2, t3) = (t * t, t * t * t);
            0.5 * ((2.0 * b)
                + (c - a) * t
                + (2.0 * a - 5.0 * b + 4.0 * c - d) * t2
                + (3.0 * b - 3.0 * c + d - a) * t3)
        }));
    }
    path.push(points[last]);
    path
}

/// The rotation that takes +Z to a direction.
pub fn upright_to(direction: DVec3) -> DMat3 {
    DMat3::from_quat(glam::DQuat::from_rotation_arc(DVec3::Z, direction.normalize_or(DVec3::Z)))
}
