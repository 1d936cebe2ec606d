//! Tensors and a map of strings as the bytes of a safetensors file, the same bytes each time.
//!
//! The safetensors crate takes the map as a `HashMap` and writes it in that map's random order. Here it is sorted, so
//! that files of equal content are equal, and can be compared and cached by their bytes.

use std::collections::BTreeMap;

use safetensors::tensor::Metadata;
use safetensors::{SafeTensorError, SafeTensors, View};
use serde::Serialize;

/// Bytes of the header's length, and the multiple that the header is padded to: readers map tensors where they lie.
const WORD: usize = 8;

#[derive(Serialize)]
struct Header<'a> {
    #[serde(rename = "__metadata__")]
    strings: &'a BTreeMap<&'a str, String>,
    #[serde(flatten)]
    tensors: &'a Metadata,
}

/// The bytes of a file with the named `tensors` and, as its metadata, `strings`.
///
/// # Errors
/// As [`safetensors::serialize`].
pub fn serialize<V: View>(
    tensors: impl IntoIterator<Item = (String, V)>,
    strings: &BTreeMap<&str, String>,
) -> Result<Vec<u8>, SafeTensorError> {
    let mut file = safetensors::serialize(tensors, None)?;
    let (length, tensors) = SafeTensors::read_metadata(&file)?;
    let mut header = serde_json::to_vec(&Header { strings, tensors: &tensors })?;
    header.resize(header.len().next_multiple_of(WORD), b' ');
    let start = (header.len() as u64).to_le_bytes().into_iter().chain(header);
    file.splice(..WORD + length, start);
    Ok(file)
}
