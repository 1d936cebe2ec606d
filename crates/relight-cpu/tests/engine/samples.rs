//! Where a batch's samples lie, and what is encoded there.

use fearless_simd::Level;
use proptest::prelude::*;
use relight_cpu::density_grid::DensityGrid;
use relight_cpu::march::along;
use relight_cpu::samples::{Jitter, Marcher, SampleBatch};
use relight_field::architecture::V5;
use relight_field::encoding::hash_grid;
use relight_field::engine::Rays;
use relight_field::random::Random;
use relight_field::sampling::Sampling;

use crate::common::*;

const SAMPLINGS: [Sampling; 3] = [
    Sampling::Guided { samples: 13 },
    Sampling::Stratified { coarse: 13, fine: 0 },
    Sampling::Stratified { coarse: 5, fine: 8 },
];

proptest! {
    #![proptest_config(ProptestConfig::with_cases(40))]

    #[test]
    fn samples_ascend_through_the_box_and_their_lengths_tile_it_unless_voids_are_known(
        n in 2usize..20, tile_rays in 1usize..7, kind in 0usize..3, seed in proptest::option::of(any::<u64>()),
        search in any::<bool>(),
    ) {
        let (rays, parts) = (rays(n), Parts::new(&field(V5)));
        let mut batch = SampleBatch::default();
        let jitter = Jitter(seed.map(|seed| Random::new(seed, 0)));
        let marcher = Marcher { search, ..parts.marcher(Level::new()) };
        batch.fill(&marcher, &rays, SAMPLINGS[kind], tile_rays, jitter);
        prop_assert_eq!((batch.samples, batch.tiles(&rays)), (13, n.div_ceil(tile_rays)));
        for (r, samples) in plain_samples(&batch, n).iter().enumerate() {
            let (near, far) = parts.cube.clip(rays.origins[r], rays.directions[r]);
            let (near, far) = (f64::from(near), f64::from(far));
            prop_assert!(samples.t.windows(2).all(|pair| pair[0] <= pair[1] + 1e-6), "{:?}", samples.t);
            prop_assert!(samples.t.iter().all(|t| (near - 1e-6..=far + 1e-6).contains(t)));
            prop_assert!(samples.delta.iter().all(|&d| d >= 0.0));
            let sum: f64 = samples.delta.iter().sum();
            prop_assert!(sum < far - near + 1e-5, "{sum} {near} {far}");
            prop_assert!(kind == 0 && !search || sum > far - near - 1e-5, "{sum} {near} {far}");
        }
    }
}

/// Two walls that the density grid knows of: samples beside the void between them stand for little of it.
#[test]
fn samples_beside_a_void_stand_for_little_of_it() {
    let mut parts = Parts::new(&field(V5));
    parts.density = DensityGrid::uniform(&BOUNDS, 16, 0.0);
    let walls = [0.2, 0.8].map(|x| parts.density.cell([x, 0.5, 0.5]));
    walls.iter().for_each(|&cell| parts.density.observe(cell, 500.0));
    let middle = parts.cube.unmap([0.5; 3]);
    let rays = Rays { origins: vec![[-2.0, middle[1], middle[2]]], directions: vec![[1.0, 0.0, 0.0]] };
    for jitter in [Jitter(None), Jitter(Some(Random::new(5, 0)))] {
        let longest = |search| {
            let mut batch = SampleBatch::default();
            let marcher = Marcher { search, ..parts.marcher(Level::new()) };
            batch.fill(&marcher, &rays, Sampling::Guided { samples: 64 }, 1, jitter);
            let samples = plain_samples(&batch, 1).remove(0);
            // Those beside the walls: of the void itself they know nothing.
            let near = |x: f64| [0.2, 0.8].iter().any(|wall| (x - wall).abs() < 1.5 / 16.0);
            let unit =
                |t: f64| f64::from(parts.cube.map(along(rays.origins[0], rays.directions[0], t as f32))[0]);
            let beside = samples.t.iter().zip(&samples.delta).filter(|(t, _)| near(unit(**t)));
            beside.map(|(_, &length)| length).fold(0.0, f64::max)
        };
        let cell = f64::from(parts.density.cell_size());
        let (searching, knowing) = (longest(true), longest(false));
        assert!(knowing <= cell + 1e-6 && searching > knowing, "{searching} {knowing} {cell}");
    }
}

#[test]
fn features_are_those_of_the_samples_positions() {
    let (parameters, rays) = (field(V5), rays(9));
    let parts = Parts::new(&parameters);
    let marcher = parts.marcher(Level::new());
    let grid = hash_grid::HashGrid::new(&parameters.config.grid);
    let mut batch = SampleBatch::default();
    // From many samples to few: nothing of the first batch may remain in the second.
    for sampling in [Sampling::Stratified { coarse: 30, fine: 10 }, SAMPLINGS[0], SAMPLINGS[2]] {
        batch.fill(&marcher, &rays, sampling, 4, Jitter(Some(Random::new(3, 0))));
        for tile in 0..batch.tiles(&rays) {
            let here = batch.tile(&marcher, &rays, tile);
            assert_eq!(here.features.len(), parts.networks.features * here.columns);
            let used = here.origins.len() * here.samples;
            for column in 0..used {
                let r = column / here.samples;
                let position = along(here.origins[r], here.directions[r], here.t[column]);
                let h = grid.encode(&parameters.table, hash_grid::unit(&BOUNDS, position));
                for (f, plain) in h.iter().enumerate() {
                    let ours = here.features[f * here.columns + column];
                    assert!((ours - plain).abs() < 1e-4, "{sampling:?}: {ours} {plain}");
                }
            }
            assert!(here.lengths[used..].iter().all(|&l| l == 0.0));
        }
    }
}

/// Rays beside each other share their samples in pictures; random samples are each ray's own.
#[test]
fn rays_beside_each_other_share_samples_unless_those_are_random() {
    let (rays, parts) = (rays(6), Parts::new(&field(V5)));
    let marcher = parts.marcher(Level::new());
    let places = |rays: &Rays, random: Option<Random>| -> Vec<Vec<f64>> {
        let mut batch = SampleBatch::default();
        batch.fill(&marcher, rays, SAMPLINGS[0], 3, Jitter(random));
        // The last of them is where the ray leaves the box.
        plain_samples(&batch, rays.origins.len()).into_iter().map(|s| s.t[..12].to_vec()).collect()
    };
    // The first ray misses the box.
    for r in 1..6 {
        let beside = normalised([0, 1, 2].map(|a| rays.directions[r][a] + [0.0, 1e-3, -1e-3][a]));
        let pair = Rays { origins: vec![rays.origins[r]; 2], directions: vec![rays.directions[r], beside] };
        let second = Rays { origins: vec![rays.origins[r]], directions: vec![beside] };
        for random in [None, Some(Random::new(3, 0))] {
            let shared = places(&pair, random);
            assert_eq!(shared[0] == shared[1], random.is_none());
            assert_ne!(shared[1], places(&second, None)[0]);
        }
    }
}

/// The second pass looks where the first found something.
#[test]
fn fine_samples_gather_where_the_weight_is() {
    let (parameters, rays) = (field(V5), rays(6));
    let parts = Parts::new(&parameters);
    let marcher = parts.marcher(Level::new());
    let (mut coarse, mut all) = (SampleBatch::default(), SampleBatch::default());
    coarse.fill(&marcher, &rays, Sampling::Stratified { coarse: 16, fine: 0 }, 1, Jitter(None));
    all.fill(&marcher, &rays, Sampling::Stratified { coarse: 16, fine: 160 }, 1, Jitter(None));
    for tile in 1..6 {
        let here = coarse.tile(&marcher, &rays, tile);
        let mut workspace = relight_cpu::tile::Workspace::default();
        workspace.look(marcher.simd, &parts.networks, &here);
        let t = &all.tile(&marcher, &rays, tile).t[..176];
        let span = parts.cube.clip(rays.origins[tile], rays.directions[tile]);
        let mut start = span.0;
        // What the opaque last sample weighs is what no density stopped: the second pass does not look there.
        let stopped = 1.0 - workspace.weights[15];
        assert!(stopped > 0.01, "ray {tile} meets nothing");
        for k in 0..15 {
            let end = start + here.lengths[k];
            let within = t.iter().filter(|t| (start..end).contains(*t)).count() as f32;
            // The coarse sample itself, and its share of the fine ones.
            let expected = 1.0 + 160.0 * workspace.weights[k] / stopped;
            assert!((within - expected).abs() <= 2.0, "ray {tile}, interval {k}: {within}, not {expected}");
            start = end;
        }
    }
}
