//! Pictures for the page: small enough for many of them, and how far a rendering is off.

use std::io::Write;
use std::path::{Path, PathBuf};

use relight_scene::Image;
use relight_train::run::write_whole;

use crate::error::BenchError;

/// Widest picture on the page, pixels.
const WIDEST: u32 = 480;
/// Quality of pictures that were reduced; those that were not lose nothing.
const QUALITY: u8 = 88;
/// The mean difference over the channels that has the brightest colour, of 255.
pub(crate) const BRIGHTEST_ERROR: f64 = 51.0;

/// The difference of two pictures of one size, averaged over the channels, in the colours of Inferno: black for none,
/// pale yellow for [`BRIGHTEST_ERROR`] and more.
pub(crate) fn error_map(picture: &Image, truth: &Image) -> Image {
    let pixels = picture.data.chunks_exact(3).zip(truth.data.chunks_exact(3));
    let data = pixels
        .flat_map(|(a, b)| {
            let sum: u32 = a.iter().zip(b).map(|(&a, &b)| u32::from(a.abs_diff(b))).sum();
            inferno(f64::from(sum) / 3.0 / BRIGHTEST_ERROR)
        })
        .collect();
    Image { width: truth.width, height: truth.height, data }
}

/// Inferno's colour for 0 (black) to 1 (pale yellow).
pub(crate) fn inferno(t: f64) -> [u8; 3] {
    let colour = colorous::INFERNO.eval_continuous(t.clamp(0.0, 1.0));
    [colour.r, colour.g, colour.b]
}

/// Writes a picture for the page into `folder`, reduced by a whole factor where it is wide, and tells its file's name.
pub(crate) fn keep(folder: &Path, name: &str, image: &Image) -> Result<PathBuf, BenchError> {
    let factor = image.width.div_ceil(WIDEST).max(1);
    let (file, bytes) = if factor == 1 {
        (format!("{name}.png"), image.png())
    } else {
        (format!("{name}.jpg"), image.reduced(factor).jpeg(QUALITY))
    };
    let path = folder.join(&file);
    let bytes = bytes.map_err(|e| BenchError::file(&path, e.to_string()))?;
    write_whole(&path, |out| out.write_all(&bytes))?;
    Ok(file.into())
}

#[cfg(test)]
mod tests {
    use relight_scene::read_image;

    use super::*;

    #[test]
    fn errors_are_black_where_there_are_none_and_saturate() {
        let truth = Image { width: 3, height: 1, data: vec![9, 9, 9, 0, 0, 0, 0, 0, 0] };
        let picture = Image { width: 3, height: 1, data: vec![9, 9, 9, 51, 51, 51, 255, 255, 255] };
        let map = error_map(&picture, &truth);
        assert_eq!(map.data[..3], inferno(0.0));
        assert_eq!(map.data[3..6], map.data[6..]);
        assert_eq!(map.data[6..], inferno(1.0));
        let half = Image { width: 1, height: 1, data: vec![51, 0, 0] };
        let black = Image { width: 1, height: 1, data: vec![0; 3] };
        assert_eq!(error_map(&half, &black).data, inferno(1.0 / 3.0), "the mean over the channels");
    }

    #[test]
    fn wide_pictures_are_reduced_and_others_lose_nothing() {
        let folder = tempfile::tempdir().unwrap();
        let small = Image { width: 480, height: 1, data: (0..1440).map(|i| i as u8).collect() };
        let name = keep(folder.path(), "small", &small).unwrap();
        assert_eq!(read_image(&folder.path().join(&name)).unwrap(), small);
        let wide = Image { width: 1440, height: 1080, data: vec![200; 3 * 1440 * 1080] };
        let name = keep(folder.path(), "wide", &wide).unwrap();
        assert_eq!(name, Path::new("wide.jpg"));
        let read = read_image(&folder.path().join(&name)).unwrap();
        assert_eq!((read.width, read.height), (480, 360));
        assert!(read.data.iter().all(|&b| b.abs_diff(200) < 3));
    }
}
