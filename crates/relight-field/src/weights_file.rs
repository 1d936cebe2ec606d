//! The weights file: a field in the safetensors format.
//!
//! Tensors are `grid.table` `[entries, features]` and `geo.N.weight`, `rgb.N.weight`, `vis.N.weight` `[out, in]`, all `f32`.
//! The metadata, a map of strings, holds `format`, `model`, and as JSON `bounds` (`[[lo], [hi]]`, metres), `grid`
//! (with the `resolutions` of its levels, in cells an axis) and `density_scale` (per metre). Single-precision numbers are
//! written with all the digits of their double, so that readers in either precision get the very same.

use std::collections::{BTreeMap, HashMap};
use std::fs::File;
use std::io::{self, Read, Write};
use std::path::{Path, PathBuf};

use relight_scene::{Bounds, write_whole};
use safetensors::tensor::{Dtype, Metadata, TensorInfo, TensorView};
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};

use crate::architecture::Architecture;
use crate::parameters::{FieldConfig, GridConfig, ParameterError, Parameters};
use crate::tensor_file;

/// The version of the format that is written, and the only one that is read.
pub const FORMAT: &str = "relight-1";
/// Longest header that is read; those written have about 2 kB.
const MAX_HEADER: u64 = 1 << 16;

/// What can go wrong with a weights file.
#[derive(Debug, thiserror::Error)]
#[error("{path}: {fault}")]
pub struct WeightsError {
    /// The file.
    pub path: PathBuf,
    /// What is wrong with it.
    #[source]
    pub fault: WeightsFault,
}

/// What is wrong with a weights file.
#[derive(Debug, thiserror::Error)]
pub enum WeightsFault {
    /// It cannot be read or written.
    #[error("{0}. Check the path, its permissions and the space left on the disk")]
    Io(#[from] io::Error),
    /// It is not a whole safetensors file.
    #[error("not a whole safetensors file: {0}")]
    Malformed(String),
    /// It is a safetensors file of something else.
    #[error("no weights of a relightable field: the metadata has no `{0}`")]
    Foreign(&'static str),
    /// It has been written by another version.
    #[error("format `{0}` is not known; this program reads `{FORMAT}`. Use the program that wrote it")]
    Version(String),
    /// A metadata entry does not say what it should.
    #[error("metadata `{key}`: {reason}")]
    Metadata {
        /// Which entry.
        key: &'static str,
        /// What is wrong with it.
        reason: String,
    },
    /// The field itself is not valid.
    #[error("{0}")]
    Parameters(#[from] ParameterError),
}

/// The entry `grid`.
#[derive(Serialize, Deserialize)]
struct GridEntry {
    #[serde(flatten)]
    config: GridConfig,
    resolutions: Vec<u32>,
}

impl GridEntry {
    fn new(config: GridConfig) -> Self {
        Self { config, resolutions: config.level_table().iter().map(|l| l.resolution).collect() }
    }
}

/// Writes a field, first to a temporary file beside `path`, which then takes its place.
///
/// # Errors
/// [`WeightsError`] if the field is not valid or not one of the paper's variants, or if the file cannot be written.
pub fn save(parameters: &Parameters, path: &Path) -> Result<(), WeightsError> {
    write(parameters, path).map_err(|fault| WeightsError { path: path.to_owned(), fault })
}

/// Reads a field.
///
/// # Errors
/// [`WeightsError`] if the file cannot be read, is not a whole weights file of version [`FORMAT`], or holds weights
/// of wrong shapes or that are not finite.
pub fn load(path: &Path) -> Result<Parameters, WeightsError> {
    read(path).map_err(|fault| WeightsError { path: path.to_owned(), fault })
}

fn write(parameters: &Parameters, path: &Path) -> Result<(), WeightsFault> {
    parameters.validate()?;
    let config = &parameters.config;
    let model = config.architecture.name();
    if Architecture::named(model).is_none() {
        let reason = "the format has no name for this architecture".to_owned();
        return Err(WeightsFault::Metadata { key: "model", reason });
    }
    let metadata = BTreeMap::from([
        ("format", FORMAT.to_owned()),
        ("model", model.to_owned()),
        ("bounds", json("bounds", &[config.bounds.lo.map(f64::from), config.bounds.hi.map(f64::from)])?),
        ("grid", json("grid", &GridEntry::new(config.grid))?),
        ("density_scale", json("density_scale", &f64::from(config.density_scale))?),
    ]);
    let malformed = |e: safetensors::SafeTensorError| WeightsFault::Malformed(e.to_string());
    let tensors: Vec<(String, [usize; 2], Vec<u8>)> = parameters
        .tensors()
        .into_iter()
        .map(|(name, shape, values)| (name, shape, values.iter().flat_map(|v| v.to_le_bytes()).collect()))
        .collect();
    let views = tensors
        .iter()
        .map(|(name, shape, bytes)| Ok((name.clone(), TensorView::new(Dtype::F32, shape.to_vec(), bytes)?)))
        .collect::<Result<Vec<_>, _>>()
        .map_err(malformed)?;
    let bytes = tensor_file::serialize(views, &metadata).map_err(malformed)?;
    Ok(write_whole(path, |file| file.write_all(&bytes))?)
}

fn read(path: &Path) -> Result<Parameters, WeightsFault> {
    let mut file = File::open(path)?;
    let length = file.metadata()?.len();
    let cut = |e: io::Error| match e.kind() {
        io::ErrorKind::UnexpectedEof => WeightsFault::Malformed("it ends too early".to_owned()),
        _ => WeightsFault::Io(e),
    };
    let mut size = [0; 8];
    file.read_exact(&mut size).map_err(cut)?;
    let size = u64::from_le_bytes(size);
    if size > MAX_HEADER {
        return Err(WeightsFault::Malformed(format!("a header of {size} bytes")));
    }
    let mut header = vec![0; size as usize];
    file.read_exact(&mut header).map_err(cut)?;
    let header: Metadata =
        serde_json::from_slice(&header).map_err(|e| WeightsFault::Malformed(format!("its header: {e}")))?;
    let none = HashMap::new();
    let config = config(header.metadata().as_ref().unwrap_or(&none))?;

    // What the file must hold is known before any of it is read, so that a hostile header cannot ask for memory.
    let expected = config.tensor_shapes();
    let numbers: usize = expected.iter().map(|(_, [rows, columns])| rows * columns).sum();
    let mut tensors = header.tensors();
    for (name, shape) in &expected {
        let info = tensors.remove(name.as_str());
        check_tensor(name, shape, info)?;
    }
    if let Some(name) = tensors.keys().min() {
        return Err(shape_fault(format!("{name} is no tensor of {}", config.architecture.name())));
    }
    let body = 4 * numbers as u64;
    if length != 8 + size + body {
        let excess = if length < 8 + size + body { "ends too early" } else { "goes on after its end" };
        return Err(WeightsFault::Malformed(format!("it {excess}: {length} bytes, not {}", 8 + size + body)));
    }
    let mut bytes = Vec::with_capacity(body as usize);
    file.take(body).read_to_end(&mut bytes)?;

    let mut parameters = Parameters::zeros(config)?;
    for ((name, _), values) in expected.iter().zip(parameters.tensors_mut()) {
        let begin = header.info(name).map_or(0, |info| info.data_offsets.0);
        let numbers = bytes.get(begin..).unwrap_or_default().as_chunks::<4>().0;
        if numbers.len() < values.len() {
            return Err(WeightsFault::Malformed("it ends too early".to_owned()));
        }
        values.iter_mut().zip(numbers).for_each(|(v, &n)| *v = f32::from_le_bytes(n));
    }
    parameters.validate()?;
    Ok(parameters)
}

/// Refuses a tensor that is missing or of the wrong type or shape.
fn check_tensor(name: &str, shape: &[usize; 2], info: Option<&TensorInfo>) -> Result<(), WeightsFault> {
    match info {
        None => Err(shape_fault(format!("{name} is missing"))),
        Some(info) if info.dtype != Dtype::F32 => {
            Err(shape_fault(format!("{name} holds {}; it must hold F32", info.dtype)))
        }
        Some(info) if info.shape != shape => {
            Err(shape_fault(format!("{name} is {:?}; model and grid ask for {shape:?}", info.shape)))
        }
        Some(_) => Ok(()),
    }
}

fn shape_fault(reason: String) -> WeightsFault {
    WeightsFault::Parameters(ParameterError::Shape(reason))
}

/// The configuration that the metadata describes.
fn config(metadata: &HashMap<String, String>) -> Result<FieldConfig, WeightsFault> {
    let get = |key: &'static str| metadata.get(key).ok_or(WeightsFault::Foreign(key));
    let format = get("format")?;
    if format != FORMAT {
        return Err(WeightsFault::Version(format.clone()));
    }
    let model = get("model")?;
    let architecture = Architecture::named(model).ok_or_else(|| WeightsFault::Metadata {
        key: "model",
        reason: format!("`{model}` is not known; v0 to v5 are"),
    })?;
    let [lo, hi] = parse("bounds", get("bounds")?)?;
    let grid: GridEntry = parse("grid", get("grid")?)?;
    let density_scale = parse("density_scale", get("density_scale")?)?;
    let config = FieldConfig { architecture, grid: grid.config, bounds: Bounds { lo, hi }, density_scale };
    config.validate()?;
    let expected = GridEntry::new(config.grid).resolutions;
    if grid.resolutions != expected {
        let reason = format!("resolutions {:?}; base and finest give {expected:?}", grid.resolutions);
        return Err(WeightsFault::Metadata { key: "grid", reason });
    }
    Ok(config)
}

fn json(key: &'static str, value: &impl Serialize) -> Result<String, WeightsFault> {
    serde_json::to_string(value).map_err(|e| WeightsFault::Metadata { key, reason: e.to_string() })
}

fn parse<T: DeserializeOwned>(key: &'static str, text: &str) -> Result<T, WeightsFault> {
    serde_json::from_str(text).map_err(|e| WeightsFault::Metadata { key, reason: e.to_string() })
}
