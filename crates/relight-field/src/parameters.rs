//! All that is learned, and what is needed to make sense of it: the hash table, the weights of the three networks,
//! and the configuration that gives them their shapes.

use relight_scene::Bounds;
use serde::{Deserialize, Serialize};

use crate::architecture::Architecture;
use crate::random::Random;
use crate::real::Real;

/// Most levels that a grid may have.
const MAX_LEVELS: usize = 32;
/// Largest `log2_table`: 2^24 entries a level are 128 MiB.
const MAX_LOG2_TABLE: u32 = 24;
/// Most cells an axis of a level; vertex numbers then fit 64 bits with room to spare.
const MAX_RESOLUTION: u32 = 1 << 16;
/// Name of the hash table among the arrays.
const TABLE: &str = "grid.table";
/// Half the width of the interval that the table's first values are drawn from.
const TABLE_INIT: f32 = 1e-4;

/// Shape of the multiresolution hash grid (Mueller et al. 2022, section 3).
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct GridConfig {
    /// Number of levels.
    pub levels: usize,
    /// Features an entry: 2 or 4.
    pub features: usize,
    /// Base-2 logarithm of the largest number of entries a level.
    pub log2_table: u32,
    /// Cells an axis of the coarsest level.
    pub base: u32,
    /// Cells an axis of the finest level.
    pub finest: u32,
}

impl Default for GridConfig {
    /// The defaults of torch-ngp, which the paper uses.
    fn default() -> Self {
        Self { levels: 16, features: 2, log2_table: 19, base: 16, finest: 2048 }
    }
}

/// Where one level lies in the table.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Level {
    /// Cells an axis; the level has `resolution + 1` vertices an axis.
    pub resolution: u32,
    /// First entry of the level in the table.
    pub offset: usize,
    /// Entries of the level: `(resolution + 1)^3`, or the table size where that is smaller.
    pub entries: usize,
    /// Whether vertices are hashed (true) or stored densely (false).
    pub hashed: bool,
}

impl GridConfig {
    /// Checks that the grid can be built.
    ///
    /// # Errors
    /// [`ParameterError::Config`] naming the number that is out of range.
    pub fn validate(&self) -> Result<(), ParameterError> {
        let fault = if ![2, 4].contains(&self.features) {
            format!("grid.features is {}; it must be 2 or 4", self.features)
        } else if !(1..=MAX_LEVELS).contains(&self.levels) {
            format!("grid.levels is {}; it must be 1 to {MAX_LEVELS}", self.levels)
        } else if !(1..=MAX_LOG2_TABLE).contains(&self.log2_table) {
            format!("grid.log2_table is {}; it must be 1 to {MAX_LOG2_TABLE}", self.log2_table)
        } else if !(1..=MAX_RESOLUTION).contains(&self.base) {
            format!("grid.base is {}; it must be 1 to {MAX_RESOLUTION}", self.base)
        } else if !(self.base..=MAX_RESOLUTION).contains(&self.finest) {
            format!(
                "grid.finest is {}; it must be {} (grid.base) to {MAX_RESOLUTION}",
                self.finest, self.base
            )
        } else {
            return Ok(());
        };
        Err(ParameterError::Config(fault))
    }

    /// Numbers in `h(x)`.
    pub fn outputs(&self) -> usize {
        self.levels * self.features
    }

    /// The levels, coarsest first: `floor(base * b^l)` cells, `b = (finest / base)^(1 / (levels - 1))`.
    pub fn level_table(&self) -> Vec<Level> {
        let growth = if self.levels > 1 {
            (f64::from(self.finest) / f64::from(self.base)).powf(1.0 / (self.levels - 1) as f64)
        } else {
            1.0
        };
        let table = 1usize << self.log2_table;
        let mut offset = 0;
        (0..self.levels)
            .map(|l| {
                // The epsilon keeps the last level at `finest` in spite of rounding.
                let resolution = (f64::from(self.base) * growth.powi(l as i32) + 1e-6).floor() as u32;
                let dense = (resolution as usize + 1).pow(3);
                let level = Level { resolution, offset, entries: dense.min(table), hashed: dense > table };
                offset += level.entries;
                level
            })
            .collect()
    }

    /// Entries of all levels together.
    pub fn entries(&self) -> usize {
        self.level_table().last().map_or(0, |l| l.offset + l.entries)
    }
}

/// One fully connected layer without bias.
#[derive(Clone, Debug, PartialEq)]
pub struct Layer<R = f32> {
    /// Inputs.
    pub inputs: usize,
    /// Outputs.
    pub outputs: usize,
    /// Weights, row-major `[outputs, inputs]`.
    pub weight: Vec<R>,
}

/// A multilayer perceptron: rectifiers between layers, none after the last.
#[derive(Clone, Debug, PartialEq)]
pub struct Network<R = f32> {
    /// The layers, first to last.
    pub layers: Vec<Layer<R>>,
}

/// Everything fixed about a field before it is trained.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct FieldConfig {
    /// The variant.
    pub architecture: Architecture,
    /// The hash grid.
    pub grid: GridConfig,
    /// World box that the grid covers, metres.
    pub bounds: Bounds,
    /// Density at logit zero, per metre.
    pub density_scale: f32,
}

impl FieldConfig {
    /// Checks that a field can be made of this configuration.
    ///
    /// # Errors
    /// [`ParameterError::Config`] naming the value that is out of range.
    pub fn validate(&self) -> Result<(), ParameterError> {
        self.grid.validate()?;
        let Bounds { lo, hi } = self.bounds;
        if (0..3).any(|a| !lo[a].is_finite() || !hi[a].is_finite() || lo[a] >= hi[a]) {
            return Err(ParameterError::Config(format!(
                "bounds {lo:?} to {hi:?}: every low corner must be finite and below the high one"
            )));
        }
        if !(self.density_scale.is_finite() && self.density_scale > 0.0) {
            return Err(ParameterError::Config(format!(
                "density_scale is {}; it must be positive and finite",
                self.density_scale
            )));
        }
        Ok(())
    }

    /// Names and shapes `[rows, columns]` of a field's arrays, in the order of [`Parameters::tensors`].
    pub fn tensor_shapes(&self) -> Vec<(String, [usize; 2])> {
        let features = self.grid.outputs();
        let mut shapes = vec![(TABLE.to_owned(), [self.grid.entries(), self.grid.features])];
        for (name, layers) in [
            ("geo", Some(self.architecture.geo_shape(features))),
            ("rgb", Some(self.architecture.rgb_shape(features))),
            ("vis", self.architecture.vis_shape(features)),
        ] {
            for (i, (inputs, outputs)) in layers.into_iter().flatten().enumerate() {
                shapes.push((format!("{name}.{i}.weight"), [outputs, inputs]));
            }
        }
        shapes
    }
}

/// A field: its configuration and its weights, or gradients or moments of the same shapes.
#[derive(Clone, Debug, PartialEq)]
pub struct Parameters<R = f32> {
    /// What the weights are weights of.
    pub config: FieldConfig,
    /// The hash table, row-major `[entries, features]`, levels one after another.
    pub table: Vec<R>,
    /// Geometry network.
    pub geo: Network<R>,
    /// Colour network.
    pub rgb: Network<R>,
    /// Visibility network, where the architecture has one.
    pub vis: Option<Network<R>>,
}

impl Parameters {
    /// The first weights of a field: the table uniform in +-1e-4, networks uniform in `+-1 / sqrt(inputs)` as PyTorch's
    /// `Linear` has them by default. `seed` decides all of them.
    ///
    /// # Errors
    /// [`ParameterError::Config`] if no field can be made of `config`.
    pub fn init(config: FieldConfig, seed: u64) -> Result<Self, ParameterError> {
        let mut parameters = Self::zeros(config)?;
        let shapes = parameters.config.tensor_shapes();
        for (stream, ((name, [_, inputs]), values)) in (0..).zip(shapes.iter().zip(parameters.tensors_mut()))
        {
            let random = Random::new(seed, stream);
            let bound = if name == TABLE { TABLE_INIT } else { 1.0 / (*inputs as f32).sqrt() };
            (0..).zip(values).for_each(|(i, v)| *v = (2.0 * random.uniform_at(i) - 1.0) * bound);
        }
        Ok(parameters)
    }

    /// All weights zero.
    ///
    /// # Errors
    /// [`ParameterError::Config`] if no field can be made of `config`.
    pub fn zeros(config: FieldConfig) -> Result<Self, ParameterError> {
        config.validate()?;
        let features = config.grid.outputs();
        let architecture = config.architecture;
        let layer = |(inputs, outputs)| Layer { inputs, outputs, weight: vec![0.0; inputs * outputs] };
        let network = |shape: Vec<(usize, usize)>| Network { layers: shape.into_iter().map(layer).collect() };
        Ok(Self {
            table: vec![0.0; config.grid.entries() * config.grid.features],
            geo: network(architecture.geo_shape(features)),
            rgb: network(architecture.rgb_shape(features)),
            vis: architecture.vis_shape(features).map(network),
            config,
        })
    }

    /// Checks that every array has the shape that the configuration asks for and that every number is finite.
    ///
    /// # Errors
    /// [`ParameterError`] naming the configuration value or the array at fault.
    pub fn validate(&self) -> Result<(), ParameterError> {
        self.config.validate()?;
        let (has, wants) = (self.tensors(), self.config.tensor_shapes());
        if let Some((name, _)) = wants.iter().find(|(name, _)| !has.iter().any(|(n, ..)| n == name)) {
            return Err(ParameterError::Shape(format!("{name} is missing")));
        }
        for (name, shape, values) in has {
            match wants.iter().find(|(n, _)| *n == name) {
                Some((_, wanted)) if shape == *wanted && values.len() == wanted[0] * wanted[1] => {}
                Some((_, wanted)) => {
                    return Err(ParameterError::Shape(format!(
                        "{name} is {shape:?} with {} numbers; model and grid ask for {wanted:?}",
                        values.len()
                    )));
                }
                None => {
                    let model = self.config.architecture.name();
                    return Err(ParameterError::Shape(format!("{name} is no tensor of {model}")));
                }
            }
            if let Some(index) = values.iter().position(|v| !v.is_finite()) {
                return Err(ParameterError::NonFinite { tensor: name, index, value: values[index] });
            }
        }
        Ok(())
    }
}

impl<R: Real> Network<R> {
    /// The network with every weight mapped.
    fn map<S>(&self, f: impl Fn(R) -> S) -> Network<S> {
        let map = |layer: &Layer<R>| Layer {
            inputs: layer.inputs,
            outputs: layer.outputs,
            weight: layer.weight.iter().map(|&w| f(w)).collect(),
        };
        Network { layers: self.layers.iter().map(map).collect() }
    }
}

impl<R: Real> Parameters<R> {
    /// Arrays of the same shapes with every number mapped.
    pub fn map<S>(&self, f: impl Fn(R) -> S) -> Parameters<S> {
        Parameters {
            config: self.config.clone(),
            table: self.table.iter().map(|&v| f(v)).collect(),
            geo: self.geo.map(&f),
            rgb: self.rgb.map(&f),
            vis: self.vis.as_ref().map(|vis| vis.map(&f)),
        }
    }

    /// The arrays with their names and shapes `[rows, columns]`, always in this order: `grid.table`, then
    /// `geo.0.weight` and so on, `rgb.0.weight` and so on, `vis.0.weight` and so on.
    pub fn tensors(&self) -> Vec<(String, [usize; 2], &[R])> {
        let features = self.config.grid.features;
        let mut tensors = vec![(TABLE.to_owned(), [self.table.len() / features, features], &self.table[..])];
        for (name, network) in
            [("geo", Some(&self.geo)), ("rgb", Some(&self.rgb)), ("vis", self.vis.as_ref())]
        {
            for (i, layer) in network.iter().flat_map(|n| n.layers.iter().enumerate()) {
                tensors.push((format!("{name}.{i}.weight"), [layer.outputs, layer.inputs], &layer.weight));
            }
        }
        tensors
    }

    /// The numbers of [`Parameters::tensors`], in the same order, to be changed.
    pub fn tensors_mut(&mut self) -> Vec<&mut [R]> {
        let networks = [Some(&mut self.geo), Some(&mut self.rgb), self.vis.as_mut()];
        let layers = networks.into_iter().flatten().flat_map(|n| &mut n.layers);
        std::iter::once(&mut self.table[..]).chain(layers.map(|l| &mut l.weight[..])).collect()
    }
}

/// What can be wrong with a field.
#[derive(Debug, thiserror::Error, PartialEq)]
pub enum ParameterError {
    /// A configuration that no field can be made of.
    #[error("{0}")]
    Config(String),
    /// An array that is not of the shape that the configuration asks for.
    #[error("{0}")]
    Shape(String),
    /// A weight that is not finite.
    #[error("{tensor} holds {value} at index {index}: the weights are of a run that diverged")]
    NonFinite {
        /// Name of the array.
        tensor: String,
        /// Index of the first such number, row-major.
        index: usize,
        /// The number.
        value: f32,
    },
}
