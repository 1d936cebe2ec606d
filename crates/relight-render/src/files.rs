//! Pictures in files: PNG for looking at, EXR for going on with the numbers.

use std::io::BufWriter;
use std::path::Path;

use exr::prelude::{
    AnyChannel, AnyChannels, Encoding, FlatSamples, Image as ExrImage, Layer, LayerAttributes, WritableImage,
};
use relight_scene::write_whole;

use crate::error::RenderError;
use crate::maps::{Map, Values};
use crate::picture::Picture;

/// Writes a map of a picture; the name's ending chooses between 8-bit PNG and 32-bit EXR ([`write_exr`]).
///
/// # Errors
/// [`RenderError::Extension`] for any other ending, [`RenderError::NoMap`] if the picture does not hold the map, and
/// [`RenderError::Io`] or [`RenderError::Scene`] if the file cannot be written.
pub fn write_picture(picture: &Picture, map: Map, path: &Path) -> Result<(), RenderError> {
    check_picture_name(path)?;
    if extension(path) == "exr" {
        write_exr(picture, map, path)
    } else {
        Ok(picture.image(map, None)?.write_png(path)?)
    }
}

/// Checks that a picture can be written under a name, before it is drawn.
///
/// # Errors
/// [`RenderError::Extension`] if the name does not end in `.png` or `.exr`.
pub fn check_picture_name(path: &Path) -> Result<(), RenderError> {
    match extension(path).as_str() {
        "png" | "exr" => Ok(()),
        _ => Err(RenderError::Extension(path.to_owned())),
    }
}

/// Writes a map as OpenEXR with 32-bit floats, losslessly compressed.
///
/// `final` and `reflectance` have channels R, G, B in linear light with Rec. 709 primaries, as compositing programs
/// expect: the field's sRGB is decoded. `visibility` and `opacity` have the single channel Y, in 0..1; `depth` has
/// the single channel Z, metres along the pixel's ray.
///
/// # Errors
/// [`RenderError::NoMap`] if the picture does not hold the map, [`RenderError::Io`] if the file cannot be written.
pub fn write_exr(picture: &Picture, map: Map, path: &Path) -> Result<(), RenderError> {
    let channel = |name: &str, values: Vec<f32>| AnyChannel::new(name, FlatSamples::F32(values));
    let channels: Vec<AnyChannel<FlatSamples>> = match picture.values(map)? {
        Values::Colour(colours) => ["R", "G", "B"]
            .iter()
            .enumerate()
            .map(|(c, name)| channel(name, colours.iter().map(|colour| linear(colour[c])).collect()))
            .collect(),
        Values::Share(numbers) => vec![channel("Y", numbers.to_vec())],
        Values::Distance(depth) => vec![channel("Z", depth.to_vec())],
    };
    let size = (picture.width as usize, picture.height as usize);
    let attributes = LayerAttributes { software_name: Some("relight".into()), ..LayerAttributes::default() };
    let layer = Layer::new(size, attributes, Encoding::SMALL_LOSSLESS, AnyChannels::sort(channels.into()));
    let image = ExrImage::from_layer(layer);
    let written = write_whole(path, |file| {
        let file = BufWriter::new(file);
        image.write().non_parallel().to_buffered(file).map_err(|error| match error {
            exr::error::Error::Io(error) => error,
            other => std::io::Error::other(other.to_string()),
        })
    });
    written.map_err(RenderError::io(path))
}

/// The ending of a file's name in lower case; empty without one.
pub(crate) fn extension(path: &Path) -> String {
    path.extension().map(|e| e.to_string_lossy().to_ascii_lowercase()).unwrap_or_default()
}

/// A temporary file in the folder of `path`, to be renamed to it when whole, and removed otherwise.
pub(crate) fn temporary_beside(path: &Path) -> Result<tempfile::NamedTempFile, RenderError> {
    let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let mut builder = tempfile::Builder::new();
    // Temporary files are their maker's alone unless told otherwise; results are as readable as any other file.
    #[cfg(unix)]
    builder.permissions(std::os::unix::fs::PermissionsExt::from_mode(0o666));
    builder.tempfile_in(folder).map_err(RenderError::io(path))
}

/// The linear value of an sRGB value (IEC 61966-2-1).
fn linear(srgb: f32) -> f32 {
    if srgb <= 0.04045 { srgb / 12.92 } else { ((srgb + 0.055) / 1.055).powf(2.4) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn srgb_becomes_linear() {
        assert_eq!(linear(0.0), 0.0);
        assert!((linear(1.0) - 1.0).abs() < 1e-6);
        assert!((linear(0.5) - 0.214_041_14).abs() < 1e-6);
        assert!((linear(0.04) - 0.04 / 12.92).abs() < 1e-8);
    }
}
