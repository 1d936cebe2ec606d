//! What is needed to continue a run after a kill at any instant: weights, the engine's state and the trainer's own,
//! together in one safetensors file, so that they cannot come from different steps.

use std::borrow::Cow;
use std::collections::BTreeMap;
use std::io::Write;
use std::path::Path;

use relight_field::engine::{EngineState, StateTensor};
use relight_field::parameters::Parameters;
use relight_field::tensor_file;
use relight_scene::read_bytes;
use safetensors::{Dtype, SafeTensors, View};
use serde::{Deserialize, Serialize};

use crate::TrainError;
use crate::run::write_whole;

/// Format and version of the file, under `format` in its metadata.
const FORMAT: &str = "relight-checkpoint-1";
/// Longest file, bytes: this many times the weights, whose moments and counters an engine keeps, and this much besides.
const TIMES_WEIGHTS: usize = 16;
const BESIDES: usize = 1 << 26;
/// Before the names of the engine's arrays.
const STATE: &str = "state.";

/// The best validation so far.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Best {
    /// Steps taken when it was measured.
    pub step: u64,
    /// PSNR, dB.
    pub psnr: f64,
}

/// Where a training stands.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Standing {
    /// Steps taken.
    pub step: u64,
    /// Seconds of training, over all resumptions.
    pub seconds: f64,
    /// Camera rays marched.
    pub rays: u64,
    /// Pixel-light pairs compared.
    pub pixels: u64,
    /// Steps since the last line of metrics.
    pub unreported: u64,
    /// Sum of their losses.
    pub loss_sum: f64,
    /// Sum of their depth spreads.
    pub spread_sum: f64,
    /// The best validation.
    pub best: Option<Best>,
    /// Validation PSNR of the last improvement that counted, dB.
    pub reference: Option<f64>,
    /// Epochs since validation last improved.
    pub stale: u32,
    /// Bytes of `metrics.jsonl`.
    pub metrics_bytes: u64,
}

/// A checkpoint.
#[derive(Clone, Debug, PartialEq)]
pub struct Checkpoint {
    /// The weights.
    pub parameters: Parameters,
    /// The engine's state.
    pub engine: EngineState,
    /// The trainer's state.
    pub standing: Standing,
}

/// One array as safetensors wants it.
struct Array<'a> {
    dtype: Dtype,
    shape: [usize; 1],
    bytes: &'a [u8],
}

impl<'a> Array<'a> {
    fn of_f32(values: &'a [f32]) -> Self {
        Self { dtype: Dtype::F32, shape: [values.len()], bytes: bytemuck::cast_slice(values) }
    }
}

impl View for Array<'_> {
    fn dtype(&self) -> Dtype {
        self.dtype
    }

    fn shape(&self) -> &[usize] {
        &self.shape
    }

    fn data(&self) -> Cow<'_, [u8]> {
        Cow::Borrowed(self.bytes)
    }

    fn data_len(&self) -> usize {
        self.bytes.len()
    }
}

impl Checkpoint {
    /// Writes the checkpoint to `path`, replacing an earlier one only when it is whole.
    ///
    /// # Errors
    /// [`TrainError::Io`] or [`TrainError::Run`] if it cannot be written.
    pub fn save(&self, path: &Path) -> Result<(), TrainError> {
        let mut arrays: Vec<(String, Array<'_>)> = self
            .parameters
            .tensors()
            .into_iter()
            .map(|(name, _, values)| (name, Array::of_f32(values)))
            .collect();
        for (name, tensor) in &self.engine {
            let array = match tensor {
                StateTensor::F32(values) => Array::of_f32(values),
                StateTensor::U32(values) => {
                    Array { dtype: Dtype::U32, shape: [values.len()], bytes: bytemuck::cast_slice(values) }
                }
                StateTensor::U8(values) => Array { dtype: Dtype::U8, shape: [values.len()], bytes: values },
            };
            arrays.push((format!("{STATE}{name}"), array));
        }
        let broken = |e: &dyn std::fmt::Display| TrainError::run(path, e.to_string());
        let metadata = BTreeMap::from([
            ("format", FORMAT.to_owned()),
            ("standing", serde_json::to_string(&self.standing).map_err(|e| broken(&e))?),
            ("field", serde_json::to_string(&self.parameters.config).map_err(|e| broken(&e))?),
        ]);
        let bytes = tensor_file::serialize(arrays, &metadata).map_err(|e| broken(&e))?;
        write_whole(path, |file| file.write_all(&bytes))
    }

    /// Reads the checkpoint at `path` of a field like `parameters`; `None` if there is none.
    ///
    /// # Errors
    /// [`TrainError::Run`] if it is not a checkpoint of that field; [`TrainError::Scene`] if it cannot be read.
    pub fn load(path: &Path, mut parameters: Parameters) -> Result<Option<Self>, TrainError> {
        if !path.try_exists().map_err(TrainError::io(path))? {
            return Ok(None);
        }
        let weights: usize = parameters.tensors().iter().map(|(_, _, values)| size_of_val(*values)).sum();
        let bytes = read_bytes(path, (TIMES_WEIGHTS * weights + BESIDES) as u64)?;
        let broken = |problem: String| {
            TrainError::run(
                path,
                format!("{problem}: delete the file to start the run again from its first step"),
            )
        };
        let (_, metadata) = SafeTensors::read_metadata(&bytes).map_err(|e| broken(e.to_string()))?;
        let metadata = metadata.metadata().as_ref();
        let entry = |key: &str| metadata.and_then(|m| m.get(key)).map_or("", String::as_str);
        if entry("format") != FORMAT {
            return Err(broken(format!("format \"{}\" is unknown, {FORMAT} was expected", entry("format"))));
        }
        let standing = serde_json::from_str(entry("standing")).map_err(|e| broken(e.to_string()))?;
        let field = serde_json::to_string(&parameters.config).map_err(|e| broken(e.to_string()))?;
        if entry("field") != field {
            return Err(broken("belongs to a field of another shape than config.toml says".into()));
        }

        let file = SafeTensors::deserialize(&bytes).map_err(|e| broken(e.to_string()))?;
        let names: Vec<String> =
            parameters.config.tensor_shapes().into_iter().map(|(name, _)| name).collect();
        for (name, values) in names.iter().zip(parameters.tensors_mut()) {
            let array = file.tensor(name).map_err(|e| broken(e.to_string()))?;
            if array.dtype() != Dtype::F32 || array.data().len() != values.len() * 4 {
                return Err(broken(format!("{name} has not the shape that config.toml says")));
            }
            values.copy_from_slice(&bytemuck::pod_collect_to_vec::<u8, f32>(array.data()));
        }
        let mut engine = EngineState::new();
        for (name, array) in file.tensors() {
            let Some(name) = name.strip_prefix(STATE) else { continue };
            let tensor = match array.dtype() {
                Dtype::F32 => StateTensor::F32(bytemuck::pod_collect_to_vec(array.data())),
                Dtype::U32 => StateTensor::U32(bytemuck::pod_collect_to_vec(array.data())),
                Dtype::U8 => StateTensor::U8(array.data().to_vec()),
                other => return Err(broken(format!("{name} holds {other:?}, which no engine writes"))),
            };
            engine.insert(name.to_owned(), tensor);
        }
        Ok(Some(Self { parameters, engine, standing }))
    }
}
