//! glTF 2.
//!
//! The crate checks the document; buffers are read here, each range checked against what the file holds.

use std::borrow::Cow;
use std::path::Path;
use std::sync::Arc;

use base64::Engine;
use glam::{DMat4, DVec3, dvec2};
use gltf::accessor::{DataType, Dimensions};
use gltf::{Accessor, Document, Gltf, Node, Primitive, Semantic, mesh::Mode};
use relight_scene::{Image, decode_image, read_bytes};

use super::Model;
use super::error::RigError;
use super::material::Material;
use super::mesh::Mesh;
use super::model_file::{LONGEST_FILE, beside};
use super::texture::{Raster, Texture};

/// Faces without normals are rounded over edges that bend less than this, radians.
const CREASE: f64 = 0.7;
/// Nodes below each other at most; deeper ones go in circles.
const DEEPEST: usize = 64;
/// Meshes placed at most: a small file can ask for billions of copies.
const MOST_PLACED: usize = 100_000;

pub(super) fn read(path: &Path) -> Result<Model, RigError> {
    let bytes = read_bytes(path, LONGEST_FILE)?;
    let damaged = |problem: &str| {
        RigError::file(
            path,
            format!("cannot be read as glTF: {problem}"),
            "Export it again, best as one .glb file",
        )
    };
    // The reader subtracts the header from the stated length without a check.
    if bytes.starts_with(b"glTF") && bytes.get(8..12).is_none_or(|l| le_u32(l) < 20) {
        return Err(damaged("the header states no length"));
    }
    let fault = |error: gltf::Error| damaged(&error.to_string());
    let Gltf { document, blob } = Gltf::from_slice_without_validation(&bytes).map_err(fault)?;
    let json = document.into_json();
    // The validation takes for granted that meshes' positions are there.
    let positions = gltf::json::validation::Checked::Valid(Semantic::Positions);
    let mut primitives = json.meshes.iter().flat_map(|mesh| &mesh.primitives);
    if primitives.any(|p| p.attributes.get(&positions).is_some_and(|i| i.value() >= json.accessors.len())) {
        return Err(damaged("a mesh names positions that are not there"));
    }
    let document = Document::from_json(json).map_err(fault)?;
    let buffers = document
        .buffers()
        .map(|buffer| match buffer.source() {
            gltf::buffer::Source::Bin => {
                blob.as_deref().map(Cow::Borrowed).ok_or_else(|| damaged("the binary part is missing"))
            }
            gltf::buffer::Source::Uri(uri) => resource(path, uri).map(Cow::Owned),
        })
        .collect::<Result<Vec<_>, _>>()?;
    let file = File { path, document: &document, buffers };
    let materials = file.materials()?;
    let mut model = Model::default();
    let scene = document.default_scene().or_else(|| document.scenes().next());
    for node in scene.iter().flat_map(gltf::Scene::nodes) {
        file.place(&node, DMat4::IDENTITY, DEEPEST, &materials, &mut model)?;
    }
    Ok(model)
}

/// The bytes behind a URI: in it, or in a file beside the model.
fn resource(path: &Path, uri: &str) -> Result<Vec<u8>, RigError> {
    match uri.strip_prefix("data:") {
        Some(data) => {
            let (_, text) = data.split_once(";base64,").ok_or_else(|| {
                RigError::file(path, "holds data that are not in base64", "Export it as one .glb file")
            })?;
            base64::engine::general_purpose::STANDARD.decode(text).map_err(|error| {
                RigError::file(path, format!("holds damaged base64: {error}"), "Export it again")
            })
        }
        None => Ok(read_bytes(&beside(path, uri)?, LONGEST_FILE)?),
    }
}

fn le_u32(bytes: &[u8]) -> u32 {
    bytes.iter().rev().fold(0, |sum, &b| sum << 8 | u32::from(b))
}

/// The mean of each channel as it is stored, 0 to 1.
fn means(image: &Image) -> [f64; 3] {
    let sum =
        |channel: usize| image.data.iter().skip(channel).step_by(3).map(|&byte| f64::from(byte)).sum::<f64>();
    let samples = 255.0 * (image.data.len() / 3).max(1) as f64;
    [0, 1, 2].map(|channel| sum(channel) / samples)
}

struct File<'a> {
    path: &'a Path,
    document: &'a Document,
    buffers: Vec<Cow<'a, [u8]>>,
}

impl File<'_> {
    fn fault(&self, problem: impl Into<String>) -> RigError {
        RigError::file(self.path, problem, "Export it again, triangulated and without compression")
    }

    /// Materials in the document's order.
    fn materials(&self) -> Result<Vec<Material>, RigError> {
        self.document.materials().map(|material| self.material(&material)).collect()
    }

    fn material(&self, material: &gltf::Material) -> Result<Material, RigError> {
        let stated = material.pbr_metallic_roughness();
        let [red, green, blue, _] = stated.base_color_factor();
        let factor = [red, green, blue];
        let reflectance = match stated.base_color_texture() {
            Some(texture) => {
                Texture::Raster(Arc::new(self.image(&texture.texture().source())?.times(factor)))
            }
            None => Texture::Uniform(factor),
        };
        // Surfaces have one roughness and are metal or are not: of a picture of both, green and blue, the means.
        let mut factors = [f64::from(stated.roughness_factor()), f64::from(stated.metallic_factor())];
        if let Some(texture) = stated.metallic_roughness_texture() {
            let means = means(&self.decoded(&texture.texture().source())?);
            factors.iter_mut().zip(&means[1..]).for_each(|(factor, mean)| *factor *= mean);
        }
        let [roughness, metallic] = factors;
        // glTF's roughness is the square root of the width.
        let alpha = if roughness.is_finite() { (roughness * roughness).clamp(0.02, 1.0) } else { 1.0 };
        Ok(if metallic > 0.5 {
            Material::Conductor { reflectance, alpha }
        } else {
            Material::Glossy { reflectance, alpha, ior: 1.5 }
        })
    }

    fn image(&self, image: &gltf::Image) -> Result<Raster, RigError> {
        Raster::from_image(&self.decoded(image)?)
    }

    fn decoded(&self, image: &gltf::Image) -> Result<Image, RigError> {
        let bytes = match image.source() {
            gltf::image::Source::View { view, .. } => Cow::Borrowed(self.view(&view)?),
            gltf::image::Source::Uri { uri, .. } => Cow::Owned(resource(self.path, uri)?),
        };
        Ok(decode_image(self.path, &bytes)?)
    }

    fn view(&self, view: &gltf::buffer::View) -> Result<&[u8], RigError> {
        let buffer = self.buffers.get(view.buffer().index());
        let end = view.offset().checked_add(view.length());
        buffer
            .zip(end)
            .and_then(|(buffer, end)| buffer.get(view.offset()..end))
            .ok_or_else(|| self.fault(format!("part {} of its data lies outside the file", view.index())))
    }

    fn place(
        &self,
        node: &Node,
        parent: DMat4,
        depth: usize,
        materials: &[Material],
        model: &mut Model,
    ) -> Result<(), RigError> {
        if depth == 0 {
            return Err(self.fault(format!("its nodes are more than {DEEPEST} deep, or go in circles")));
        }
        let own = DMat4::from_cols_array_2d(&node.transform().matrix().map(|column| column.map(f64::from)));
        let to_world = parent * own;
        for primitive in node.mesh().iter().flat_map(gltf::Mesh::primitives) {
            if model.parts.len() >= MOST_PLACED {
                return Err(self.fault(format!("it places more than {MOST_PLACED} meshes")));
            }
            let material = primitive.material().index().and_then(|i| materials.get(i)).cloned();
            let mesh = self.mesh(&primitive, to_world)?;
            model.push(mesh, material.unwrap_or_else(|| Material::matt([0.6; 3])));
        }
        node.children().try_for_each(|child| self.place(&child, to_world, depth - 1, materials, model))
    }

    fn mesh(&self, primitive: &Primitive, to_world: DMat4) -> Result<Mesh, RigError> {
        if primitive.mode() != Mode::Triangles {
            return Err(self.fault("a mesh is not made of separate triangles"));
        }
        let attribute = |semantic: &Semantic, dimensions: Dimensions| match primitive.get(semantic) {
            Some(accessor) if accessor.dimensions() == dimensions => self.numbers(&accessor),
            Some(_) => Err(self.fault(format!("{semantic:?} of a mesh has the wrong number of components"))),
            None => Ok(Vec::new()),
        };
        let triples =
            |numbers: Vec<f64>| -> Vec<DVec3> { numbers.chunks_exact(3).map(DVec3::from_slice).collect() };
        let positions = triples(attribute(&Semantic::Positions, Dimensions::Vec3)?);
        let normals = triples(attribute(&Semantic::Normals, Dimensions::Vec3)?);
        let set =
            primitive.material().pbr_metallic_roughness().base_color_texture().map_or(0, |t| t.tex_coord());
        let uvs = attribute(&Semantic::TexCoords(set), Dimensions::Vec2)?;
        let indices: Vec<u32> = match primitive.indices() {
            Some(accessor) => self.numbers(&accessor)?.into_iter().map(|i| i as u32).collect(),
            None => (0..positions.len() as u32).collect(),
        };
        if let Some(index) = indices.iter().find(|&&i| i as usize >= positions.len()) {
            return Err(self.fault(format!("a triangle names position {index} of {}", positions.len())));
        }
        // Normals go with the inverse transpose, which a singular matrix lacks.
        let turn = glam::DMat3::from_mat4(to_world);
        let cofactors = glam::DMat3::from_cols(
            turn.y_axis.cross(turn.z_axis),
            turn.z_axis.cross(turn.x_axis),
            turn.x_axis.cross(turn.y_axis),
        );
        let held = positions.len();
        let mesh = Mesh {
            positions: positions.into_iter().map(|p| to_world.transform_point3(p)).collect(),
            normals: normals.into_iter().map(|n| (cofactors * n).normalize_or(DVec3::Z)).collect(),
            uvs: uvs.chunks_exact(2).map(|t| dvec2(t[0], t[1])).collect(),
            triangles: indices.chunks_exact(3).map(|t| [t[0], t[1], t[2]]).collect(),
        };
        if (mesh.normals.len() != held && !mesh.normals.is_empty())
            || (mesh.uvs.len() != held && !mesh.uvs.is_empty())
        {
            return Err(self.fault("a mesh has more or fewer normals or texture coordinates than positions"));
        }
        Ok(if mesh.normals.is_empty() { mesh.smoothed(CREASE) } else { mesh })
    }

    /// All components of an accessor, one after another.
    fn numbers(&self, accessor: &Accessor) -> Result<Vec<f64>, RigError> {
        if accessor.sparse().is_some() {
            return Err(self.fault("sparse accessors are not read"));
        }
        let view = accessor.view().ok_or_else(|| self.fault("an accessor has no data"))?;
        let data = self.view(&view)?;
        let (width, components) = (accessor.data_type().size(), accessor.dimensions().multiplicity());
        let element = width * components;
        let stride = view.stride().unwrap_or(element).max(element);
        let outside = || self.fault(format!("accessor {} reaches beyond its data", accessor.index()));
        // Checked before anything is allocated.
        let last = accessor.count().checked_sub(1).and_then(|n| n.checked_mul(stride));
        let end = last.and_then(|l| l.checked_add(element)).and_then(|l| l.checked_add(accessor.offset()));
        if accessor.count() > 0 && end.is_none_or(|end| end > data.len()) {
            return Err(outside());
        }
        let mut numbers = Vec::with_capacity(accessor.count() * components);
        for i in 0..accessor.count() {
            let start = accessor.offset() + i * stride;
            let bytes = data.get(start..start + element).ok_or_else(outside)?;
            numbers.extend(
                bytes.chunks_exact(width).map(|b| number(b, accessor.data_type(), accessor.normalized())),
            );
        }
        Ok(numbers)
    }
}

fn number(bytes: &[u8], kind: DataType, normalized: bool) -> f64 {
    let raw = le_u32(bytes);
    let (value, full) = match kind {
        DataType::I8 => (f64::from(raw as u8 as i8), 127.0),
        DataType::U8 => (f64::from(raw as u8), 255.0),
        DataType::I16 => (f64::from(raw as u16 as i16), 32_767.0),
        DataType::U16 => (f64::from(raw as u16), 65_535.0),
        DataType::U32 => (f64::from(raw), 1.0),
        DataType::F32 => (f64::from(f32::from_bits(raw)), 1.0),
    };
    if normalized { (value / full).max(-1.0) } else { value }
}
