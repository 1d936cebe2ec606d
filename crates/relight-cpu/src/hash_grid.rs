//! The hash grid `h(x)`: lookups level by level, and the sparse optimiser that follows their gradients.
//!
//! Going back, a level belongs to one thread: no atomics, and the same sums whatever the number of threads.

mod corners;
mod encoding;
mod level_gradient;
mod table;

use fearless_simd::Level;
use relight_field::engine::StageCost;
use relight_field::parameters::GridConfig;

use crate::adam::Adam;
use crate::stages::Costs;
use table::Table;

/// Corners of a cell.
const CORNERS: usize = 8;

/// The table, with its optimiser. Its kernels are built for each number of features an entry.
pub enum HashGrid {
    /// Two, as the paper has.
    Two(Table<2>),
    /// Four: half as many lookups for as many numbers.
    Four(Table<4>),
}

/// The same of a grid's table, whatever its features.
macro_rules! of {
    ($grid:expr, $table:ident => $result:expr) => {
        match $grid {
            HashGrid::Two($table) => $result,
            HashGrid::Four($table) => $result,
        }
    };
}

/// Samples in tiles: `[tile][3][columns]`, positions in the unit cube.
#[derive(Clone, Copy)]
pub struct TiledPositions<'a> {
    /// The numbers.
    pub data: &'a [f32],
    /// Columns of a tile, a multiple of 16.
    pub columns: usize,
}

/// One tile of samples, and the gradients of their features.
#[derive(Clone, Copy)]
pub struct TileGradients<'a> {
    /// `[3][columns]`: positions in the unit cube.
    pub positions: &'a [f32],
    /// `[outputs][columns]`.
    pub gradients: &'a [f32],
    /// Its columns, a multiple of 16.
    pub columns: usize,
}

impl<'a> TiledPositions<'a> {
    /// The tiles, with gradients laid out like the features of [`HashGrid::encode`].
    pub fn tiles(self, gradients: &'a [f32]) -> impl Iterator<Item = TileGradients<'a>> {
        let (columns, tiles) = (self.columns, self.data.len() / (3 * self.columns));
        let gradients = gradients.chunks_exact((gradients.len() / tiles.max(1)).max(1));
        let tiles = self.data.chunks_exact(3 * columns).zip(gradients);
        tiles.map(move |(positions, gradients)| TileGradients { positions, gradients, columns })
    }
}

/// Puts a position into column `column` of a tile, `[3][columns]`; outside the unit cube, the nearest of its surface.
pub fn set_position(tile: &mut [f32], column: usize, unit: [f32; 3]) {
    let columns = tile.len() / 3;
    for (axis, u) in unit.into_iter().enumerate() {
        tile[axis * columns + column] = u.clamp(0.0, 1.0);
    }
}

impl HashGrid {
    /// Takes the table of a valid `config`, `[entries, features]`.
    pub fn new(config: &GridConfig, table: &[f32]) -> Self {
        match config.features {
            4 => Self::Four(Table::new(config, table)),
            features => {
                debug_assert_eq!(features, 2);
                Self::Two(Table::new(config, table))
            }
        }
    }

    /// The table, `[entries, features]`.
    pub fn table(&self) -> Vec<f32> {
        of!(self, table => table.entries())
    }

    /// Numbers of an encoded position: features of all levels.
    pub fn outputs(&self) -> usize {
        of!(self, table => table.outputs())
    }

    /// Moments as flat arrays: first and second moments `[entries, features]`, and updates `[entries]`.
    pub fn moments(&self) -> (Vec<f32>, Vec<f32>, Vec<u32>) {
        of!(self, table => table.moments())
    }

    /// Sets the moments from arrays laid out as [`HashGrid::moments`] gives them; false if they do not fit.
    pub fn set_moments(&mut self, m: &[f32], v: &[f32], updates: &[u32]) -> bool {
        of!(self, table => table.set_moments(m, v, updates))
    }

    /// Encodes all tiles: `features` is `[tile][outputs][columns]`.
    pub fn encode(&self, simd: Level, positions: TiledPositions<'_>, features: &mut [f32]) {
        of!(self, table => table.encode(simd, positions, features));
    }

    /// What encoding so many samples takes, but for the time.
    pub fn encode_cost(&self, samples: usize) -> StageCost {
        of!(self, table => table.encode_cost(samples))
    }

    /// Takes one optimiser step along the gradients of all tiles. Entries that no sample touched keep their weights and
    /// moments, and cost nothing but a bit. Returns what scattering and optimising cost the threads together.
    pub fn step(&mut self, simd: Level, tiles: &[TileGradients<'_>], rate: f32, adam: &Adam) -> Costs {
        of!(self, table => table.step(simd, tiles, rate, adam))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dense::tests::levels;
    use relight_field::encoding::hash_grid as reference;
    use relight_field::random::Random;

    const COLUMNS: usize = 32;
    const TILES: usize = 3;
    const SAMPLES: usize = TILES * COLUMNS;

    /// Dense levels and hashed ones, for each number of features.
    fn configs() -> [GridConfig; 2] {
        let config = GridConfig { levels: 5, features: 2, log2_table: 9, base: 3, finest: 40 };
        assert!(config.level_table().iter().any(|l| l.hashed));
        assert!(config.level_table().iter().any(|l| !l.hashed));
        [config, GridConfig { features: 4, ..config }]
    }

    fn table(config: &GridConfig) -> Vec<f32> {
        let random = Random::new(5, 0);
        (0..(config.features * config.entries()) as u64).map(|i| random.uniform_at(i) - 0.5).collect()
    }

    /// Samples that lie together in one cell of most levels.
    const CROWD: std::ops::Range<usize> = 64..80;
    /// Samples that lie in a few cells, some neighbours in one of them.
    const TROOPS: std::ops::Range<usize> = 80..96;

    /// Random positions; among the first of them all corners of the cube and points on its faces and beyond them.
    fn positions() -> Vec<[f32; 3]> {
        let random = Random::new(5, 1);
        let mut positions: Vec<[f32; 3]> = (0..SAMPLES as u64)
            .map(|i| [0, 1, 2].map(|a| 0.001 + 0.998 * random.uniform_at(3 * i + a)))
            .collect();
        for (i, p) in positions[..20].iter_mut().enumerate() {
            match i {
                0..8 => *p = [i & 1, i >> 1 & 1, i >> 2].map(|bit| bit as f32),
                8..14 => p[(i - 8) / 2] = (i % 2) as f32,
                _ => p[(i - 14) / 2] = if i % 2 == 0 { -0.3 } else { 1.7 },
            }
        }
        for p in &mut positions[CROWD] {
            *p = p.map(|u| 0.41 + 0.005 * u);
        }
        for (i, p) in positions[TROOPS].iter_mut().enumerate() {
            let troop = [0.1, 0.3, 0.1, 0.7][i / 5];
            *p = p.map(|u| troop + 0.005 * u);
        }
        positions
    }

    /// `[tile][rows][columns]` of `row(sample, r)`.
    fn tiled(rows: usize, row: impl Fn(usize, usize) -> f32) -> Vec<f32> {
        let number = |i: usize| row(i / (rows * COLUMNS) * COLUMNS + i % COLUMNS, i / COLUMNS % rows);
        (0..rows * SAMPLES).map(number).collect()
    }

    fn unit(p: [f32; 3]) -> [f64; 3] {
        p.map(|v| f64::from(v.clamp(0.0, 1.0)))
    }

    #[test]
    fn features_equal_the_reference() {
        configs().iter().for_each(features_equal);
    }

    fn features_equal(config: &GridConfig) {
        let (table, positions) = (table(config), positions());
        let grid = HashGrid::new(config, &table);
        let data = tiled(3, |sample, axis| positions[sample][axis]);
        let plain_table: Vec<f64> = table.iter().map(|&v| f64::from(v)).collect();
        let plain = reference::HashGrid::new(config);
        for level in levels() {
            let mut features = vec![f32::NAN; grid.outputs() * SAMPLES];
            grid.encode(level, TiledPositions { data: &data, columns: COLUMNS }, &mut features);
            let expected: Vec<Vec<f64>> =
                positions.iter().map(|&p| plain.encode(&plain_table, unit(p))).collect();
            let expected = tiled(grid.outputs(), |sample, row| expected[sample][row] as f32);
            for (i, (ours, plain)) in features.iter().zip(&expected).enumerate() {
                assert!((ours - plain).abs() < 1e-5, "{level:?}, number {i}: {ours} {plain}");
            }
        }
    }

    #[test]
    fn a_step_updates_the_entries_that_samples_touched_and_no_others() {
        configs().iter().for_each(updates_what_is_touched);
    }

    fn updates_what_is_touched(config: &GridConfig) {
        let features = config.features;
        let before = table(config);
        let positions = positions();
        let plain = reference::HashGrid::new(config);
        let data = tiled(3, |sample, axis| positions[sample][axis]);
        let positions_tiled = TiledPositions { data: &data, columns: COLUMNS };
        let (random, rate, adam) = (Random::new(5, 2), 0.01, Adam::new(0.999));
        let outputs = config.outputs();
        for level in levels() {
            let mut grid = HashGrid::new(config, &before);
            let mut updates = vec![0u32; config.entries()];
            let mut expected: Vec<[f64; 3]> = before.iter().map(|&w| [f64::from(w), 0.0, 0.0]).collect();
            // Other samples each time: what one step leaves behind must not leak into the next. Those before the
            // 20th lie on vertices, whose neighbours they touch with weight zero.
            for samples in [20..25, 40..50, 22..42] {
                let value =
                    |sample: usize, row: usize| random.uniform_at((sample * outputs + row) as u64) - 0.45;
                let gradients =
                    tiled(
                        outputs,
                        |sample, row| {
                            if samples.contains(&sample) { value(sample, row) } else { 0.0 }
                        },
                    );
                let tiles: Vec<_> = positions_tiled.tiles(&gradients).collect();
                grid.step(level, &tiles, rate, &adam);

                let mut gradient = vec![0.0; before.len()];
                for sample in samples {
                    let d_h: Vec<f64> = (0..outputs).map(|row| f64::from(value(sample, row))).collect();
                    plain.backward(unit(positions[sample]), &d_h, &mut gradient);
                }
                for (entry, g) in gradient.chunks_exact(features).enumerate() {
                    if g.iter().all(|&g| g == 0.0) {
                        continue;
                    }
                    updates[entry] += 1;
                    let n = updates[entry] as i32;
                    for ([w, m, v], g) in expected[features * entry..][..features].iter_mut().zip(g) {
                        *m = 0.9 * *m + 0.1 * g;
                        *v = 0.999 * *v + 0.001 * g * g;
                        let (m, v) = (*m / (1.0 - 0.9f64.powi(n)), *v / (1.0 - 0.999f64.powi(n)));
                        *w -= f64::from(rate) * m / (v.sqrt() + 1e-15);
                    }
                }
            }
            let (weights, (m, v, counted)) = (grid.table(), grid.moments());
            assert_eq!(counted, updates, "{level:?}");
            let touched = updates.iter().filter(|&&n| n > 0).count();
            assert!(touched > 100 && touched < config.entries(), "{touched}");
            for (i, [plain_w, plain_m, plain_v]) in expected.into_iter().enumerate() {
                let weight = weights[i];
                if updates[i / features] == 0 {
                    assert_eq!((weight.to_bits(), m[i], v[i]), (before[i].to_bits(), 0.0, 0.0));
                    continue;
                }
                let close = |ours: f32, plain: f64, of: f64| (f64::from(ours) - plain).abs() < 1e-4 * of;
                assert!(close(m[i], plain_m, 0.05), "{level:?}, {i}: {} {plain_m}", m[i]);
                assert!(close(v[i], plain_v, 0.001), "{level:?}, {i}: {} {plain_v}", v[i]);
                // A gradient near zero has a sign that rounding decides.
                assert!(plain_m.abs() < 1e-5 || close(weight, plain_w, 1.0), "{i}: {weight} {plain_w}");
            }
        }
    }

    #[test]
    fn moments_return_as_they_were_and_others_are_refused() {
        configs().iter().for_each(moments_return);
    }

    fn moments_return(config: &GridConfig) {
        let mut grid = HashGrid::new(config, &table(config));
        let n = config.entries();
        let m: Vec<f32> = (0..config.features * n).map(|i| i as f32).collect();
        let v: Vec<f32> = m.iter().map(|m| m + 0.5).collect();
        let updates: Vec<u32> = (0..n as u32).collect();
        assert!(grid.set_moments(&m, &v, &updates));
        assert_eq!(grid.moments(), (m.clone(), v.clone(), updates.clone()));
        assert!(!grid.set_moments(&m[1..], &v, &updates));
        assert!(!grid.set_moments(&m, &v[1..], &updates));
        assert!(!grid.set_moments(&m, &v, &updates[1..]));
        assert_eq!(grid.moments(), (m, v, updates));
    }
}
