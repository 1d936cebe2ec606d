//! PSNR in files: a number, or null where it is infinite, which JSON cannot say.

use serde::{Deserialize, Deserializer, Serialize, Serializer};

pub(super) fn serialize<S: Serializer>(psnr: &f64, serializer: S) -> Result<S::Ok, S::Error> {
    Some(*psnr).filter(|psnr| psnr.is_finite()).serialize(serializer)
}

pub(super) fn deserialize<'de, D: Deserializer<'de>>(deserializer: D) -> Result<f64, D::Error> {
    Ok(Option::deserialize(deserializer)?.unwrap_or(f64::INFINITY))
}
