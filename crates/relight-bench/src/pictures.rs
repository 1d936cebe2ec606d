//! Pictures for the page: small enough for many of them.

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
pub(crate) const BRIGHTEST_ERROR: u8 = 51;

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
