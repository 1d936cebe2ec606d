//! What an engine has learnt of where to place samples, kept beside the weights: see
//! [`Engine::guide`](relight_field::engine::Engine::guide).

use std::collections::BTreeMap;
use std::io::Write;
use std::path::Path;

use relight_field::tensor_file;
use relight_scene::read_bytes;
use safetensors::tensor::TensorView;
use safetensors::{Dtype, SafeTensors};

use crate::TrainError;
use crate::run::write_whole;

/// Format and version of the file, under `format` in its metadata.
const FORMAT: &str = "relight-guide-2";
/// The one before: 255, which marks what the CPU engine keeps empty, was its largest density.
const FORMAT_BEFORE: &str = "relight-guide-1";
/// A guide's longest length, bytes.
const LONGEST: u64 = 1 << 28;
/// The one array of the file.
const GUIDE: &str = "guide";
/// Under it the metadata tell whether the field was surveyed; files of before do not.
const SURVEYED: &str = "surveyed";

/// A guide, as it is kept.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Guide {
    /// What [`Engine::guide`](relight_field::engine::Engine::guide) gave.
    pub learnt: Vec<u8>,
    /// Whether the engine had surveyed the field then: see [`Engine::survey`](relight_field::engine::Engine::survey).
    pub surveyed: bool,
}

/// Writes a guide; nothing for an empty one.
///
/// # Errors
/// [`TrainError::Io`] or [`TrainError::Run`] if it cannot be written.
pub fn save(guide: &Guide, path: &Path) -> Result<(), TrainError> {
    let Guide { learnt, surveyed } = guide;
    if learnt.is_empty() {
        return Ok(());
    }
    let broken = |e: safetensors::SafeTensorError| TrainError::run(path, e.to_string());
    let array = TensorView::new(Dtype::U8, vec![learnt.len()], learnt).map_err(broken)?;
    let metadata = BTreeMap::from([("format", FORMAT.to_owned()), (SURVEYED, surveyed.to_string())]);
    let bytes = tensor_file::serialize([(GUIDE.to_owned(), array)], &metadata).map_err(broken)?;
    write_whole(path, |file| file.write_all(&bytes))
}

/// Reads the guide at `path`; `None` if there is none.
///
/// # Errors
/// [`TrainError::Run`] if it is no guide; [`TrainError::Scene`] if it cannot be read.
pub fn load(path: &Path) -> Result<Option<Guide>, TrainError> {
    if !path.try_exists().map_err(TrainError::io(path))? {
        return Ok(None);
    }
    let bytes = read_bytes(path, LONGEST)?;
    let broken = |problem: String| {
        let mend = "delete the file, and what it tells is looked for in the weights, or resume the training, which writes it anew";
        TrainError::run(path, format!("{problem}: {mend}"))
    };
    let (_, metadata) = SafeTensors::read_metadata(&bytes).map_err(|e| broken(e.to_string()))?;
    let told = |key: &str| metadata.metadata().as_ref().and_then(|m| m.get(key)).map_or("", String::as_str);
    let format = told("format");
    if format != FORMAT && format != FORMAT_BEFORE {
        return Err(broken(format!("format \"{format}\" is unknown, {FORMAT} was expected")));
    }
    let file = SafeTensors::deserialize(&bytes).map_err(|e| broken(e.to_string()))?;
    let array = file.tensor(GUIDE).map_err(|e| broken(e.to_string()))?;
    let mut learnt = array.data().to_vec();
    if format == FORMAT_BEFORE {
        learnt.iter_mut().for_each(|byte| *byte = (*byte).min(254));
    }
    Ok(Some(Guide { learnt, surveyed: told(SURVEYED) == "true" }))
}

#[cfg(test)]
mod tests {
    use std::fs;

    use super::*;

    #[test]
    fn guides_come_back_and_damage_is_found() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("guide.safetensors");
        let guide = |learnt: &[u8], surveyed| Guide { learnt: learnt.to_vec(), surveyed };
        save(&guide(&[], true), &path).unwrap();
        assert_eq!(load(&path).unwrap(), None);
        for surveyed in [false, true] {
            save(&guide(&[1, 2, 3], surveyed), &path).unwrap();
            assert_eq!(load(&path).unwrap(), Some(guide(&[1, 2, 3], surveyed)));
        }
        let bytes = fs::read(&path).unwrap();
        // One of before, which tells of no survey.
        let without = String::from_utf8(bytes.clone()).unwrap().replace("surveyed", "anything");
        fs::write(&path, without).unwrap();
        assert_eq!(load(&path).unwrap(), Some(guide(&[1, 2, 3], false)));
        save(&guide(&[0, 254, 255], true), &path).unwrap();
        assert_eq!(load(&path).unwrap(), Some(guide(&[0, 254, 255], true)));
        let mut before = fs::read(&path).unwrap();
        let at = before.windows(7).position(|window| window == b"guide-2").unwrap();
        before[at + 6] = b'1';
        fs::write(&path, before).unwrap();
        assert_eq!(load(&path).unwrap(), Some(guide(&[0, 254, 254], true)));
        fs::write(&path, &bytes[..bytes.len() - 1]).unwrap();
        assert!(load(&path).unwrap_err().to_string().contains("guide.safetensors"));
        fs::write(&path, String::from_utf8_lossy(&bytes).replace("guide-2", "guide-9")).unwrap();
        assert!(load(&path).unwrap_err().to_string().contains("guide-9"));
    }
}
