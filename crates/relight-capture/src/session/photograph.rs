//! One photograph: frames that arrive whole, camera and lamp at rest, a bracket of exposures merged, light corrected.

use relight_scene::Image;

use super::stillness::compare;
use super::{Care, Rig, SessionError, Shots};
use crate::camera::{CameraError, Correction, Exposure, Frame, LinearImage, merge};

/// Tries for a frame that does not arrive whole.
const TRIES: u32 = 5;

/// What came of a view under a light.
pub(super) struct Photograph {
    /// As it goes into the scene.
    pub image: Image,
    /// Its light, if it was worked on: before tone and clipping.
    pub light: Option<LinearImage>,
}

/// How photographs of a session are taken.
pub(super) struct Photographer<'a> {
    pub shots: &'a Shots,
    pub care: &'a Care,
    pub correction: Option<Correction>,
    /// A factor a light; empty: none.
    pub gains: Vec<f32>,
}

impl Photographer<'_> {
    /// Takes a photograph of the view under the light where the rig stands.
    pub(super) fn take(
        &self,
        rig: &mut dyn Rig,
        view: usize,
        light: usize,
    ) -> Result<Photograph, SessionError> {
        let failed = |error: CameraError| SessionError::Rig { view, light, fault: error.into() };
        let development = &self.shots.development;
        let frame = self.settled(rig, view, light)?;
        if !self.care.works_on_light() {
            return Ok(Photograph { image: frame.develop(development).map_err(failed)?, light: None });
        }
        let mut exposures = Vec::new();
        let mut at_rest = Some(frame);
        let own = [1.0];
        let multiples = if self.care.exposures.is_empty() { &own[..] } else { &self.care.exposures };
        for &multiple in multiples {
            // That for which camera and lamp were waited is one of them.
            let frame = match at_rest.take_if(|_| multiple == 1.0) {
                Some(frame) => frame,
                None => {
                    rig.expose(multiple).map_err(failed)?;
                    self.whole(rig, view, light)?
                }
            };
            let mut signals = frame.signals(development).map_err(failed)?;
            if let Some(correction) = &self.correction {
                correction.apply(&mut signals, multiple).map_err(failed)?;
            }
            exposures.push(Exposure { multiple, signals });
        }
        rig.expose(1.0).map_err(failed)?;
        let mut colours = merge(&exposures).map_err(failed)?.colours(development);
        if let Some(gain) = self.gains.get(light) {
            colours.data.iter_mut().for_each(|value| *value *= gain);
        }
        let image = colours.encode(self.care.tone.unwrap_or(1.0));
        Ok(Photograph { image, light: Some(colours) })
    }

    /// A frame that agrees with the one before it, as far as that is asked for.
    fn settled(&self, rig: &mut dyn Rig, view: usize, light: usize) -> Result<Frame, SessionError> {
        let mut frame = self.whole(rig, view, light)?;
        let failed = |error: CameraError| SessionError::Rig { view, light, fault: error.into() };
        let develop = |frame: &Frame| frame.clone().develop(&self.shots.development).map_err(failed);
        let tries = self.care.settle_tries;
        for attempt in 1..=tries {
            let next = self.whole(rig, view, light)?;
            let change = compare(&develop(&frame)?, &develop(&next)?);
            frame = next;
            if !change.moved() && !change.flickered() {
                break;
            }
            if attempt == tries {
                return Err(SessionError::Unsettled { view, light, tries, change });
            }
            tracing::info!("view {view} under light {light}: not at rest yet: {change}");
        }
        Ok(frame)
    }

    /// A frame of the right size that arrived whole.
    pub(super) fn whole(&self, rig: &mut dyn Rig, view: usize, light: usize) -> Result<Frame, SessionError> {
        let mut tries = 1;
        loop {
            let frame = rig.shoot().and_then(|frame| frame.whole().map(|()| frame));
            match frame {
                Ok(frame) => {
                    let lens = &self.shots.intrinsics;
                    let size = frame.size();
                    if size != (lens.width, lens.height) {
                        let fault = CameraError::Failed {
                            problem: format!(
                                "a frame of {}x{} came for a lens of {}x{}",
                                size.0, size.1, lens.width, lens.height
                            ),
                            mend: "Set the camera to the size of its calibration.",
                        };
                        return Err(SessionError::Rig { view, light, fault: fault.into() });
                    }
                    return Ok(frame);
                }
                Err(last @ CameraError::Incomplete(_)) if tries == TRIES => {
                    return Err(SessionError::Tries { view, light, tries, last });
                }
                Err(CameraError::Incomplete(why)) => {
                    tracing::warn!("view {view} under light {light}: {why}: shot again");
                    tries += 1;
                }
                Err(error) => return Err(SessionError::Rig { view, light, fault: error.into() }),
            }
        }
    }
}
