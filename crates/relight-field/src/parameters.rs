//! All that is learned, and what is needed to make sense of it: the hash table, the weights of the three networks,
//! and the configuration that gives them their shapes.

use relight_scene::Bounds;
use serde::{Deserialize, Serialize};

use crate::architecture::Architecture;
use crate::random::Random;

/// Most levels that a grid may have.
const MAX_LEVELS: usize = 32;
/// Largest `log2_table`: 2^24 entries a level are 128 MiB.
const MAX_LOG2_TABLE: u32 = 24;
/// Most cells an axis of a level; vertex numbers then fit 64 bits with room to spare.
const MAX_RESOLUTION: u32 = 1 << 16;
/// Half the width of the interval that the table's first values are drawn from.
const TABLE_INIT: f32 = 1e-4;

/// Shape of the multiresolution hash grid (Mueller et al. 2022, section 3).
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct GridConfig {
    /// Number of levels.
    pub levels: usize,
    /// Features an entry; only 2 is supported.
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
        let fault = if self.features != 2 {
            format!("grid.features is {}; only 2 is supported", self.features)
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
pub struct Layer {
    /// Inputs.
    pub inputs: usize,
    /// Outputs.
    pub outputs: usize,
    /// Weights, row-major `[outputs, inputs]`.
    pub weight: Vec<f32>,
}

/// A multilayer perceptron: rectifiers between layers, none after the last.
#[derive(Clone, Debug, PartialEq)]
pub struct Network {
    /// The layers, first to last.
    pub layers: Vec<Layer>,
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

    /// `(inputs, outputs)` of every layer of every network that the architecture has, each with its name: `geo`,
    /// `rgb`, and `vis` where there is one.
    pub fn network_shapes(&self) -> Vec<(&'static str, Vec<(usize, usize)>)> {
        let features = self.grid.outputs();
        let mut shapes = vec![
            ("geo", self.architecture.geo_shape(features)),
            ("rgb", self.architecture.rgb_shape(features)),
        ];
        shapes.extend(self.architecture.vis_shape(features).map(|shape| ("vis", shape)));
        shapes
    }
}

/// A field: its configuration and its weights.
#[derive(Clone, Debug, PartialEq)]
pub struct Parameters {
    /// What the weights are weights of.
    pub config: FieldConfig,
    /// The hash table, row-major `[entries, features]`, levels one after another.
    pub table: Vec<f32>,
    /// Geometry network.
    pub geo: Network,
    /// Colour network.
    pub rgb: Network,
    /// Visibility network, where the architecture has one.
    pub vis: Option<Network>,
}

impl Network {
    /// A network of the given `(inputs, outputs)`, its weights uniform in `+-1 / sqrt(inputs)`: the default of
    /// PyTorch's `Linear`. Layer `i` draws from stream `stream + i`.
    fn init(shape: &[(usize, usize)], seed: u64, stream: u64) -> Self {
        let layers = shape.iter().zip(stream..).map(|(&(inputs, outputs), stream)| {
            let random = Random::new(seed, stream);
            let bound = 1.0 / (inputs as f32).sqrt();
            let weight = (0..(inputs * outputs) as u64).map(|i| symmetric(random, i, bound)).collect();
            Layer { inputs, outputs, weight }
        });
        Self { layers: layers.collect() }
    }

    /// Checks layers against the shape that the architecture asks for.
    fn validate(&self, name: &str, shape: &[(usize, usize)]) -> Result<(), ParameterError> {
        if self.layers.len() != shape.len() {
            return Err(ParameterError::Shape(format!(
                "{name} has {} layers; the architecture has {}",
                self.layers.len(),
                shape.len()
            )));
        }
        for (i, (layer, &(inputs, outputs))) in self.layers.iter().zip(shape).enumerate() {
            if (layer.inputs, layer.outputs, layer.weight.len()) != (inputs, outputs, inputs * outputs) {
                return Err(ParameterError::Shape(format!(
                    "{name}.{i}.weight is [{}, {}] with {} numbers; the architecture has [{outputs}, {inputs}]",
                    layer.outputs,
                    layer.inputs,
                    layer.weight.len()
                )));
            }
            check_finite(&format!("{name}.{i}.weight"), &layer.weight)?;
        }
        Ok(())
    }
}

impl Parameters {
    /// The first weights of a field: the table uniform in +-1e-4, networks as PyTorch's `Linear` has them by default.
    /// `seed` decides all of them.
    ///
    /// # Errors
    /// [`ParameterError::Config`] if no field can be made of `config`.
    pub fn init(config: FieldConfig, seed: u64) -> Result<Self, ParameterError> {
        config.validate()?;
        let features = config.grid.outputs();
        let architecture = config.architecture;
        let random = Random::new(seed, 0);
        let numbers = (config.grid.entries() * config.grid.features) as u64;
        Ok(Self {
            config,
            table: (0..numbers).map(|i| symmetric(random, i, TABLE_INIT)).collect(),
            geo: Network::init(&architecture.geo_shape(features), seed, 100),
            rgb: Network::init(&architecture.rgb_shape(features), seed, 200),
            vis: architecture.vis_shape(features).map(|shape| Network::init(&shape, seed, 300)),
        })
    }

    /// The networks with their names: `geo`, `rgb`, and `vis` where there is one.
    pub fn networks(&self) -> Vec<(&'static str, &Network)> {
        let mut networks = vec![("geo", &self.geo), ("rgb", &self.rgb)];
        networks.extend(self.vis.as_ref().map(|vis| ("vis", vis)));
        networks
    }

    /// Checks that every array has the shape that the configuration asks for and that every number is finite.
    ///
    /// # Errors
    /// [`ParameterError`] naming the configuration value or the array at fault.
    pub fn validate(&self) -> Result<(), ParameterError> {
        self.config.validate()?;
        let (entries, features) = (self.config.grid.entries(), self.config.grid.features);
        if self.table.len() != entries * features {
            return Err(ParameterError::Shape(format!(
                "grid.table has {} numbers; the grid has [{entries}, {features}]",
                self.table.len()
            )));
        }
        check_finite("grid.table", &self.table)?;
        let (networks, shapes) = (self.networks(), self.config.network_shapes());
        if networks.len() != shapes.len() {
            let (has, wants) = if self.vis.is_some() { ("a", "none") } else { ("no", "one") };
            return Err(ParameterError::Shape(format!(
                "there is {has} visibility network; the architecture has {wants}"
            )));
        }
        networks
            .into_iter()
            .zip(shapes)
            .try_for_each(|((name, network), (_, shape))| network.validate(name, &shape))
    }
}

/// Number `index` of `random`, uniform in `+-bound`.
fn symmetric(random: Random, index: u64, bound: f32) -> f32 {
    (2.0 * random.uniform_at(index) - 1.0) * bound
}

/// Refuses an array with a number that is not finite.
fn check_finite(name: &str, values: &[f32]) -> Result<(), ParameterError> {
    match values.iter().position(|v| !v.is_finite()) {
        Some(at) => Err(ParameterError::NonFinite { tensor: name.to_owned(), index: at, value: values[at] }),
        None => Ok(()),
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::architecture::{V2, V5, VARIANTS};

    fn config(architecture: Architecture) -> FieldConfig {
        FieldConfig {
            architecture,
            grid: GridConfig { levels: 4, features: 2, log2_table: 10, base: 4, finest: 32 },
            bounds: Bounds { lo: [-0.5, -0.5, 0.0], hi: [0.5, 0.5, 1.0] },
            density_scale: 10.0,
        }
    }

    #[test]
    fn initial_weights_are_valid_and_spread_as_stated() {
        for (_, architecture) in VARIANTS {
            let parameters = Parameters::init(config(architecture), 5).unwrap();
            parameters.validate().unwrap();
            for (_, network) in parameters.networks() {
                for layer in &network.layers {
                    let bound = 1.0 / (layer.inputs as f32).sqrt();
                    let largest = layer.weight.iter().fold(0.0f32, |m, w| m.max(w.abs()));
                    assert!(largest <= bound && largest > 0.9 * bound);
                }
            }
            let largest = parameters.table.iter().fold(0.0f32, |m, w| m.max(w.abs()));
            assert!(largest <= 1e-4 && largest > 0.99e-4);
        }
    }

    #[test]
    fn the_seed_decides_the_weights() {
        let init = |seed| Parameters::init(config(V5), seed).unwrap();
        assert_eq!(init(1), init(1));
        assert_ne!(init(1).table, init(2).table);
        assert_ne!(init(1).rgb, init(2).rgb);
    }

    #[test]
    fn impossible_configurations_are_refused_by_name() {
        let refuse = |change: fn(&mut FieldConfig), name: &str| {
            let mut config = config(V2);
            change(&mut config);
            let message = Parameters::init(config, 0).unwrap_err().to_string();
            assert!(message.contains(name), "{message}");
        };
        refuse(|c| c.grid.levels = 0, "grid.levels");
        refuse(|c| c.grid.features = 4, "grid.features");
        refuse(|c| c.grid.log2_table = 64, "grid.log2_table");
        refuse(|c| c.grid.base = 0, "grid.base");
        refuse(|c| c.grid.finest = 2, "grid.finest");
        refuse(|c| c.grid.finest = u32::MAX, "grid.finest");
        refuse(|c| c.bounds.hi[1] = c.bounds.lo[1], "bounds");
        refuse(|c| c.bounds.lo[0] = f32::NAN, "bounds");
        refuse(|c| c.density_scale = 0.0, "density_scale");
    }

    #[test]
    fn wrong_arrays_are_refused_by_name() {
        let refuse = |change: fn(&mut Parameters), name: &str| {
            let mut parameters = Parameters::init(config(V5), 0).unwrap();
            change(&mut parameters);
            let message = parameters.validate().unwrap_err().to_string();
            assert!(message.contains(name), "{message}");
        };
        refuse(|p| p.table.truncate(10), "grid.table");
        refuse(|p| p.table[3] = f32::NAN, "grid.table holds NaN at index 3");
        refuse(|p| p.geo.layers[1].weight.truncate(3), "geo.1.weight");
        refuse(|p| p.rgb.layers[2].inputs = 63, "rgb.2.weight");
        refuse(|p| p.rgb.layers.truncate(3), "rgb has 3 layers");
        refuse(|p| p.vis = None, "no visibility network");
    }

    #[test]
    fn default_grid_has_the_resolutions_of_torch_ngp() {
        let levels = GridConfig::default().level_table();
        assert_eq!((levels[0].resolution, levels[15].resolution), (16, 2048));
        assert!(levels.windows(2).all(|w| w[0].offset + w[0].entries == w[1].offset));
        assert_eq!(levels.iter().filter(|l| !l.hashed).count(), 5);
    }
}
