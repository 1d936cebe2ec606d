//! What is done around each photograph beside taking it.

use serde::{Deserialize, Serialize};

use super::SessionError;

/// Dark and flat frames, exposure brackets, and checks that nothing moved. Nothing of it is done unless asked for. It is part of
/// what a session is, and can stand as a table of a rig file, where all of it may be left out.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields, rename_all = "kebab-case")]
pub struct Care {
    /// Frames without light that are averaged at the session's start; 0: none.
    pub dark_frames: u32,
    /// Frames of an evenly lit target that are averaged at the session's start; 0: none.
    pub flat_frames: u32,
    /// Exposures of each photograph, as multiples of the camera's own, merged to one; none: its own alone.
    pub exposures: Vec<f64>,
    /// What light is multiplied by before it becomes an 8-bit image, 1 if left out.
    pub tone: Option<f32>,
    /// Whether the merged light is kept too, as `.capture/hdr/lsetLLL/VVVVV.exr`.
    pub exr: bool,
    /// How often a photograph is taken anew until it agrees with the one before; 0: the first counts.
    pub settle_tries: u32,
    /// Whether a view's first photograph is taken again at its end, and where a session goes on in the midst of it, to see that
    /// neither object nor camera moved.
    pub movement: bool,
    /// After how many photographs of a view it is taken again besides; 0: never.
    pub movement_every: u32,
    /// What follows if something moved.
    pub when_moved: WhenMoved,
    /// A factor for each light that evens out how bright the lamp was; empty: none.
    pub light_gains: Vec<f32>,
    /// Photographs a light of a grey card, from which these factors are made at the session's start; 0: none.
    pub light_gain_frames: u32,
    /// Where the middle of that card lies, flat, world, metres; the origin if left out.
    pub card_metres: [f64; 3],
}

/// What follows if something moved while a view was shot.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum WhenMoved {
    /// The session goes on, and names the view's frames at its end.
    #[default]
    Tell,
    /// The session ends.
    Stop,
    /// The view is shot again; if something moves then too, and once more, the session ends.
    Reshoot,
}

impl Care {
    /// Whether photographs are more than a frame as it came.
    pub(super) fn works_on_light(&self) -> bool {
        self.dark_frames > 0
            || self.flat_frames > 0
            || !self.exposures.is_empty()
            || self.tone.is_some()
            || self.exr
            || !self.light_gains.is_empty()
            || self.light_gain_frames > 0
    }

    /// Refuses what cannot be, for a session of so many lights.
    pub(super) fn check(&self, lights: usize) -> Result<(), SessionError> {
        let wrong = |problem: String| Err(SessionError::Care(problem));
        for (name, frames) in [
            ("dark-frames", self.dark_frames),
            ("flat-frames", self.flat_frames),
            ("light-gain-frames", self.light_gain_frames),
        ] {
            if frames > 1000 {
                return wrong(format!("{name} is {frames}; give at most 1000"));
            }
        }
        if self.settle_tries > 1000 {
            return wrong(format!("settle-tries is {}; give at most 1000", self.settle_tries));
        }
        if !self.movement && (self.movement_every > 0 || self.when_moved != WhenMoved::Tell) {
            return wrong("movement-every and when-moved want movement = true".to_owned());
        }
        if let Some(multiple) = self.exposures.iter().find(|m| !(1e-4..=1e4).contains(*m)) {
            return wrong(format!("exposures holds {multiple}; give multiples of 0.0001 to 10000"));
        }
        if self.exposures.len() > 16 {
            return wrong(format!("exposures holds {} multiples; give at most 16", self.exposures.len()));
        }
        let factors = self.light_gains.iter().chain(&self.tone);
        if let Some(factor) = factors.copied().find(|factor| !(1e-4..=1e4).contains(factor)) {
            return wrong(format!("tone or light-gains holds {factor}; give factors of 0.0001 to 10000"));
        }
        if !self.light_gains.is_empty() && self.light_gains.len() != lights {
            return wrong(format!(
                "light-gains has {} factors for {lights} lights; give one a light",
                self.light_gains.len()
            ));
        }
        if !self.light_gains.is_empty() && self.light_gain_frames > 0 {
            return wrong(
                "light-gains and light-gain-frames both ask for factors; give one of the two".to_owned(),
            );
        }
        if !self.card_metres.iter().all(|v| v.is_finite()) {
            return wrong("card-metres has to be three finite metres".to_owned());
        }
        Ok(())
    }
}
