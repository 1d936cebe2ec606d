//! Secrets that programs and browsers show: 256 random bits.
//!
//! They are stored as their SHA-256, not through a slow password hash: nobody can guess 256 random bits, however quick each
//! guess is, whereas a slow hash at every request would let anybody keep the server busy with wrong ones.

use sha2::{Digest, Sha256};
use subtle::ConstantTimeEq;

use super::AccountError;
use crate::receipt::{from_hex, to_hex};

/// A secret. Not printable, not comparable but through [`Secret::matches`].
pub(super) struct Secret([u8; 32]);

impl Secret {
    pub(super) fn new() -> Result<Secret, AccountError> {
        let mut bytes = [0; 32];
        getrandom::fill(&mut bytes).map_err(|error| AccountError::Secret(error.to_string()))?;
        Ok(Secret(bytes))
    }

    pub(super) fn read(text: &str) -> Option<Secret> {
        from_hex(text).map(Secret)
    }

    pub(super) fn to_text(&self) -> String {
        to_hex(&self.0)
    }

    pub(super) fn hash(&self) -> [u8; 32] {
        Sha256::digest(self.0).into()
    }

    /// Whether it is the one of that hash, in a time that does not tell how much fits.
    pub(super) fn matches(&self, hash: &[u8]) -> bool {
        self.hash().ct_eq(hash).into()
    }
}
