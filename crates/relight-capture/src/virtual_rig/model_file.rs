//! Models in files, turned upright and fitted into the box that objects stand in.

use std::path::{Component, Path, PathBuf};

use glam::{DMat3, DVec3, dvec3};

use super::Model;
use super::error::RigError;
use super::stage::{OBJECT_HALF, OBJECT_HEIGHT};
use super::{gltf_file, obj_file};

/// A model file's longest length, and that of a file which it names.
pub(super) const LONGEST_FILE: u64 = 1 << 29;

/// Reads a Wavefront OBJ (with its MTL file) or a glTF 2 file (`.glb`, or `.gltf` with its buffers), Y up as both have it; turns
/// it to Z up and fits it into the box that objects stand in, resting on z = 0 about the origin.
///
/// Of materials are read the base colour with its texture, how rough and, in glTF, how metallic they are. Animations, skins,
/// vertex colours and other textures are left out.
///
/// # Errors
/// If the file is of another kind, damaged, holds no triangles, or names files that are missing or outside its folder.
pub fn read_model(path: &Path) -> Result<Model, RigError> {
    let extension = path.extension().map(|e| e.to_string_lossy().to_lowercase()).unwrap_or_default();
    let model = match extension.as_str() {
        "obj" => obj_file::read(path),
        "glb" | "gltf" => gltf_file::read(path),
        _ => Err(RigError::file(
            path,
            "is neither OBJ nor glTF",
            "Give a file that ends in .obj, .glb or .gltf",
        )),
    }?;
    fitted(model).ok_or_else(|| {
        RigError::file(
            path,
            "holds no triangles of a finite size",
            "Export meshes, not points, curves or instances",
        )
    })
}

fn fitted(mut model: Model) -> Option<Model> {
    // +Y becomes +Z, and +Z, where models look, becomes -Y, the stage's open side.
    let upright = DMat3::from_cols(DVec3::X, DVec3::Z, DVec3::NEG_Y);
    for part in &mut model.parts {
        part.mesh = std::mem::take(&mut part.mesh).moved(upright, DVec3::ZERO);
    }
    // Only positions that a triangle uses count.
    let used = model.parts.iter().flat_map(|part| {
        part.mesh.triangles.iter().flatten().filter_map(|&i| part.mesh.positions.get(i as usize).copied())
    });
    let (mut low, mut high) = (DVec3::INFINITY, DVec3::NEG_INFINITY);
    for p in used {
        if !p.is_finite() {
            return None;
        }
        (low, high) = (low.min(p), high.max(p));
    }
    let size = high - low;
    if !size.is_finite() || size.max_element() <= 0.0 {
        return None;
    }
    let room = dvec3(2.0 * OBJECT_HALF, 2.0 * OBJECT_HALF, OBJECT_HEIGHT);
    let scale = (room / size.max(DVec3::splat(1e-9 * size.max_element()))).min_element();
    let foot = dvec3((low.x + high.x) / 2.0, (low.y + high.y) / 2.0, low.z);
    for part in &mut model.parts {
        part.mesh.positions.iter_mut().for_each(|p| *p = (*p - foot) * scale);
    }
    Some(model)
}

/// The file that a model names, beside it or in a folder below.
pub(super) fn beside(model: &Path, name: &str) -> Result<PathBuf, RigError> {
    let relative = Path::new(name);
    let inside = relative.components().all(|part| matches!(part, Component::Normal(_) | Component::CurDir));
    if !inside || name.is_empty() {
        let problem = format!("names the file {name:?}, which is not within its own folder");
        return Err(RigError::file(model, problem, "Copy the file beside the model and name it there"));
    }
    Ok(model.with_file_name("").join(relative))
}
