//! All settings of training, and the two presets.

use std::str::FromStr;

use relight_field::engine::StepSettings;
use relight_field::optimiser::Optimiser;
use relight_field::parameters::GridConfig;
use relight_field::sampling::{LARGEST_BETA2, Sampling, Shading};
use relight_scene::Bounds;
use serde::{Deserialize, Serialize};

use crate::TrainError;
use crate::schedule::Schedule;

/// A recipe by name.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Preset {
    /// [`Recipe::fast`].
    Fast,
    /// [`Recipe::paper`].
    Paper,
}

impl Preset {
    /// Both.
    pub const ALL: [Self; 2] = [Self::Fast, Self::Paper];

    /// Its name.
    pub fn name(self) -> &'static str {
        match self {
            Self::Fast => "fast",
            Self::Paper => "paper",
        }
    }

    /// Its recipe.
    pub fn recipe(self) -> Recipe {
        match self {
            Self::Fast => Recipe::fast(),
            Self::Paper => Recipe::paper(),
        }
    }
}

impl FromStr for Preset {
    type Err = TrainError;

    fn from_str(name: &str) -> Result<Self, TrainError> {
        let unknown = || {
            let names = Self::ALL.map(Self::name).join(", ");
            TrainError::Recipe(format!("unknown preset \"{name}\"; the presets are {names}"))
        };
        Self::ALL.into_iter().find(|preset| preset.name() == name).ok_or_else(unknown)
    }
}

/// How a field is trained. Written to the run's `config.toml`, from which the run can be repeated.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, rename_all = "kebab-case")]
pub struct Recipe {
    /// Camera rays a step.
    pub rays_per_step: usize,
    /// Lights that each ray is compared under; fewer where no training view has as many (and one more, for probes).
    pub lights_per_ray: usize,
    /// Farthest that a light is moved at random along each axis, in every step anew, as a share of the distance
    /// between neighbouring lights. Both presets have 0, for it blurs shadows; recipes of before had 0.4.
    #[serde(default)]
    pub light_shift: f64,
    /// Lights that each ray is compared under beside, most of which nobody photographed: probes. There are none where
    /// a ray is compared under fewer than four lights, or where no view has more than four.
    pub probes_per_ray: usize,
    /// Farthest that a light nobody photographed is moved at random from one that somebody did, along each axis, as a
    /// share of the distance between neighbouring lights; 0: no such lights, and so no probes.
    pub probe_reach: f64,
    /// Whether stereo on the training images tells, before the first step, where surfaces are expected.
    pub stereo: bool,
    /// Optical depth of the box's edge at logit zero: how thick the fog is that training starts in.
    pub density_scale: f64,
    /// Distance from an expected depth within which ray weight goes (nearly) unpunished, as a share of the box's
    /// edge.
    pub depth_margin: f64,
    /// Steps of a training without limit over which the schedules run; they hold their last value after it.
    pub horizon: u64,
    /// Steps from one validation to the next, an "epoch"; `None`: as many as there are training images, which is what
    /// an epoch of torch-ngp has.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub epoch: Option<u64>,
    /// A training without limit ends after this many epochs without improvement.
    pub patience: u32,
    /// What counts as an improvement of validation PSNR, dB.
    pub improvement: f64,
    /// Most pixels drawn in a validation: larger splits are compared at every k-th pixel of both axes.
    pub validation_pixels: usize,
    /// Steps between lines of metrics.
    pub report_every: u64,
    /// How samples are placed along a ray.
    pub sampling: Sampling,
    /// Share of the training, from its beginning, in which more of the guided ones, on shadow rays too, go where nothing is known
    /// of. Recipes without a word of it search all the time.
    #[serde(default = "always")]
    pub search: f64,
    /// Where colour is decoded.
    pub shading: Shading,
    /// Samples whose gradients are shorter than this many times the mean are left out at random when gradients go back
    /// to the grid, while those that stay count more; 0 leaves none out.
    pub roulette: f64,
    /// How networks follow their gradients; the hash table always has Adam. Recipes without a word of it have Adam.
    #[serde(default)]
    pub optimiser: Optimiser,
    /// Adam's decay of second moments: above 0, at most 0.999.
    pub beta2: f64,
    /// Adam's learning rate.
    pub learning_rate: Schedule,
    /// Weight of the penalty on ray weight far from the depth that stereo expects.
    pub depth_weight: Schedule,
    /// Weight of a ray's probes together, beside its photographs together, if what is imagined of them were as sure as
    /// photographs: engines find out how sure it is, and weigh it by that.
    pub probe_weight: Schedule,
    /// Weight of the distortion loss.
    pub distortion_weight: Schedule,
    /// The hash grid; `None`: as fine as the images ask for, see [`fitting_grid`](crate::fineness::fitting_grid).
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub grid: Option<GridConfig>,
}

impl Recipe {
    /// The published recipe (paper, section 4.3): 4096 rays over all images, one light each; 128 stratified and 128
    /// importance samples; Adam at a constant 1e-2, its decays torch's own; L2 alone; until 10 epochs bring no
    /// improvement. Where the paper is silent: colour at every sample that weighs more than 1e-4 and a density of 1 at
    /// logit zero in a box of edge 2, both as torch-ngp has them; the last sample of a ray is opaque, and what lies
    /// beyond the box is painted there.
    pub fn paper() -> Self {
        Self {
            rays_per_step: 4096,
            lights_per_ray: 1,
            light_shift: 0.0,
            probes_per_ray: 0,
            probe_reach: 0.0,
            stereo: false,
            density_scale: 2.0,
            depth_margin: 0.0,
            horizon: 150_000,
            epoch: None,
            patience: 10,
            improvement: 0.0,
            validation_pixels: 1_000_000,
            report_every: 10,
            sampling: Sampling::Stratified { coarse: 128, fine: 128 },
            search: 0.0,
            shading: Shading::PerSample,
            roulette: 0.0,
            optimiser: Optimiser::Adam,
            beta2: 0.999,
            learning_rate: Schedule::Constant(1e-2),
            depth_weight: Schedule::Constant(0.0),
            probe_weight: Schedule::Constant(0.0),
            distortion_weight: Schedule::Constant(0.0),
            grid: Some(GridConfig::default()),
        }
    }

    /// Ours: each ray compared under several lights at once, samples where something is, colour decoded once a ray
    /// and light (twice where the ray also shows what lies beyond the box), and depths from stereo to start the geometry.
    pub fn fast() -> Self {
        Self {
            rays_per_step: 256,
            lights_per_ray: 8,
            probes_per_ray: 4,
            probe_reach: 1.3,
            stereo: true,
            density_scale: 0.1,
            depth_margin: 0.015,
            horizon: 60_000,
            epoch: Some(2000),
            patience: 5,
            improvement: 0.02,
            validation_pixels: 250_000,
            report_every: 100,
            sampling: Sampling::Guided { samples: 16 },
            search: 0.2,
            shading: Shading::Deferred,
            roulette: 1.5,
            optimiser: Optimiser::Soap,
            beta2: 0.999,
            learning_rate: Schedule::Linear { from: 1e-2, to: 1e-4, start: 0.3, end: 1.0 },
            depth_weight: Schedule::Linear { from: 0.1, to: 0.0, start: 0.0, end: 0.25 },
            probe_weight: Schedule::Linear { from: 0.0, to: 0.8, start: 0.15, end: 0.2 },
            grid: None,
            ..Self::paper()
        }
    }

    /// Settings of step `step` at `progress` (0..1), for a field in the box `bounds`.
    pub fn step_settings(&self, step: u64, progress: f64, bounds: &Bounds) -> StepSettings {
        StepSettings {
            step,
            learning_rate: self.learning_rate.at(progress) as f32,
            depth_weight: self.depth_weight.at(progress) as f32,
            depth_margin: self.depth_margin as f32 * bounds.longest_edge(),
            distortion_weight: self.distortion_weight.at(progress) as f32,
            probe_weight: self.probe_weight.at(progress) as f32,
            roulette: self.roulette as f32,
            search: progress < self.search,
        }
    }

    /// Checks what a hand-edited file may get wrong.
    ///
    /// # Errors
    /// [`TrainError::Recipe`] naming the setting.
    pub fn validate(&self) -> Result<(), TrainError> {
        let fault = |setting: &str, rule: &str| Err(TrainError::Recipe(format!("{setting} must be {rule}")));
        if !(1..=1 << 20).contains(&self.rays_per_step) {
            return fault("rays-per-step", "1 to 1048576");
        }
        if !(1..=4096).contains(&self.lights_per_ray) {
            return fault("lights-per-ray", "1 to 4096");
        }
        if !(self.light_shift.is_finite() && (0.0..=2.0).contains(&self.light_shift)) {
            return fault("light-shift", "0 to 2 times the distance between lights");
        }
        if !(self.probe_reach.is_finite() && (0.0..=4.0).contains(&self.probe_reach)) {
            return fault("probe-reach", "0 to 4 times the distance between lights");
        }
        if !(self.roulette.is_finite() && (0.0..=16.0).contains(&self.roulette)) {
            return fault("roulette", "0 to 16 times the mean");
        }
        if !(0.0..=1.0).contains(&self.search) {
            return fault("search", "a share of the training, 0 to 1");
        }
        if !(self.beta2 > 0.0 && self.beta2 <= LARGEST_BETA2) {
            return fault("beta2", "above 0, and at most 0.999");
        }
        if self.probes_per_ray > 64 {
            return fault("probes-per-ray", "at most 64");
        }
        if self.rays_per_step * (self.lights_per_ray + self.probes_per_ray) > 1 << 22 {
            return fault("rays-per-step times lights and probes per ray", "at most 4194304");
        }
        let (first, second) = match self.sampling {
            Sampling::Guided { samples } => (samples, 0),
            Sampling::Stratified { coarse, fine } => (coarse, fine),
        };
        if !(2..=4096).contains(&first) || second > 4096 {
            return fault("samples and coarse", "2 to 4096, and fine at most 4096");
        }
        // Some 400 bytes each.
        if self.rays_per_step * (first + second) > 1 << 24 {
            return fault("rays-per-step times samples of a ray", "at most 16777216");
        }
        let punished = [0.0, 0.25, 0.5, 0.75, 1.0].iter().any(|&p| self.depth_weight.at(p) > 0.0);
        if punished && self.depth_margin <= 0.0 {
            return fault("depth-margin", "above 0 where depth-weight is");
        }
        if !(self.depth_margin.is_finite() && self.depth_margin >= 0.0) {
            return fault("depth-margin", "a share of the box's edge, 0 or more");
        }
        if self.horizon == 0 || self.epoch == Some(0) || self.report_every == 0 || self.validation_pixels == 0
        {
            return fault("horizon, epoch, report-every and validation-pixels", "at least 1");
        }
        if !(self.improvement.is_finite() && self.improvement >= 0.0) {
            return fault("improvement", "a number of dB, 0 or more");
        }
        for (name, schedule) in [
            ("learning-rate", &self.learning_rate),
            ("depth-weight", &self.depth_weight),
            ("probe-weight", &self.probe_weight),
            ("distortion-weight", &self.distortion_weight),
        ] {
            if !schedule.is_valid() {
                return fault(name, "finite and not negative, with its start before its end");
            }
        }
        Ok(())
    }
}

/// The default of [`Recipe::search`].
fn always() -> f64 {
    1.0
}

#[cfg(test)]
mod tests {
    use super::*;

    const BOUNDS: Bounds = Bounds { lo: [-1.0; 3], hi: [1.0; 3] };

    #[test]
    fn presets_are_valid_and_survive_toml() {
        for preset in Preset::ALL {
            assert_eq!(preset.name().parse::<Preset>().unwrap(), preset);
            let recipe = preset.recipe();
            recipe.validate().unwrap();
            let text = toml::to_string(&recipe).unwrap();
            assert_eq!(toml::from_str::<Recipe>(&text).unwrap(), recipe, "{text}");
            // Lights stay where they are, and so they do where nothing is said of it.
            assert_eq!(recipe.light_shift, 0.0);
            let lines = text.lines().filter(|line| !line.starts_with("light-shift"));
            assert_eq!(toml::from_str::<Recipe>(&lines.collect::<Vec<_>>().join("\n")).unwrap(), recipe);
        }
        assert!("slow".parse::<Preset>().unwrap_err().to_string().contains("fast, paper"));
    }

    #[test]
    fn faults_name_the_setting() {
        let recipe = Recipe { learning_rate: Schedule::Constant(f64::INFINITY), ..Recipe::fast() };
        assert!(recipe.validate().unwrap_err().to_string().contains("learning-rate"));
        for sampling in [
            Sampling::Guided { samples: 1 },
            Sampling::Guided { samples: 1_000_000_000_000 },
            Sampling::Stratified { coarse: usize::MAX, fine: usize::MAX },
        ] {
            let recipe = Recipe { sampling, ..Recipe::fast() };
            assert!(recipe.validate().unwrap_err().to_string().contains("samples"));
        }
        let recipe = Recipe { depth_margin: 0.0, ..Recipe::fast() };
        assert!(recipe.validate().unwrap_err().to_string().contains("depth-margin"));
        let recipe = Recipe { rays_per_step: 1 << 20, lights_per_ray: 4096, ..Recipe::fast() };
        assert!(recipe.validate().unwrap_err().to_string().contains("rays-per-step times"));
        let recipe =
            Recipe { rays_per_step: 1 << 20, lights_per_ray: 4, probes_per_ray: 64, ..Recipe::fast() };
        assert!(recipe.validate().unwrap_err().to_string().contains("rays-per-step times"));
        let recipe = Recipe { probes_per_ray: usize::MAX, ..Recipe::fast() };
        assert!(recipe.validate().unwrap_err().to_string().contains("probes-per-ray"));
        for beta2 in [0.0, 0.9999, f64::NAN] {
            let recipe = Recipe { beta2, ..Recipe::fast() };
            assert!(recipe.validate().unwrap_err().to_string().contains("beta2"));
        }
        for search in [-0.1, 1.1, f64::NAN] {
            let recipe = Recipe { search, ..Recipe::fast() };
            assert!(recipe.validate().unwrap_err().to_string().contains("search"));
        }
        let recipe = Recipe { roulette: f64::NAN, ..Recipe::fast() };
        assert!(recipe.validate().unwrap_err().to_string().contains("roulette"));
        let recipe = Recipe { rays_per_step: 0, ..Recipe::fast() };
        assert!(recipe.validate().unwrap_err().to_string().contains("rays-per-step"));
    }

    #[test]
    fn recipes_of_before_have_adam_and_search_all_the_time() {
        let text = toml::to_string(&Recipe::fast()).unwrap();
        let before = text.replace("optimiser = \"soap\"\n", "").replace("search = 0.2\n", "");
        assert_eq!(before.lines().count() + 2, text.lines().count());
        let recipe = toml::from_str::<Recipe>(&before).unwrap();
        assert_eq!((recipe.optimiser, recipe.search), (Optimiser::Adam, 1.0));
        recipe.validate().unwrap();
        assert!(recipe.step_settings(0, 0.999, &BOUNDS).search);
    }

    #[test]
    fn trainings_search_at_their_beginning() {
        for (recipe, progress, search) in [
            (Recipe::fast(), 0.0, true),
            (Recipe::fast(), 0.19, true),
            (Recipe::fast(), 0.2, false),
            (Recipe::fast(), 1.0, false),
            (Recipe::paper(), 0.0, false),
        ] {
            assert_eq!(recipe.step_settings(7, progress, &BOUNDS).search, search, "{progress}");
        }
    }

    #[test]
    fn unknown_settings_are_refused_by_name() {
        let text = format!("warp = 9\n{}", toml::to_string(&Recipe::fast()).unwrap());
        assert!(toml::from_str::<Recipe>(&text).unwrap_err().to_string().contains("warp"));
    }
}
