//! OBJ and glTF files, sound and hostile.

use std::path::Path;

use glam::DVec3;
use proptest::prelude::*;
use relight_scene::Image;

use super::super::stage::{OBJECT_HALF, OBJECT_HEIGHT};
use super::super::{Material, Model, RigError, Texture, read_model};

/// A pyramid one wide along x and z and two high along y, with a texture.
const OBJ: &str = "mtllib p.mtl\nusemtl skin\nv 0 0 0\nv 1 0 0\nv 1 0 1\nv 0 0 1\nv 0.5 2 0.5\nvt 0 0\nvt 1 0\nvt 0.5 1\n\
    f 1/1 2/2 5/3\nf 2/1 3/2 5/3\nf 3/1 4/2 5/3\nf 4/1 1/2 5/3\nf 4/1 3/2 2/3 1/3\n";

fn write(folder: &Path, name: &str, bytes: &[u8]) -> std::path::PathBuf {
    let path = folder.join(name);
    std::fs::write(&path, bytes).unwrap();
    path
}

fn check_pyramid(model: &Model) {
    let used = model.parts.iter().flat_map(|p| p.mesh.positions.iter().copied());
    let (mut low, mut high) = (DVec3::INFINITY, DVec3::NEG_INFINITY);
    for p in used {
        (low, high) = (low.min(p), high.max(p));
    }
    // Twice as high as wide: the box's height is what it meets first, and +Y has become +Z.
    assert!((high.z - OBJECT_HEIGHT).abs() < 1e-9 && low.z.abs() < 1e-9, "{low} {high}");
    assert!((high.x - OBJECT_HEIGHT / 4.0).abs() < 1e-9 && (low.x + high.x).abs() < 1e-9, "{low} {high}");
    assert!((low.y + high.y).abs() < 1e-9 && high.y < OBJECT_HALF);
    let top = model.parts[0].mesh.positions.iter().max_by(|a, b| a.z.total_cmp(&b.z)).unwrap();
    assert!(top.x.abs() < 1e-9 && top.y.abs() < 1e-9);
}

#[test]
fn an_obj_is_read_with_its_texture() {
    let folder = tempfile::tempdir().unwrap();
    let path = write(folder.path(), "p.obj", OBJ.as_bytes());
    write(folder.path(), "p.mtl", b"newmtl skin\nKd 1 1 1\nmap_Kd t.png\n");
    let fault = read_model(&path).unwrap_err().to_string();
    assert!(fault.contains("t.png"), "{fault}");
    // Red above, blue below.
    let image = Image { width: 1, height: 2, data: vec![255, 0, 0, 0, 0, 255] };
    image.write_png(&folder.path().join("t.png")).unwrap();
    let model = read_model(&path).unwrap();
    check_pyramid(&model);
    let Material::Lambert { reflectance } = &model.parts[0].material else { panic!("matt") };
    assert!(matches!(reflectance, Texture::Raster(_)));
    // v counts upwards in OBJ: its 0.75 is the picture's upper half.
    assert_eq!(reflectance.at([0.5, 1.0 - 0.75], glam::Vec3A::ZERO).to_array(), [1.0, 0.0, 0.0]);
    let uv = model.parts[0].mesh.uvs[0];
    assert!((uv.y - 1.0).abs() < 1e-9, "{uv}");
}

#[test]
fn hostile_objs_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let fault =
        |text: &str| read_model(&write(folder.path(), "h.obj", text.as_bytes())).unwrap_err().to_string();
    assert!(fault("").contains("no triangles"));
    assert!(fault("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 9\n").contains("h.obj"));
    assert!(fault("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 -4\n").contains("-4"));
    assert!(fault("v 0 0 0\nvt 0 0\nf 1/-9223372036854775808 1/1 1/1\n").contains("not there"));
    assert!(fault("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 99999999999999999999\n").contains("not there"));
    assert!(fault("v 0 nan 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n").contains("finite"));
    assert!(fault("v 0 0 0\nv 0 0 0\nv 0 0 0\nf 1 2 3\n").contains("finite size"));
    assert!(fault("mtllib ../../etc/passwd\nv 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n").contains("own folder"));
    assert!(fault("mtllib none.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n").contains("none.mtl"));
    let other = read_model(&write(folder.path(), "h.stl", b"solid")).unwrap_err().to_string();
    assert!(other.contains(".glb"));
    assert!(read_model(&folder.path().join("missing.obj")).is_err());
}

/// The pyramid as glTF: positions and indices in one buffer, given in base64; replaced words make it hostile.
fn gltf(replace: &[(&str, &str)]) -> String {
    use base64::Engine;
    let positions: [[f32; 3]; 5] =
        [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 0.0, 1.0], [0.0, 0.0, 1.0], [0.5, 2.0, 0.5]];
    let indices: [u16; 18] = [0, 1, 4, 1, 2, 4, 2, 3, 4, 3, 0, 4, 3, 2, 1, 3, 1, 0];
    let mut bytes: Vec<u8> = positions.iter().flatten().flat_map(|v| v.to_le_bytes()).collect();
    bytes.extend(indices.iter().flat_map(|i| i.to_le_bytes()));
    let data = base64::engine::general_purpose::STANDARD.encode(&bytes);
    let mut text = format!(
        r#"{{"asset":{{"version":"2.0"}},"scene":0,"scenes":[{{"nodes":[0]}}],
        "nodes":[{{"children":[1],"scale":[2,2,2]}},{{"mesh":0,"translation":[5,1,0]}}],
        "meshes":[{{"primitives":[{{"attributes":{{"POSITION":0}},"indices":1,"material":0}}]}}],
        "materials":[{{"pbrMetallicRoughness":{{"baseColorFactor":[0.9,0.5,0.2,1],"metallicFactor":1,"roughnessFactor":0.5}}}}],
        "accessors":[{{"bufferView":0,"componentType":5126,"count":5,"type":"VEC3","min":[0,0,0],"max":[1,2,1]}},
        {{"bufferView":1,"componentType":5123,"count":18,"type":"SCALAR"}}],
        "bufferViews":[{{"buffer":0,"byteOffset":0,"byteLength":60}},{{"buffer":0,"byteOffset":60,"byteLength":36}}],
        "buffers":[{{"byteLength":96,"uri":"data:application/octet-stream;base64,{data}"}}]}}"#
    );
    for (from, to) in replace {
        assert!(text.contains(from), "{from}");
        text = text.replace(from, to);
    }
    text
}

/// JSON and a binary part as a `.glb`.
fn glb(json: &str) -> Vec<u8> {
    let mut json = json.as_bytes().to_vec();
    json.resize(json.len().next_multiple_of(4), b' ');
    let mut bytes = b"glTF\x02\0\0\0".to_vec();
    bytes.extend((20 + json.len() as u32).to_le_bytes());
    bytes.extend((json.len() as u32).to_le_bytes());
    bytes.extend(b"JSON");
    bytes.extend(json);
    bytes
}

#[test]
fn a_gltf_is_read_with_its_nodes_and_material() {
    let folder = tempfile::tempdir().unwrap();
    for (name, bytes) in [("p.gltf", gltf(&[]).into_bytes()), ("p.glb", glb(&gltf(&[])))] {
        let model = read_model(&write(folder.path(), name, &bytes)).unwrap();
        check_pyramid(&model);
        let Material::Conductor { reflectance, alpha } = &model.parts[0].material else { panic!("metal") };
        assert!((alpha - 0.25).abs() < 1e-6);
        assert!(matches!(reflectance, Texture::Uniform([0.9, 0.5, 0.2])));
    }
}

/// Exporters keep both in one picture, in green and blue.
#[test]
fn metal_and_roughness_come_from_a_picture_too() {
    let folder = tempfile::tempdir().unwrap();
    for (blue, is_metal) in [(230, true), (20, false)] {
        let picture = Image { width: 2, height: 1, data: vec![0, 255, blue, 0, 153, blue] };
        picture.write_png(&folder.path().join("mr.png")).unwrap();
        let text = gltf(&[
            (r#""roughnessFactor":0.5"#, r#""roughnessFactor":0.5,"metallicRoughnessTexture":{"index":0}"#),
            (r#""accessors""#, r#""textures":[{"source":0}],"images":[{"uri":"mr.png"}],"accessors""#),
        ]);
        let model = read_model(&write(folder.path(), "p.gltf", text.as_bytes())).unwrap();
        let (alpha, is_conductor) = match &model.parts[0].material {
            Material::Conductor { alpha, .. } => (*alpha, true),
            Material::Glossy { alpha, .. } => (*alpha, false),
            other => panic!("{other:?}"),
        };
        assert_eq!(is_conductor, is_metal);
        // The mean of green is 0.8 of its range.
        assert!((alpha - 0.4 * 0.4).abs() < 1e-3, "{alpha}");
    }
}

#[test]
fn hostile_gltfs_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let fault = |replace: &[(&str, &str)]| {
        let path = write(folder.path(), "h.gltf", gltf(replace).as_bytes());
        match read_model(&path) {
            Err(error @ RigError::File { .. }) => error.to_string(),
            Err(RigError::Image(error)) => error.to_string(),
            other => panic!("{replace:?}: {other:?}"),
        }
    };
    fault(&[(r#""count":18"#, r#""count":9999999999999"#)]);
    fault(&[(r#""byteLength":36"#, r#""byteLength":9999999999"#)]);
    fault(&[(r#""byteOffset":60"#, r#""byteOffset":18446744073709551615"#)]);
    fault(&[(r#""componentType":5123"#, r#""componentType":5125"#)]);
    fault(&[(r#""componentType":5126"#, r#""componentType":5121"#)]);
    fault(&[(r#""bufferView":1"#, r#""bufferView":7"#)]);
    fault(&[(r#""POSITION":0"#, r#""POSITION":7"#)]);
    fault(&[(r#""mesh":0"#, r#""children":[0]"#)]);
    fault(&[("base64,", "base64,!")]);
    fault(&[(r#""uri":"data:application"#, r#""uri":"/etc/passwd","name":"data:application"#)]);
    fault(&[(r#""count":5"#, r#""count":3"#)]);
    fault(&[(r#""scale":[2,2,2]"#, r#""scale":[0,0,0]"#)]);
    for bytes in [&b"glTF"[..], b"glTF\x02\0\0\0\0\0\0\0", b"{}", b"", &glb(&gltf(&[]))[..200]] {
        assert!(read_model(&write(folder.path(), "h.glb", bytes)).is_err());
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(200))]
    #[test]
    fn damaged_files_never_panic(place in 0usize..2000, byte: u8, cut in 0usize..2000) {
        let folder = tempfile::tempdir().unwrap();
        for (name, sound) in [("p.obj", OBJ.as_bytes().to_vec()), ("p.gltf", gltf(&[]).into_bytes()), ("p.glb", glb(&gltf(&[])))] {
            let mut bytes = sound;
            let place = place % bytes.len();
            bytes[place] = byte;
            let cut = if cut % 3 == 0 { cut % bytes.len() } else { bytes.len() };
            let _ = read_model(&write(folder.path(), name, &bytes[..cut]));
        }
    }
}
