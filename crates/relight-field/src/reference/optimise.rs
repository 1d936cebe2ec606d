//! Optimise: Adam (Kingma and Ba 2015), sparse on the hash table.

use crate::engine::{EngineError, EngineState, StateTensor};
use crate::parameters::Parameters;
use crate::real::Real;

/// Decay of the first moment.
const BETA1: f64 = 0.9;
/// Decay of the second moment.
const BETA2: f64 = 0.999;
/// Added to the root of the second moment: torch-ngp's, small beside the tiny gradients of table entries.
const EPSILON: f64 = 1e-15;

/// Adam's moments. Networks are updated at every step. An entry of the table whose gradient is zero, because no ray
/// touched it, is left alone, moments and all, and the bias correction of each counts its own updates, as in
/// tiny-cuda-nn.
#[derive(Clone, Debug)]
pub(super) struct Adam<R> {
    first: Parameters<R>,
    second: Parameters<R>,
    /// Updates of the networks.
    steps: u32,
    /// `[entries]`: updates of each entry of the table.
    updates: Vec<u32>,
}

impl<R: Real> Adam<R> {
    /// Before the first step.
    pub fn new(parameters: &Parameters<R>) -> Self {
        let zero = parameters.map(|_| R::ZERO);
        let updates = vec![0; parameters.config.grid.entries()];
        Self { first: zero.clone(), second: zero, steps: 0, updates }
    }

    /// One update of the parameters against the gradient.
    pub fn step(&mut self, parameters: &mut Parameters<R>, gradient: &Parameters<R>, learning_rate: f32) {
        self.steps = self.steps.saturating_add(1);
        let features = parameters.config.grid.features;
        let weights = parameters.tensors_mut().into_iter().zip(gradient.tensors());
        let moments = self.first.tensors_mut().into_iter().zip(self.second.tensors_mut());
        for (tensor, ((weight, (_, _, gradient)), (first, second))) in weights.zip(moments).enumerate() {
            let mut update = |range: std::ops::Range<usize>, count: u32| {
                let count = f64::from(count);
                let rate = R::from_f64(f64::from(learning_rate) / (1.0 - BETA1.powf(count)));
                let correction = R::from_f64(1.0 / (1.0 - BETA2.powf(count)));
                let (b1, b2) = (R::from_f64(BETA1), R::from_f64(BETA2));
                for i in range {
                    let g = gradient[i];
                    first[i] = b1 * first[i] + (R::ONE - b1) * g;
                    second[i] = b2 * second[i] + (R::ONE - b2) * g * g;
                    let root = (second[i] * correction).sqrt() + R::from_f64(EPSILON);
                    weight[i] = weight[i] - rate * first[i] / root;
                }
            };
            // The table comes first.
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
        state.insert("adam.steps".to_owned(), StateTensor::U32(vec![self.steps]));
        state.insert("adam.updates".to_owned(), StateTensor::U32(self.updates.clone()));
        state
    }

    /// Optimiser of `parameters` as [`Adam::state`] left it.
    pub fn restore(parameters: &Parameters<R>, state: &EngineState) -> Result<Self, EngineError> {
        let mut adam = Self::new(parameters);
        for (moment, arrays) in [("first", &mut adam.first), ("second", &mut adam.second)] {
            let names: Vec<String> = arrays.tensors().into_iter().map(|(name, _, _)| name).collect();
            for (name, values) in names.iter().zip(arrays.tensors_mut()) {
                let name = format!("adam.{moment}.{name}");
                match state.get(&name) {
                    Some(StateTensor::F32(saved)) if saved.len() == values.len() => {
                        values.iter_mut().zip(saved).for_each(|(v, &s)| *v = R::from_f32(s));
                    }
                    _ => return Err(missing(&name, values.len())),
                }
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
