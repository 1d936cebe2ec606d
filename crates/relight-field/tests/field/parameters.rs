//! First weights of a field, and what is refused.

use relight_field::architecture::{Architecture, V2, V5, VARIANTS};
use relight_field::parameters::{FieldConfig, GridConfig, Parameters};
use relight_scene::Bounds;

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
        for (name, [_, inputs], weights) in parameters.tensors() {
            let bound = if name == "grid.table" { 1e-4 } else { 1.0 / (inputs as f32).sqrt() };
            let largest = weights.iter().fold(0.0f32, |m, w| m.max(w.abs()));
            assert!(largest <= bound && largest > 0.9 * bound, "{name}");
        }
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
    refuse(|c| c.grid.features = 3, "grid.features");
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
    refuse(|p| p.rgb.layers.truncate(3), "rgb.3.weight is missing");
    refuse(|p| p.config.architecture = V2, "rgb.0.weight");
    refuse(|p| p.config.architecture.visibility = false, "vis.0.weight is no tensor");
    refuse(|p| p.vis = None, "vis.0.weight is missing");
}

#[test]
fn default_grid_has_the_resolutions_of_torch_ngp() {
    let levels = GridConfig::default().level_table();
    assert_eq!((levels[0].resolution, levels[15].resolution), (16, 2048));
    assert!(levels.windows(2).all(|w| w[0].offset + w[0].entries == w[1].offset));
    assert_eq!(levels.iter().filter(|l| !l.hashed).count(), 5);
}
