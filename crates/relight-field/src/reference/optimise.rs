//! Optimise: Adam (Kingma and Ba 2015), sparse on the hash table, and for the networks Adam or SOAP.

use super::soap::{ARRAYS, Soap};
use crate::engine::{EngineError, EngineState, StateTensor};
use crate::optimiser::Optimiser;
use crate::parameters::Parameters;
use crate::real::Real;

/// Decay of the first moment.
pub(super) const BETA1: f64 = 0.9;
/// Added to the root of the second moment: torch-ngp's, small beside the tiny gradients of table entries.
const EPSILON: f64 = 1e-15;

/// Adam's moments, and the bases of SOAP. Networks are updated at every step. An entry of the table whose gradient is zero, because no ray
/// touched it, is left alone, moments and all, and the bias correction of each counts its own updates, as in
/// tiny-cuda-nn.
#[derive(Clone, Debug)]
pub(super) struct Moments<R> {
    first: Parameters<R>,
    second: Parameters<R>,
    /// Updates of the networks.
    steps: u32,
    /// `[entries]`: updates of each entry of the table.
    updates: Vec<u32>,
    /// Of every layer of the networks, with its number in its network; none under Adam.
    bases: Vec<(u32, Soap<R>)>,
}

impl<R: Real> Moments<R> {
    /// Before the first step.
    pub fn new(parameters: &Parameters<R>, optimiser: Optimiser) -> Self {
        let zero = parameters.map(|_| R::ZERO);
        let updates = vec![0; parameters.config.grid.entries()];
        let networks = match optimiser {
            Optimiser::Adam => vec![],
            Optimiser::Soap => vec![Some(&parameters.geo), Some(&parameters.rgb), parameters.vis.as_ref()],
        };
        let layers = networks.into_iter().flatten().flat_map(|network| (0..).zip(&network.layers));
        let bases =
            layers.map(|(number, layer)| (number, Soap::new([layer.outputs, layer.inputs]))).collect();
        Self { first: zero.clone(), second: zero, steps: 0, updates, bases }
    }

    /// One update of the parameters against the gradient; `beta2` is the decay of the second moment.
    pub fn step(
        &mut self,
        parameters: &mut Parameters<R>,
        gradient: &Parameters<R>,
        learning_rate: f32,
        beta2: f64,
    ) {
        self.steps = self.steps.saturating_add(1);
        let features = parameters.config.grid.features;
        let weights = parameters.tensors_mut().into_iter().zip(gradient.tensors());
        let moments = self.first.tensors_mut().into_iter().zip(self.second.tensors_mut());
        for (tensor, ((weight, (_, _, gradient)), (first, second))) in weights.zip(moments).enumerate() {
            let mut update = |range: std::ops::Range<usize>, count: u32| {
                let count = f64::from(count);
                let rate = R::from_f64(f64::from(learning_rate) / (1.0 - BETA1.powf(count)));
                let correction = R::from_f64(1.0 / (1.0 - beta2.powf(count)));
                let (b1, b2) = (R::from_f64(BETA1), R::from_f64(beta2));
                for i in range {
                    let g = gradient[i];
                    first[i] = b1 * first[i] + (R::ONE - b1) * g;
                    second[i] = b2 * second[i] + (R::ONE - b2) * g * g;
                    let root = (second[i] * correction).sqrt() + R::from_f64(EPSILON);
                    weight[i] = weight[i] - rate * first[i] / root;
                }
            };
            // The table comes first.
            if let Some((layer, soap)) = tensor.checked_sub(1).and_then(|layer| self.bases.get_mut(layer)) {
                let (at, rate) = ((*layer, self.steps), R::from_f32(learning_rate));
                soap.step(weight, gradient, [first, second], at, rate, beta2);
                continue;
            }
            if tensor > 0 {
                update(0..gradient.len(), self.steps);
                continue;
            }
            for (entry, count) in self.updates.iter_mut().enumerate() {
                let range = entry * features..(entry + 1) * features;
                if gradient[range.clone()].iter().any(|&g| g != R::ZERO) {
                    *count = count.saturating_add(1);
                    update(range, *count);
                }
            }
        }
    }

    /// All of it, by name; moments as `f32`.
    pub fn state(&self) -> EngineState {
        let mut state = EngineState::new();
        for (moment, arrays) in [("first", &self.first), ("second", &self.second)] {
            for (name, _, values) in arrays.tensors() {
                let values = values.iter().map(|v| v.to_f32()).collect();
                state.insert(format!("adam.{moment}.{name}"), StateTensor::F32(values));
            }
        }
        for (i, (_, soap)) in self.bases.iter().enumerate() {
            for (name, values) in ARRAYS.into_iter().zip(soap.arrays()) {
                let values = values.iter().map(|v| v.to_f32()).collect();
                state.insert(format!("soap.{i}.{name}"), StateTensor::F32(values));
            }
        }
        state.insert("adam.steps".to_owned(), StateTensor::U32(vec![self.steps]));
        state.insert("adam.updates".to_owned(), StateTensor::U32(self.updates.clone()));
        state
    }

    /// Optimiser of `parameters` as [`Moments::state`] left it.
    pub fn restore(
        parameters: &Parameters<R>,
        optimiser: Optimiser,
        state: &EngineState,
    ) -> Result<Self, EngineError> {
        let mut adam = Self::new(parameters, optimiser);
        let restore = |name: &str, values: &mut [R]| match state.get(name) {
            Some(StateTensor::F32(saved)) if saved.len() == values.len() => {
                values.iter_mut().zip(saved).for_each(|(v, &s)| *v = R::from_f32(s));
                Ok(())
            }
            _ => Err(missing(name, values.len())),
        };
        for (moment, arrays) in [("first", &mut adam.first), ("second", &mut adam.second)] {
            let names: Vec<String> = arrays.tensors().into_iter().map(|(name, _, _)| name).collect();
            for (name, values) in names.iter().zip(arrays.tensors_mut()) {
                restore(&format!("adam.{moment}.{name}"), values)?;
            }
        }
        for (i, (_, soap)) in adam.bases.iter_mut().enumerate() {
            for (name, values) in ARRAYS.into_iter().zip(soap.arrays_mut()) {
                restore(&format!("soap.{i}.{name}"), values)?;
            }
        }
        for (name, values) in
            [("adam.steps", std::slice::from_mut(&mut adam.steps)), ("adam.updates", &mut adam.updates[..])]
        {
            match state.get(name) {
                Some(StateTensor::U32(saved)) if saved.len() == values.len() => values.copy_from_slice(saved),
                _ => return Err(missing(name, values.len())),
            }
        }
        Ok(adam)
    }
}

/// What is said of a state without an array of the right type and length.
fn missing(name: &str, len: usize) -> EngineError {
    EngineError::Shape(format!(
        "the state has no {name} of {len} numbers: it is not of this field or this engine"
    ))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::architecture::V0;
    use crate::parameters::{FieldConfig, GridConfig};
    use relight_scene::Bounds;
    use serde::Deserialize;

    fn parameters() -> Parameters<f64> {
        let config = FieldConfig {
            architecture: V0,
            grid: GridConfig { levels: 1, features: 2, log2_table: 3, base: 1, finest: 1 },
            bounds: Bounds { lo: [0.0; 3], hi: [1.0; 3] },
            density_scale: 1.0,
        };
        Parameters::init(config, 0).unwrap().map(f64::from)
    }

    /// Made by `tools/golden_field.py`: entries of the table, and PyTorch's Adam on each with the steps that touch it.
    #[derive(Deserialize)]
    struct Golden {
        start: Vec<[f64; 2]>,
        gradients: Vec<Vec<[f64; 2]>>,
        end: Vec<[f64; 2]>,
    }

    #[test]
    fn entries_count_their_own_updates_as_if_each_had_its_own_adam() {
        let golden: Golden = serde_json::from_str(include_str!("../../tests/golden/adam.json")).unwrap();
        let mut parameters = parameters();
        let mut adam = Moments::new(&parameters, Optimiser::Adam);
        let numbers = golden.start.as_flattened().len();
        parameters.table[..numbers].copy_from_slice(golden.start.as_flattened());
        for step in &golden.gradients {
            let mut gradient = parameters.map(|_| 0.0);
            gradient.table[..numbers].copy_from_slice(step.as_flattened());
            adam.step(&mut parameters, &gradient, 1e-2, 0.999);
        }
        for (ours, theirs) in parameters.table.iter().zip(golden.end.as_flattened()) {
            assert!((ours - theirs).abs() < 1e-12, "{ours} {theirs}");
        }
        assert_eq!(adam.updates, [6, 3, 4, 0, 0, 0, 0, 0]);
    }

    #[test]
    fn a_constant_gradient_moves_networks_by_the_learning_rate() {
        let start = parameters();
        let mut parameters = start.clone();
        let mut adam = Moments::new(&parameters, Optimiser::Adam);
        let gradient = parameters.map(|w| if w > 0.0 { 3.0 } else { -7.0 });
        for _ in 0..5 {
            adam.step(&mut parameters, &gradient, 0.125, 0.999);
        }
        for (after, before) in parameters.tensors().into_iter().zip(start.tensors()) {
            for (a, b) in after.2.iter().zip(before.2) {
                assert!((a - (b - 0.625 * b.signum())).abs() < 1e-9);
            }
        }
    }

    #[test]
    fn state_restores_the_optimiser_and_refuses_another_fields() {
        for optimiser in [Optimiser::Adam, Optimiser::Soap] {
            state_restores(optimiser);
        }
    }

    fn state_restores(optimiser: Optimiser) {
        let mut parameters = parameters();
        let mut adam = Moments::new(&parameters, optimiser);
        let gradient = parameters.map(|w| f64::from(w as f32));
        adam.step(&mut parameters, &gradient, 0.1, 0.999);
        let state = adam.state();
        let restored = Moments::restore(&parameters, optimiser, &state).unwrap();
        assert_eq!(restored.state(), state);
        for name in state.keys() {
            let mut broken = state.clone();
            broken.insert(name.clone(), StateTensor::U8(vec![1]));
            let message = Moments::restore(&parameters, optimiser, &broken).unwrap_err().to_string();
            assert!(message.contains(name), "{message}");
        }
    }
}
