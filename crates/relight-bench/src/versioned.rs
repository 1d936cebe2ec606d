//! Files that outlive a process: JSON whose `format` says how to read it.

use std::path::Path;

use relight_scene::read_text;
use serde::Deserialize;
use serde::de::DeserializeOwned;

use crate::error::BenchError;

/// Reads the JSON file at `path`, of at most `limit` bytes and of the format `format`; `None` if there is none. `mend` says
/// what to do about one that cannot be read.
pub(crate) fn read<T: DeserializeOwned>(
    path: &Path,
    limit: u64,
    format: &str,
    mend: &str,
) -> Result<Option<T>, BenchError> {
    #[derive(Deserialize)]
    struct Version {
        format: String,
    }
    if !path.exists() {
        return Ok(None);
    }
    let text = read_text(path, limit)?;
    let broken = |e: &dyn std::fmt::Display| BenchError::file(path, format!("{e}; {mend}"));
    let found: Version = serde_json::from_str(&text).map_err(|e| broken(&e))?;
    if found.format != format {
        let problem =
            format!("format \"{}\" is unknown to this version, which reads \"{format}\"", found.format);
        return Err(broken(&problem));
    }
    serde_json::from_str(&text).map(Some).map_err(|e| broken(&e))
}
