//! Where the time of training steps goes.
//!
//! What all threads do together is timed as a whole. Inside tiles each thread keeps its own clock, and the time of the
//! whole is divided among the stages as the threads spent theirs.

use std::time::Instant;

use relight_field::engine::StageCost;

/// A stage of a step.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Stage {
    /// Placing samples along the rays; of those that are drawn from weights, the weights too.
    March,
    /// Looking their features up.
    Encode,
    /// `geo` at the samples.
    Geometry,
    /// Weights of the samples, and features averaged under them.
    Composite,
    /// `rgb` and `vis` at all pairs.
    Shade,
    /// Differences from photographs and probes.
    Loss,
    /// Gradients of `rgb` and `vis`.
    ShadeBackward,
    /// Gradients of weights and densities.
    CompositeBackward,
    /// Gradients of `geo`.
    GeometryBackward,
    /// Roulette on the gradients of samples.
    Roulette,
    /// Looking which shadow rays meet something.
    ShadowLook,
    /// Placing samples along those.
    ShadowMarch,
    /// Looking their features up.
    ShadowEncode,
    /// `geo` at those samples.
    ShadowGeometry,
    /// Sum of the network gradients, and Adam or SOAP on the networks.
    OptimiseNetworks,
    /// Gradients of the grid's entries from those of samples.
    Scatter,
    /// Adam on the entries that were touched.
    OptimiseGrid,
    /// The density grid told what densities there were.
    Occupancy,
    /// The density grid shown the field where no ray looks.
    Survey,
}

impl Stage {
    /// All stages, in the order of a step.
    pub const ALL: [(Self, &'static str); 19] = [
        (Self::March, "march"),
        (Self::Encode, "encode"),
        (Self::ShadowLook, "shadow rays: look"),
        (Self::ShadowMarch, "shadow rays: march"),
        (Self::ShadowEncode, "shadow rays: encode"),
        (Self::ShadowGeometry, "shadow rays: geometry"),
        (Self::Geometry, "geometry"),
        (Self::Composite, "composite"),
        (Self::Shade, "colour and visibility"),
        (Self::Loss, "loss"),
        (Self::ShadeBackward, "colour and visibility, backward"),
        (Self::CompositeBackward, "composite, backward"),
        (Self::GeometryBackward, "geometry, backward"),
        (Self::Roulette, "roulette"),
        (Self::OptimiseNetworks, "optimise networks"),
        (Self::Scatter, "scatter"),
        (Self::OptimiseGrid, "optimise grid"),
        (Self::Occupancy, "occupancy"),
        (Self::Survey, "survey"),
    ];
}

/// What each stage cost so far.
#[derive(Clone, Copy, Debug, Default)]
pub struct Costs([StageCost; Stage::ALL.len()]);

impl Costs {
    /// The cost of a stage.
    pub fn of(&mut self, stage: Stage) -> &mut StageCost {
        &mut self.0[stage as usize]
    }

    /// Seconds of all stages.
    fn seconds(&self) -> f64 {
        self.0.iter().map(|cost| cost.seconds).sum()
    }

    /// Adds what one thread counted.
    pub fn add(&mut self, other: &Self) {
        self.0.iter_mut().zip(&other.0).for_each(|(mine, other)| mine.add(other));
    }

    /// Both together.
    pub fn plus(mut self, other: Self) -> Self {
        self.add(&other);
        self
    }

    /// Adds what all threads together counted in `seconds` of time: those are divided as the threads' are.
    pub fn add_share(&mut self, mut threads: Self, seconds: f64) {
        let total = threads.seconds().max(1e-12);
        threads.0.iter_mut().for_each(|cost| cost.seconds *= seconds / total);
        self.add(&threads);
    }

    /// The costs by name, in the order of a step.
    pub fn named(&self) -> Vec<(&'static str, StageCost)> {
        Stage::ALL.iter().map(|&(stage, name)| (name, self.0[stage as usize])).collect()
    }
}

/// One thread's clock.
#[derive(Clone, Copy, Debug)]
pub struct Clock {
    last: Instant,
    costs: Costs,
}

impl Default for Clock {
    fn default() -> Self {
        Self { last: Instant::now(), costs: Costs::default() }
    }
}

impl Clock {
    /// Begins anew.
    pub fn start(&mut self) {
        *self = Self::default();
    }

    /// Counts the time since the last lap to a stage, with the operations it took.
    pub fn lap(&mut self, stage: Stage, operations: usize) {
        let now = Instant::now();
        let cost = self.costs.of(stage);
        cost.seconds += (now - self.last).as_secs_f64();
        cost.operations += operations as f64;
        self.last = now;
    }

    /// Counts a cost to a stage that ends now and was measured elsewhere.
    pub fn count(&mut self, stage: Stage, cost: &StageCost) {
        self.costs.of(stage).add(cost);
        self.last = Instant::now();
    }

    /// What was counted since [`Clock::start`].
    pub fn costs(&self) -> &Costs {
        &self.costs
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_stage_has_its_name() {
        for (i, (stage, _)) in Stage::ALL.iter().enumerate() {
            let twins = Stage::ALL.iter().filter(|(other, _)| other == stage).count();
            assert_eq!(twins, 1, "{i}");
        }
        assert!(Stage::ALL.iter().all(|(stage, _)| (*stage as usize) < Stage::ALL.len()));
    }

    #[test]
    fn the_time_of_the_whole_is_divided_as_threads_spent_theirs() {
        let (mut threads, mut all) = (Costs::default(), Costs::default());
        *threads.of(Stage::Geometry) = StageCost { seconds: 3.0, operations: 10.0, ..StageCost::default() };
        threads.of(Stage::Shade).seconds = 1.0;
        all.add_share(threads, 2.0);
        all.add_share(threads, 2.0);
        assert_eq!(all.of(Stage::Geometry).seconds, 3.0);
        assert_eq!(all.of(Stage::Geometry).operations, 20.0);
        assert_eq!(all.of(Stage::Shade).seconds, 1.0);
    }

    #[test]
    fn laps_count_to_their_stage() {
        let mut clock = Clock::default();
        clock.lap(Stage::Loss, 7);
        clock.lap(Stage::Shade, 1);
        clock.lap(Stage::Loss, 5);
        assert_eq!(clock.costs.of(Stage::Loss).operations, 12.0);
        assert_eq!(clock.costs.of(Stage::Shade).operations, 1.0);
        assert_eq!(clock.costs.of(Stage::March).operations, 0.0);
        clock.start();
        assert_eq!(clock.costs.of(Stage::Loss).operations, 0.0);
    }
}
