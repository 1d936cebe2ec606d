//! Wavefront OBJ.

use std::cell::RefCell;
use std::collections::HashMap;
use std::io::Cursor;
use std::path::Path;
use std::sync::Arc;

use glam::{DVec3, dvec2, dvec3};
use relight_scene::{read_bytes, read_image};
use tobj::{LoadError, LoadOptions};

use super::error::RigError;
use super::material::Material;
use super::mesh::Mesh;
use super::model_file::{LONGEST_FILE, beside};
use super::texture::{Raster, Texture};
use super::{Model, Part};

/// Faces without normals are rounded over edges that bend less than this, radians.
const CREASE: f64 = 0.7;

pub(super) fn read(path: &Path) -> Result<Model, RigError> {
    let bytes = read_bytes(path, LONGEST_FILE)?;
    check_indices(path, &bytes)?;
    let options =
        LoadOptions { single_index: true, triangulate: true, ignore_points: true, ignore_lines: true };
    let missing = RefCell::new(None);
    let library = |name: &Path| {
        let found = beside(path, &name.to_string_lossy()).and_then(|p| Ok(read_bytes(&p, LONGEST_FILE)?));
        match found {
            Ok(bytes) => tobj::load_mtl_buf(&mut Cursor::new(bytes)),
            Err(error) => {
                missing.borrow_mut().get_or_insert(error);
                Err(LoadError::OpenFileFailed)
            }
        }
    };
    let loaded = tobj::load_obj_buf(&mut Cursor::new(bytes), &options, library);
    if let Some(error) = missing.into_inner() {
        return Err(error);
    }
    let damaged =
        |error: LoadError| RigError::file(path, format!("cannot be read as OBJ: {error}"), "Export it again");
    let (shapes, materials) = loaded.map_err(damaged)?;
    let materials = materials.map_err(damaged)?;
    let mut textures = HashMap::new();
    let materials =
        materials.iter().map(|m| material(path, m, &mut textures)).collect::<Result<Vec<_>, _>>()?;
    let parts = shapes.into_iter().map(|shape| {
        let material = shape.mesh.material_id.and_then(|id| materials.get(id)).cloned();
        Part { mesh: mesh(&shape.mesh), material: material.unwrap_or_else(|| Material::matt([0.6; 3])) }
    });
    Ok(Model { parts: parts.filter(|part| !part.mesh.triangles.is_empty()).collect() })
}

/// Refuses faces that name what is not there: the reader's own arithmetic may overflow on them.
fn check_indices(path: &Path, bytes: &[u8]) -> Result<(), RigError> {
    let mut held = [0i64; 3];
    for (number, line) in bytes.split(|&b| b == b'\n').enumerate() {
        let line = String::from_utf8_lossy(line);
        let mut words = line.split_whitespace();
        match words.next() {
            Some("v") => held[0] += 1,
            Some("vt") => held[1] += 1,
            Some("vn") => held[2] += 1,
            Some("f" | "l" | "p") => {
                let wrong = words.flat_map(|word| word.split('/').zip(held)).find(|&(index, held)| {
                    let known = |i: i64| (1..=i64::from(u32::MAX)).contains(&i) || (-held..0).contains(&i);
                    !index.is_empty() && !index.parse().is_ok_and(known)
                });
                if let Some((index, _)) = wrong {
                    let problem = format!("line {}: the face names {index}, which is not there", number + 1);
                    return Err(RigError::file(path, problem, "Export the model again"));
                }
            }
            _ => {}
        }
    }
    Ok(())
}

fn mesh(shape: &tobj::Mesh) -> Mesh {
    let triples = |values: &[f32]| -> Vec<DVec3> {
        values.chunks_exact(3).map(|v| dvec3(f64::from(v[0]), f64::from(v[1]), f64::from(v[2]))).collect()
    };
    let positions = triples(&shape.positions);
    // OBJ counts v upwards.
    let uvs: Vec<_> =
        shape.texcoords.chunks_exact(2).map(|t| dvec2(f64::from(t[0]), 1.0 - f64::from(t[1]))).collect();
    let normals: Vec<DVec3> = triples(&shape.normals).into_iter().map(|n| n.normalize_or(DVec3::Z)).collect();
    let held = positions.len();
    let mesh = Mesh {
        triangles: shape.indices.chunks_exact(3).map(|t| [t[0], t[1], t[2]]).collect(),
        uvs: if uvs.len() == held { uvs } else { Vec::new() },
        normals: if normals.len() == held { normals } else { Vec::new() },
        positions,
    };
    if mesh.normals.is_empty() { mesh.smoothed(CREASE) } else { mesh }
}

fn material(
    path: &Path,
    stated: &tobj::Material,
    textures: &mut HashMap<String, Arc<Raster>>,
) -> Result<Material, RigError> {
    let reflectance = match &stated.diffuse_texture {
        Some(name) => {
            if !textures.contains_key(name) {
                let raster = Raster::from_image(&read_image(&beside(path, name)?)?)?;
                textures.insert(name.clone(), Arc::new(raster));
            }
            Texture::Raster(Arc::clone(&textures[name]))
        }
        None => Texture::Uniform(stated.diffuse.unwrap_or([0.6; 3])),
    };
    // Phong's exponent as a GGX width (Walter et al. 2007).
    let shines = stated.specular.is_some_and(|s| s.iter().any(|&v| v > 0.02));
    Ok(match stated.shininess.filter(|n| shines && n.is_finite() && *n > 0.0) {
        Some(exponent) => {
            let alpha = (2.0 / (f64::from(exponent) + 2.0)).sqrt().clamp(0.03, 1.0);
            Material::Glossy { reflectance, alpha, ior: 1.5 }
        }
        None => Material::Lambert { reflectance },
    })
}
