//! The light of a photograph beyond 8 bits, as OpenEXR.

use std::fs;
use std::io::BufWriter;
use std::path::{Path, PathBuf};

use exr::image::write::WritableImage;
use exr::prelude::{AnyChannel, AnyChannels, Encoding, FlatSamples, Image, Layer, LayerAttributes};
use relight_scene::write_whole;

use super::{STATE, SessionError};
use crate::camera::LinearImage;

/// Where the light of a view under a light lies. Hidden as all of the session's own: readers of the scene pass it by.
pub(super) fn path(out: &Path, view: usize, light: usize) -> PathBuf {
    out.join(STATE).join("hdr").join(format!("lset{light:03}")).join(format!("{view:05}.exr"))
}

/// Writes light as channels R, G and B of 32-bit floats with Rec. 709 primaries, losslessly compressed.
pub(super) fn write(path: &Path, light: &LinearImage) -> Result<(), SessionError> {
    if let Some(folder) = path.parent() {
        fs::create_dir_all(folder).map_err(SessionError::io(folder))?;
    }
    let of = |c: usize| FlatSamples::F32(light.data.iter().skip(c).step_by(3).copied().collect());
    let channels = [("R", 0), ("G", 1), ("B", 2)].map(|(name, c)| AnyChannel::new(name, of(c)));
    let size = (light.width as usize, light.height as usize);
    let attributes = LayerAttributes { software_name: Some("relight".into()), ..LayerAttributes::default() };
    let channels = AnyChannels::sort(channels.into_iter().collect());
    let image = Image::from_layer(Layer::new(size, attributes, Encoding::SMALL_LOSSLESS, channels));
    let written = write_whole(path, |file| {
        image.write().non_parallel().to_buffered(BufWriter::new(file)).map_err(|error| match error {
            exr::error::Error::Io(error) => error,
            other => std::io::Error::other(other.to_string()),
        })
    });
    written.map_err(SessionError::io(path))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn light_is_read_back() {
        let folder = tempfile::tempdir().unwrap();
        let path = path(folder.path(), 3, 1);
        let light =
            LinearImage { width: 3, height: 2, data: (0..18).map(|i| 0.3 * i as f32 - 0.1).collect() };
        write(&path, &light).unwrap();
        let read = exr::prelude::read_first_flat_layer_from_file(&path).unwrap();
        let red: Vec<f32> =
            read.layer_data.channel_data.list.last().unwrap().sample_data.values_as_f32().collect();
        assert_eq!(red, [0, 3, 6, 9, 12, 15].map(|i| light.data[i]));
        assert_eq!((read.layer_data.size.0, read.layer_data.size.1), (3, 2));
    }
}
