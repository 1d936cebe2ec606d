//! All that is learned, and what is needed to make sense of it: the hash table, the weights of the three networks,
//! and the configuration that gives them their shapes.

use relight_scene::Bounds;
use serde::{Deserialize, Serialize};

use crate::architecture::Architecture;

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
