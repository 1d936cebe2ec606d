//! How bright the lamp was in each of its places: factors that even it out, from photographs of a grey card.

use std::io::Write;
use std::path::Path;

use relight_scene::{Intrinsics, Pose, read_text, write_whole};
use serde::{Deserialize, Serialize};
use serde_json::Value;

use super::photograph::Photographer;
use super::{CAMERA, Rig, RigFault, STATE, SessionError, Subject, Target};
use crate::camera::LinearImage;

/// The factors, in the folder [`STATE`].
const FILE: &str = "gains.json";
const FORMAT: &str = "relight-light-gains-1";
const LONGEST: u64 = 1 << 20;
/// Side of the square in the card's middle that is looked at, metres.
const PATCH: f64 = 0.02;
/// Light from which on a value may be one of a full sensor.
const FULL: f32 = 0.98;

#[derive(PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct File {
    format: String,
    /// How many photographs of the card were taken a light.
    frames: u32,
    /// Where the card lay, world, metres.
    card: [f64; 3],
    /// How the camera was set, as the session's subject says it.
    camera: Value,
    /// By light.
    gains: Vec<f32>,
}

/// The factors of the session's lights: those that its settings give, those of its file, or else those of the card, which is
/// then photographed. Empty: none.
pub(super) fn light_gains(
    rig: &mut dyn Rig,
    photographer: &Photographer,
    subject: &Subject,
    out: &Path,
) -> Result<Vec<f32>, SessionError> {
    let care = photographer.care;
    if care.light_gain_frames == 0 {
        return Ok(care.light_gains.clone());
    }
    let path = out.join(STATE).join(FILE);
    let file = |gains| File {
        format: FORMAT.to_owned(),
        frames: care.light_gain_frames,
        card: care.card_metres,
        camera: subject.get(CAMERA).cloned().unwrap_or_default(),
        gains,
    };
    if !path.try_exists().map_err(SessionError::io(&path))? {
        let file = file(photographed(rig, photographer)?);
        let json = serde_json::to_vec_pretty(&file).map_err(|error| SessionError::io(&path)(error.into()))?;
        write_whole(&path, |out| out.write_all(&json)).map_err(SessionError::io(&path))?;
    }
    let other = |problem: &str| SessionError::Other {
        path: path.clone(),
        problem: format!("{problem}. Remove the file, and the card is photographed again."),
    };
    let read: File = serde_json::from_str(&read_text(&path, LONGEST)?)
        .map_err(|error| other(&format!("is no file of {FORMAT}: {error}")))?;
    if read.format != FORMAT {
        return Err(other(&format!("is of format {}, and only {FORMAT} is known", read.format)));
    }
    if read != file(read.gains.clone()) || read.gains.len() != photographer.shots.lights.len() {
        return Err(other("is of another card, camera or number of lights than the session has"));
    }
    if !read.gains.iter().all(|gain| gain.is_finite() && *gain > 0.0) {
        return Err(other("holds a factor that is not above zero"));
    }
    Ok(read.gains)
}

/// Photographs the card from the first view under every light, and tells the factors by light: the mean of how bright the lamp
/// was in all places, over how bright it was in each. What distance and angle explain counts for nothing.
fn photographed(rig: &mut dyn Rig, photographer: &Photographer) -> Result<Vec<f32>, SessionError> {
    let (shots, care) = (photographer.shots, photographer.care);
    let shown = |fault: RigFault| SessionError::Reference { target: "grey card", fault };
    let unusable = |light: usize, problem: &'static str| SessionError::Card { light, problem };
    let view = shots.view_order.first().copied().unwrap_or_default();
    let patch = shots.cameras.get(view).and_then(|camera| patch(&shots.intrinsics, camera, care.card_metres));
    rig.show(Target::Card(care.card_metres)).map_err(shown)?;
    rig.view(view).map_err(shown)?;
    let mut bright = vec![1.0; shots.lights.len()];
    for &light in &shots.light_order {
        let patch = patch.ok_or(unusable(light, "the first view does not show it"))?;
        let explained = irradiance(&shots.lights[light], care.card_metres)
            .ok_or(unusable(light, "the light stands below it"))?;
        rig.light(light).map_err(shown)?;
        let mut sum = 0.0;
        for _ in 0..care.light_gain_frames {
            let photograph = photographer.take(rig, view, light)?.light;
            let mean = photograph.as_ref().and_then(|photograph| mean(photograph, patch));
            sum += mean.ok_or(unusable(light, "it is black or full in the photograph"))?;
        }
        bright[light] = sum / f64::from(care.light_gain_frames) / explained;
    }
    rig.show(Target::Scene).map_err(shown)?;
    let all = bright.iter().sum::<f64>() / bright.len() as f64;
    Ok(bright.iter().map(|bright| (all / bright) as f32).collect())
}

/// What a lamp of unit intensity throws on a card that lies flat; none from below.
fn irradiance(light: &Pose, card: [f64; 3]) -> Option<f64> {
    let from = light.position();
    let [x, y, z] = std::array::from_fn(|i| from[i] - card[i]);
    Some(z / (x * x + y * y + z * z).powf(1.5)).filter(|irradiance| *irradiance > 0.0)
}

/// Left, top, width and height of where a camera sees the middle of a card, pixels; none if it does not see all of that.
fn patch(lens: &Intrinsics, camera: &Pose, card: [f64; 3]) -> Option<[u32; 4]> {
    let (mut low, mut high) = ([f64::INFINITY; 2], [f64::NEG_INFINITY; 2]);
    for [x, y] in [[-1.0, -1.0], [-1.0, 1.0], [1.0, -1.0], [1.0, 1.0]] {
        let corner = [card[0] + x * PATCH / 2.0, card[1] + y * PATCH / 2.0, card[2]];
        let at = lens.project(camera.inverse_transform(corner))?;
        low = std::array::from_fn(|i| low[i].min(at[i].round()));
        high = std::array::from_fn(|i| high[i].max(at[i].round()));
    }
    let is_inside =
        low.iter().all(|&v| v >= 0.0) && high[0] < f64::from(lens.width) && high[1] < f64::from(lens.height);
    let side = |i: usize| (high[i] - low[i]) as u32 + 1;
    is_inside.then(|| [low[0] as u32, low[1] as u32, side(0), side(1)])
}

/// The mean of a patch that lies in the photograph and is neither black nor full.
fn mean(photograph: &LinearImage, [left, top, width, height]: [u32; 4]) -> Option<f64> {
    let mut sum = 0.0;
    for y in top..top + height {
        let begin = 3 * (y as usize * photograph.width as usize + left as usize);
        let row = photograph.data.get(begin..begin + 3 * width as usize)?;
        if row.iter().any(|&value| value >= FULL) {
            return None;
        }
        sum += row.iter().map(|&value| f64::from(value)).sum::<f64>();
    }
    Some(sum / (3.0 * f64::from(width) * f64::from(height))).filter(|mean| *mean > 0.0)
}
