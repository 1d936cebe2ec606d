//! ReNe's `camera.yml`.

use std::path::Path;

use serde_json::Value;

use crate::camera::Intrinsics;
use crate::error::{FaultKind, SceneError};
use crate::files;

const LONGEST: u64 = 1 << 16;
/// More numbers than any key of the file has.
const MOST_NUMBERS: usize = 64;

/// Reads a `camera.yml`: key `intrinsics` with `camera_matrix` (3x3), `dist_coeffs` (OpenCV's order, any of OpenCV's
/// lengths) and `image_size` (`[width, height]`). Lists may be nested, as NumPy's column vectors are; the three keys may
/// stand at the top; numbers may be text.
pub(crate) fn read(path: &Path) -> Result<Intrinsics, SceneError> {
    parse(&files::read_text(path, LONGEST)?).map_err(|problem| {
        let mend = "camera.yml holds, under the key intrinsics, camera_matrix (3x3: fx 0 cx, 0 fy cy, 0 0 1), \
                    dist_coeffs (OpenCV's order) and image_size ([width, height]).";
        SceneError::fault(FaultKind::Lens, path, problem, mend)
    })
}

/// The lens in a text.
pub(crate) fn parse(text: &str) -> Result<Intrinsics, String> {
    let file: Value = serde_saphyr::from_str(text).map_err(|error| {
        let message = error.to_string();
        format!("is not YAML: {}", message.lines().next().unwrap_or_default())
    })?;
    let intrinsics = file.get("intrinsics").unwrap_or(&file);
    let list = |key: &str| {
        let value = intrinsics.get(key).ok_or_else(|| format!("has no key {key:?}"))?;
        let mut numbers = Vec::new();
        flatten(value, &mut numbers).map_err(|problem| format!("{key}: {problem}"))?;
        Ok::<_, String>(numbers)
    };
    let matrix = list("camera_matrix")?;
    let [fx, skew, cx, below, fy, cy, last @ ..] = matrix.as_slice() else {
        return Err(format!("camera_matrix has {} numbers instead of 9", matrix.len()));
    };
    if last != [0.0, 0.0, 1.0] || *skew != 0.0 || *below != 0.0 {
        return Err("camera_matrix is not of the form fx 0 cx, 0 fy cy, 0 0 1".to_owned());
    }
    let size = list("image_size")?;
    let pixels =
        |number: f64| (number >= 1.0 && number.fract() == 0.0 && number < 1e9).then_some(number as u32);
    let [Some(width), Some(height)] = size.iter().map(|&n| pixels(n)).collect::<Vec<_>>()[..] else {
        return Err(format!("image_size {size:?} is not a width and a height in pixels"));
    };
    let distortion = if intrinsics.get("dist_coeffs").is_some_and(|value| !value.is_null()) {
        list("dist_coeffs")?
    } else {
        Vec::new()
    };
    let lens = Intrinsics { width, height, fx: *fx, fy: *fy, cx: *cx, cy: *cy, distortion };
    lens.fault().map_or(Ok(lens), Err)
}

/// All numbers of nested lists, in order.
fn flatten(value: &Value, numbers: &mut Vec<f64>) -> Result<(), String> {
    let number = match value {
        Value::Array(items) => return items.iter().try_for_each(|item| flatten(item, numbers)),
        Value::Number(number) => number.as_f64(),
        Value::String(text) => text.trim().parse().ok(),
        _ => None,
    };
    let number = number.filter(|n| n.is_finite()).ok_or("holds something that is not a finite number")?;
    if numbers.len() == MOST_NUMBERS {
        return Err(format!("holds more than {MOST_NUMBERS} numbers"));
    }
    numbers.push(number);
    Ok(())
}
