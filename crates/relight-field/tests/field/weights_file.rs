//! The weights file: what is written is read, and nothing else is.

use std::collections::{BTreeMap, HashMap};
use std::path::PathBuf;

use proptest::prelude::*;
use relight_field::architecture::{V0, V5, VARIANTS};
use relight_field::parameters::Parameters;
use relight_field::weights_file::{load, save};
use safetensors::tensor::{Dtype, TensorView};

use crate::tiny::{config, trained};

fn parameters() -> Parameters {
    trained(config(V0), 2)
}

/// A folder and the path of a weights file in it.
fn place() -> (tempfile::TempDir, PathBuf) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("weights.safetensors");
    (folder, path)
}

/// A valid file's bytes.
fn bytes() -> Vec<u8> {
    let (_folder, path) = place();
    save(&parameters(), &path).unwrap();
    std::fs::read(path).unwrap()
}

/// What `load` says of some bytes.
fn read(bytes: &[u8]) -> Result<Parameters, String> {
    let (_folder, path) = place();
    std::fs::write(&path, bytes).unwrap();
    load(&path).map_err(|e| e.to_string())
}

/// Shape and bytes of tensors by name.
type Tensors = BTreeMap<String, (Vec<usize>, Vec<u8>)>;

/// The bytes of a file with changed metadata and tensors.
fn altered(change: impl Fn(&mut HashMap<String, String>, &mut Tensors)) -> Vec<u8> {
    let valid = bytes();
    let (_, header) = safetensors::SafeTensors::read_metadata(&valid).unwrap();
    let mut metadata = header.metadata().clone().unwrap();
    let mut tensors: Tensors = safetensors::SafeTensors::deserialize(&valid)
        .unwrap()
        .tensors()
        .into_iter()
        .map(|(name, view)| (name, (view.shape().to_vec(), view.data().to_vec())))
        .collect();
    change(&mut metadata, &mut tensors);
    let views = tensors.iter().map(|(name, (shape, data))| {
        (name.as_str(), TensorView::new(Dtype::F32, shape.clone(), data).unwrap())
    });
    safetensors::serialize(views, Some(metadata)).unwrap()
}

fn refused(bytes: &[u8], because: &str) {
    let message = read(bytes).unwrap_err();
    assert!(message.contains(because) && message.contains("weights.safetensors"), "{message}");
}

#[test]
fn every_variant_survives() {
    let (folder, path) = place();
    for (_, architecture) in VARIANTS {
        let parameters = trained(config(architecture), 2);
        save(&parameters, &path).unwrap();
        assert_eq!(load(&path).unwrap(), parameters);
    }
    // No temporary file is left.
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1);
}

#[test]
fn equal_fields_are_equal_files() {
    let first = bytes();
    let header = u64::from_le_bytes(*first.first_chunk().unwrap());
    assert!(header.is_multiple_of(8), "tensors are aligned");
    // Each time a map in random order would come in another.
    for _ in 0..8 {
        assert!(bytes() == first);
    }
}

#[test]
fn a_folder_is_no_file_and_nothing_is_left_in_it() {
    let (folder, _) = place();
    let message = save(&parameters(), folder.path()).unwrap_err().to_string();
    assert!(message.contains("is a folder"), "{message}");
    assert!(save(&parameters(), &folder.path().join("none").join("w.safetensors")).is_err());
    assert!(save(&parameters(), &folder.path().join(".")).is_err());
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0);
}

#[test]
fn metadata_is_as_documented() {
    let valid = bytes();
    let (_, header) = safetensors::SafeTensors::read_metadata(&valid).unwrap();
    let metadata = header.metadata().clone().unwrap();
    assert_eq!(metadata["format"], "relight-1");
    assert_eq!(metadata["model"], "v0");
    // Every digit, so that a reader in double precision has the very numbers that were trained with.
    let bounds: [[f64; 3]; 2] = serde_json::from_str(&metadata["bounds"]).unwrap();
    assert_eq!(bounds, [[-0.5f32, -0.4, 0.0], [0.75, 0.6, 0.8]].map(|corner| corner.map(f64::from)));
    assert_eq!(metadata["density_scale"], "3.0");
    let grid: serde_json::Value = serde_json::from_str(&metadata["grid"]).unwrap();
    let expected = serde_json::json!({
        "levels": 3, "features": 2, "log2_table": 7, "base": 2, "finest": 9, "resolutions": [2, 4, 9]
    });
    assert_eq!(grid, expected);
    assert_eq!(header.info("geo.1.weight").unwrap().shape, [16, 64]);
}

#[test]
fn invalid_weights_are_not_written() {
    let (folder, path) = place();
    let mut parameters = parameters();
    parameters.geo.layers[0].weight[5] = f32::INFINITY;
    assert!(save(&parameters, &path).unwrap_err().to_string().contains("geo.0.weight holds inf"));
    parameters = trained(config(V5), 2);
    parameters.config.architecture.position_skip = false;
    assert!(save(&parameters, &path).is_err());
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0);
}

#[test]
fn foreign_and_future_files_are_refused_by_name() {
    refused(b"", "ends too early");
    refused(b"\x89PNG\r\n\x1a\n and so on", "a header of");
    refused(&altered(|m, _| m.clear()), "no `format`");
    refused(&altered(|m, _| drop(m.insert("format".into(), "relight-9".into()))), "`relight-9` is not known");
    refused(&altered(|m, _| drop(m.insert("model".into(), "v9".into()))), "`v9` is not known");
    let missing = load(&PathBuf::from("/nowhere/weights.safetensors")).unwrap_err().to_string();
    assert!(missing.contains("/nowhere/weights.safetensors"));
}

#[test]
fn contradictory_metadata_is_refused() {
    for (key, value) in [
        ("bounds", "[[0,0,0],[1,1]]"),
        ("bounds", "[[0,0,0],[1,0,1]]"),
        ("bounds", "nonsense"),
        ("density_scale", "-1"),
        ("density_scale", "\"3\""),
        ("grid", "{}"),
        ("grid", r#"{"levels":3,"features":2,"log2_table":7,"base":2,"finest":9,"resolutions":[2,5,9]}"#),
        ("grid", r#"{"levels":4294967295,"features":2,"log2_table":7,"base":2,"finest":9,"resolutions":[]}"#),
        ("grid", r#"{"levels":3,"features":3,"log2_table":7,"base":2,"finest":9,"resolutions":[2,4,9]}"#),
        ("grid", r#"{"levels":3,"features":2,"log2_table":63,"base":2,"finest":9,"resolutions":[2,4,9]}"#),
    ] {
        refused(&altered(|m, _| drop(m.insert(key.into(), value.into()))), key);
    }
    // A larger grid than the tensors have.
    let grid = r#"{"levels":3,"features":2,"log2_table":24,"base":2,"finest":9,"resolutions":[2,4,9]}"#;
    refused(&altered(|m, _| drop(m.insert("grid".into(), grid.into()))), "grid.table is [280, 2]");
    // More features than they have.
    let grid = r#"{"levels":3,"features":4,"log2_table":7,"base":2,"finest":9,"resolutions":[2,4,9]}"#;
    refused(&altered(|m, _| drop(m.insert("grid".into(), grid.into()))), "grid.table is [280, 2]");
}

#[test]
fn wrong_tensors_are_refused() {
    refused(&altered(|_, t| drop(t.remove("rgb.2.weight"))), "rgb.2.weight is missing");
    let reversed = |_: &mut _, t: &mut Tensors| t.get_mut("geo.0.weight").unwrap().0.reverse();
    refused(&altered(reversed), "geo.0.weight is [6, 64]");
    let more = |_: &mut _, t: &mut Tensors| drop(t.insert("more".into(), (vec![0], vec![])));
    refused(&altered(more), "more is no tensor of v0");
    let nan = |_: &mut _, t: &mut Tensors| {
        t.get_mut("geo.1.weight").unwrap().1[..4].copy_from_slice(&f32::NAN.to_le_bytes());
    };
    refused(&altered(nan), "geo.1.weight holds NaN at index 0");
    let mut longer = bytes();
    longer.push(0);
    refused(&longer, "goes on after its end");
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 64, failure_persistence: None, ..ProptestConfig::default() })]

    /// A file cut anywhere is refused.
    #[test]
    fn truncated_files_are_refused(share in 0.0..1.0f64) {
        let valid = bytes();
        let cut = (share * valid.len() as f64) as usize;
        prop_assert!(read(&valid[..cut]).is_err());
    }

    /// A file with a damaged header is refused or read; it never panics. The body has no redundancy.
    #[test]
    fn damaged_headers_do_no_harm(at in 0usize..1200, byte in any::<u8>(), again in 0usize..1200, other in any::<u8>()) {
        let mut damaged = bytes();
        damaged[at] = byte;
        damaged[again] = other;
        if let Ok(parameters) = read(&damaged) {
            prop_assert!(parameters.validate().is_ok());
        }
    }
}
