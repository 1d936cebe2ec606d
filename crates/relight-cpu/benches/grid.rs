//! Lookups and gradients of the hash grid, on samples that lie as those of a training step do: short runs along
//! rays that cross a surface.
use divan::counter::ItemsCount;
use fearless_simd::Level;
use relight_cpu::adam::Adam;
use relight_cpu::hash_grid::{HashGrid, TiledPositions};
use relight_field::parameters::GridConfig;
use relight_field::random::Random;

const TILES: usize = 64;
const COLUMNS: usize = 192;
const RUN: usize = 12;

fn main() {
    divan::main();
}

fn positions() -> Vec<f32> {
    let random = Random::new(1, 0);
    let mut data = vec![0.0; TILES * 3 * COLUMNS];
    for tile in 0..TILES {
        for c in 0..COLUMNS {
            let ray = (tile * COLUMNS + c) / RUN;
            let depth = (c % RUN) as f32 * 1e-3;
            for axis in 0..3 {
                let base = random.uniform_at((ray * 3 + axis) as u64);
                data[(tile * 3 + axis) * COLUMNS + c] = 0.99 * base + depth;
            }
        }
    }
    data
}

/// A grid of so many features an entry, 32 of all levels.
fn grid(features: usize) -> HashGrid {
    let config = GridConfig { levels: 32 / features, features, ..GridConfig::default() };
    HashGrid::new(&config, &vec![1e-4; features * config.entries()])
}

#[divan::bench(args = [2, 4])]
fn encode(bencher: divan::Bencher<'_, '_>, features: usize) {
    let (grid, data, level) = (grid(features), positions(), Level::new());
    let mut encoded = vec![0.0; TILES * 32 * COLUMNS];
    bencher.counter(ItemsCount::new(TILES * COLUMNS)).bench_local(|| {
        grid.encode(level, TiledPositions { data: &data, columns: COLUMNS }, &mut encoded);
    });
}

#[divan::bench(args = [2, 4])]
fn scatter_and_adam(bencher: divan::Bencher<'_, '_>, features: usize) {
    let (mut grid, data, level) = (grid(features), positions(), Level::new());
    let gradients = vec![1e-3; TILES * 32 * COLUMNS];
    let adam = Adam::new(0.999);
    bencher.counter(ItemsCount::new(TILES * COLUMNS)).bench_local(|| {
        let tiles: Vec<_> = TiledPositions { data: &data, columns: COLUMNS }.tiles(&gradients).collect();
        grid.step(level, &tiles, 1e-3, &adam);
    });
}
