//! What a checkpoint holds beside the weights: the optimiser's moments and bases, the density grid and what is known
//! of probes.

use relight_field::engine::{EngineError, EngineState, StateTensor};

use crate::density_grid::{DensityGrid, HIDDEN};
use crate::experience::{Experience, Fading, Share};
use crate::hash_grid::HashGrid;
use crate::moments::Moments;
use crate::shadow::Shadow;
use crate::soap::ARRAYS;

/// Names of the networks, in the order of their moments.
const NETWORKS: [&str; 3] = ["geo", "rgb", "vis"];

/// What shadows leave, see [`Shadow::class`]: to be renamed when classes are others.
const SHADOWS: &str = "probes.shadows";
/// Cells of the density grid.
const CELLS: &str = "density.cells";
/// The same in checkpoints of before some were [`HIDDEN`], whose code stood for a density then.
const CELLS_BEFORE: &str = "density";

/// The state of an engine made of these parts.
pub fn save(
    grid: &HashGrid,
    moments: &[Moments; 3],
    density: &DensityGrid,
    experience: Experience,
) -> EngineState {
    let mut state = EngineState::new();
    let (m, v, updates) = grid.moments();
    state.insert("adam.grid.m".into(), StateTensor::F32(m));
    state.insert("adam.grid.v".into(), StateTensor::F32(v));
    state.insert("adam.grid.updates".into(), StateTensor::U32(updates));
    for (moments, name) in moments.iter().zip(NETWORKS) {
        state.insert(format!("adam.{name}.m"), StateTensor::F32(moments.m.clone()));
        state.insert(format!("adam.{name}.v"), StateTensor::F32(moments.v.clone()));
        state.insert(format!("adam.{name}.updates"), StateTensor::U32(vec![moments.updates]));
        for (layer, soap) in moments.bases.iter().enumerate() {
            for (part, numbers) in ARRAYS.into_iter().zip(soap.arrays()) {
                state.insert(format!("soap.{name}.{layer}.{part}"), StateTensor::F32(numbers));
            }
        }
    }
    let Experience { shares, imagined, field, least } = experience;
    let means = [imagined, field].into_iter().flat_map(|mean| [mean.sum, mean.count]).chain([least]);
    state.insert("probes".into(), StateTensor::F32(means.collect()));
    let shares = shares.iter().flat_map(|share| [share.products, share.squares, share.count]);
    state.insert(SHADOWS.into(), StateTensor::F32(shares.collect()));
    state.insert(CELLS.into(), StateTensor::U8(density.cells()));
    state
}

/// Puts a state back into the parts of an engine.
///
/// # Errors
/// [`EngineError::Shape`] if an array is missing or does not fit; some parts may then have been replaced.
pub fn load(
    state: &EngineState,
    grid: &mut HashGrid,
    moments: &mut [Moments; 3],
    density: &mut DensityGrid,
    experience: &mut Experience,
) -> Result<(), EngineError> {
    let missing = |name: &str| {
        EngineError::Shape(format!("the checkpoint lacks `{name}`, or holds it in another shape"))
    };
    let f32s = |name: &str| match state.get(name) {
        Some(StateTensor::F32(numbers)) => Ok(numbers),
        _ => Err(missing(name)),
    };
    let u32s = |name: &str| match state.get(name) {
        Some(StateTensor::U32(numbers)) => Ok(numbers),
        _ => Err(missing(name)),
    };
    if !grid.set_moments(f32s("adam.grid.m")?, f32s("adam.grid.v")?, u32s("adam.grid.updates")?) {
        return Err(missing("adam.grid"));
    }
    let plain = moments.iter().all(|moments| moments.bases.is_empty());
    if plain && state.keys().any(|name| name.starts_with("soap.")) {
        return Err(EngineError::Shape("the checkpoint is of networks that were trained by SOAP".into()));
    }
    for (moments, network) in moments.iter_mut().zip(NETWORKS) {
        for (mine, part) in [(&mut moments.m, "m"), (&mut moments.v, "v")] {
            let name = format!("adam.{network}.{part}");
            let numbers = f32s(&name)?;
            if numbers.len() != mine.len() {
                return Err(missing(&name));
            }
            mine.copy_from_slice(numbers);
        }
        let name = format!("adam.{network}.updates");
        let [updates] = u32s(&name)?[..] else { return Err(missing(&name)) };
        moments.updates = updates;
        for (layer, soap) in moments.bases.iter_mut().enumerate() {
            let mut arrays = [&[][..]; ARRAYS.len()];
            for (array, part) in arrays.iter_mut().zip(ARRAYS) {
                *array = f32s(&format!("soap.{network}.{layer}.{part}"))?;
            }
            if !soap.set_arrays(arrays) {
                return Err(missing(&format!("soap.{network}.{layer}")));
            }
        }
    }
    let (means, &[least]) = f32s("probes")?.as_chunks() else { return Err(missing("probes")) };
    let mean = |[sum, count]: [f32; 2]| Fading { sum, count };
    let (imagined, field, shares) = match *means {
        [imagined, field] => (imagined, field, f32s(SHADOWS)?.as_slice()),
        // Before shadows had classes, a mean stood there that told how dark all of them are.
        [_, imagined, field] => (imagined, field, &[0.0; 3 * Shadow::CLASSES][..]),
        _ => return Err(missing("probes")),
    };
    let (shares, []) = shares.as_chunks() else { return Err(missing(SHADOWS)) };
    let shares: &[[f32; 3]; Shadow::CLASSES] = shares.try_into().map_err(|_| missing(SHADOWS))?;
    let shares = shares.map(|[products, squares, count]| Share { products, squares, count });
    *experience = Experience { shares, imagined: mean(imagined), field: mean(field), least };
    let fits = match (state.get(CELLS), state.get(CELLS_BEFORE)) {
        (Some(StateTensor::U8(cells)), _) => density.set_cells(cells),
        (None, Some(StateTensor::U8(cells))) => {
            density.set_cells(&cells.iter().map(|&cell| cell.min(HIDDEN - 1)).collect::<Vec<u8>>())
        }
        _ => false,
    };
    if fits { Ok(()) } else { Err(missing(CELLS)) }
}
