//! What surveys show the density grid.

use std::collections::HashSet;

use fearless_simd::Level;
use relight_cpu::CpuEngine;
use relight_cpu::density_grid::DensityGrid;
use relight_field::architecture::V5;
use relight_field::engine::{Engine, Points, StepSettings};
use relight_field::random::Random;
use relight_field::sampling::{EngineConfig, Sampling};

use crate::common::{BOUNDS, Parts, batch, field, lights, view};
use crate::steps::{guided, settings};

/// A grid of `resolution` cells an axis, empty but for a dense first cell, after a survey of one of each `of` cells.
fn surveyed(resolution: usize, of: usize, seed: u64) -> DensityGrid {
    let density = DensityGrid::uniform(&BOUNDS, resolution, 0.0);
    density.observe(0, 1e4);
    let parts = Parts { density, ..Parts::new(&field(V5)) };
    let cost = parts.marcher(Level::new()).survey(of, Random::new(seed, 0));
    assert_eq!(cost.updates, (resolution.pow(3) / of) as f64);
    parts.density
}

#[test]
fn a_survey_of_all_shows_every_cell_the_field_in_its_middle() {
    let parameters = field(V5);
    let grid = surveyed(16, 1, 0);
    let cells = 0..16usize.pow(3);
    let world = |cell: usize| {
        let unit = grid.middle(cell);
        [0, 1, 2].map(|a| f64::from(BOUNDS.lo[a] + unit[a] * (BOUNDS.hi[a] - BOUNDS.lo[a])))
    };
    let points = Points {
        positions: cells.clone().map(world).collect(),
        directions: vec![[0.0, 0.0, 1.0]; cells.len()],
        light: Some(lights()[0]),
    };
    let field = CpuEngine::new(&parameters, guided(12)).unwrap().query(&points).unwrap();
    for (cell, density) in cells.zip(field.density).skip(1) {
        let known = grid.optical_depth(cell) / grid.cell_size();
        // Of densities a cell keeps three bits, and what is thin it does not count.
        let is = (known / density - 1.0).abs() < 0.07 || (known == 0.0 && density * grid.cell_size() < 2e-3);
        assert!(is, "cell {cell}: {known} {density}");
    }
    assert!(grid.optical_depth(0) > 400.0, "what was known is forgotten");
}

#[test]
fn other_surveys_show_one_cell_of_each_few() {
    let shown = |seed| -> Vec<usize> {
        let grid = surveyed(24, 64, seed);
        (1..24usize.pow(3)).filter(|&cell| grid.optical_depth(cell) > 0.0).collect()
    };
    let (one, other) = (shown(3), shown(4));
    assert!(one.len() > 150 && one.windows(2).all(|pair| pair[0] / 64 < pair[1] / 64), "{}", one.len());
    let places: HashSet<usize> = one.iter().map(|cell| cell % 64).collect();
    assert!(places.len() > 40, "{}", places.len());
    assert_eq!(one, shown(3));
    assert_ne!(one, other);
}

/// The cells in which an engine that knew nothing knows of something after these steps.
fn known(search: bool, steps: &[u64]) -> HashSet<usize> {
    let mut engine = CpuEngine::new(&field(V5), guided(12)).unwrap();
    engine.set_guide(&vec![0; engine.guide().len()]).unwrap();
    for &step in steps {
        engine.train_step(&batch(8, 2), &StepSettings { search, ..settings(step) }).unwrap();
    }
    (0..).zip(engine.guide()).filter(|&(_, code)| code > 0).map(|(cell, _)| cell).collect()
}

/// Trainings survey from time to time, other cells each time, once they search no longer.
#[test]
fn steps_survey_when_nothing_is_searched_for() {
    assert!(known(true, &[255]).len() < 200 && known(false, &[254]).len() < 200);
    let (one, both) = (known(false, &[255]), known(false, &[255, 511]));
    assert!(one.len() > 100_000 && both.len() > one.len() * 9 / 5, "{} {}", one.len(), both.len());
}

/// What the training's cameras do not have in view stays empty, whatever the field holds there.
#[test]
fn nothing_is_known_of_what_no_camera_has_in_view() {
    let mut engine = CpuEngine::new(&field(V5), guided(12)).unwrap();
    engine.set_views(&[view([-3.0, 0.1, 0.3], [0.1, 0.1, 0.3], 0.25 / 3.1)]);
    // Of hidden cells the guide says so by the largest code.
    let hidden =
        |engine: &CpuEngine| -> Vec<bool> { engine.guide().iter().map(|&code| code == 255).collect() };
    let before = hidden(&engine);
    let share = before.iter().filter(|&&hidden| hidden).count() as f64 / before.len() as f64;
    // Of 0.8 x 0.7 m it sees 0.67 x 0.5 m in the middle.
    assert!((0.3..0.5).contains(&share), "{share}");
    engine.expect_surfaces(&[[0.0, 0.1, 0.01], [0.1, 0.1, 0.3]]);
    engine.train_step(&batch(8, 2), &StepSettings { search: false, ..settings(255) }).unwrap();
    engine.survey();
    let mut resumed = CpuEngine::new(&field(V5), guided(12)).unwrap();
    resumed.restore(&engine.parameters().unwrap(), &engine.state().unwrap()).unwrap();
    resumed.survey();
    // Checkpoints of before hide nothing, and have the code for a density.
    let mut state = engine.state().unwrap();
    let cells = state.remove("density.cells").unwrap();
    state.insert("density".into(), cells);
    let mut older = CpuEngine::new(&field(V5), guided(12)).unwrap();
    older.restore(&engine.parameters().unwrap(), &state).unwrap();
    assert!(older.guide().iter().zip(&before).all(|(&code, &hidden)| if hidden {
        code == 254
    } else {
        code < 254
    }));
    for engine in [engine, resumed] {
        assert!(hidden(&engine) == before);
        assert!(engine.guide().iter().all(|&code| code > 0), "all else is surveyed");
    }
}

/// A survey looks at no cell that no camera has in view.
#[test]
fn surveys_leave_out_what_no_camera_has_in_view() {
    let mut parts = Parts::new(&field(V5));
    parts.density.hide_unseen(&parts.cube, &[view([-3.0, 0.1, 0.3], [0.1, 0.1, 0.3], 0.25 / 3.1)]);
    let seen = (0..16usize.pow(3)).filter(|&cell| !parts.density.is_hidden(cell)).count();
    let cost = parts.marcher(Level::new()).survey(1, Random::new(0, 0));
    assert!((1..4000).contains(&seen) && cost.updates == seen as f64, "{seen} {}", cost.updates);
}

#[test]
fn engines_survey_when_asked_to_if_the_grid_guides_them() {
    let stratified = EngineConfig { sampling: Sampling::Stratified { coarse: 4, fine: 4 }, ..guided(12) };
    let [all, none] = [guided(12), stratified].map(|config| {
        let mut engine = CpuEngine::new(&field(V5), config).unwrap();
        engine.set_guide(&vec![0; engine.guide().len()]).unwrap();
        engine.survey();
        engine.guide().iter().filter(|&&code| code > 0).count()
    });
    assert!(all > 10_000_000 && none == 0, "{all} {none}");
}
