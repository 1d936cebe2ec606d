//! Signed statements of scores, which anyone can verify without the server.
//!
//! The signature (Ed25519) is over the canonical text of the receipt without its field `signature`: JSON with the names of each
//! object in the order of their code points and no white space, as Python's
//! `json.dumps(receipt, sort_keys=True, separators=(",", ":"), ensure_ascii=False)` writes it.

use std::io::Write;
use std::path::{Path, PathBuf};

use ed25519_dalek::{Signature, Signer, SigningKey, VerifyingKey};
use relight_scene::{SceneError, read_text, write_whole};
use serde::{Deserialize, Serialize};
use serde_json::Value;

use crate::disclosure::ToldScores;

/// The format of receipts.
const FORMAT: &str = "relight-receipt-1";

/// What was submitted, what it scored and who says so. It reads from JSON only if it holds nothing else, which nobody would have signed.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Receipt {
    /// `relight-receipt-1`.
    pub format: String,
    /// The submission's name.
    pub submission: String,
    /// The benchmark's name.
    pub benchmark: String,
    /// The method's name.
    pub method: String,
    /// SHA-256 of the zip, in hexadecimal digits.
    pub sha256: String,
    /// When it was taken in, RFC 3339.
    pub submitted_at: String,
    /// When it was scored, RFC 3339.
    pub scored_at: String,
    /// What scored it.
    pub evaluator: String,
    /// The scores, as they are told.
    pub scores: ToldScores,
    /// The server's key, in hexadecimal digits.
    pub public_key: String,
    /// The signature, in hexadecimal digits; empty before signing.
    #[serde(default)]
    pub signature: String,
}

/// Why a receipt is not to be believed.
#[derive(Debug, thiserror::Error)]
pub enum ReceiptError {
    /// It is of another format.
    #[error("the receipt's format is {0:?}, and only {FORMAT:?} is known")]
    Format(String),
    /// It was signed with another key, or says so.
    #[error("the receipt is signed with the key {0}, not with the expected one")]
    OtherKey(String),
    /// Key or signature are no such things.
    #[error("the receipt's {0} does not read")]
    Malformed(&'static str),
    /// The signature does not fit.
    #[error("the signature does not fit: the receipt was changed after it was signed")]
    Forged,
}

/// A server's key file cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum KeyError {
    /// It cannot be read.
    #[error(transparent)]
    Read(#[from] SceneError),
    /// It is damaged.
    #[error(
        "{0}: is no relight receipt key. Restore it from a backup; without it, older receipts still verify with their key"
    )]
    Damaged(PathBuf),
    /// It cannot be written, or there is no randomness to make it of.
    #[error("{path}: cannot be made: {problem}")]
    Make {
        /// The file.
        path: PathBuf,
        /// Why.
        problem: String,
    },
}

/// What a key file begins with.
const KEY_HEADER: &str = "relight-receipt-key-1";

/// The key that signs a server's receipts.
#[derive(Clone, Debug)]
pub struct ReceiptKey(SigningKey);

impl ReceiptKey {
    /// Reads the key file, or makes a new key and its file.
    ///
    /// # Errors
    /// [`KeyError`].
    pub fn open(path: &Path) -> Result<ReceiptKey, KeyError> {
        if path.exists() {
            let text = read_text(path, 1000)?;
            let seed = text.strip_prefix(KEY_HEADER).and_then(|rest| from_hex(rest.trim()));
            return seed
                .map(|seed| ReceiptKey(SigningKey::from_bytes(&seed)))
                .ok_or_else(|| KeyError::Damaged(path.to_owned()));
        }
        let make = |problem: String| KeyError::Make { path: path.to_owned(), problem };
        let mut seed = [0; 32];
        getrandom::fill(&mut seed).map_err(|error| make(error.to_string()))?;
        write_whole(path, |file| {
            keep_private(file)?;
            writeln!(file, "{KEY_HEADER} {}", to_hex(&seed))
        })
        .map_err(|error| make(error.to_string()))?;
        Ok(ReceiptKey(SigningKey::from_bytes(&seed)))
    }

    /// The key that verifies, in hexadecimal digits.
    pub fn public(&self) -> String {
        to_hex(self.0.verifying_key().as_bytes())
    }

    /// Signs a receipt: sets its format, key and signature.
    pub fn sign(&self, mut receipt: Receipt) -> Receipt {
        receipt.format = FORMAT.to_owned();
        receipt.public_key = self.public();
        receipt.signature = to_hex(&self.0.sign(signed_text(&receipt).as_bytes()).to_bytes());
        receipt
    }
}

impl Receipt {
    /// Verifies a receipt against a server's public key, as its `/api/v1/receipt-key` tells it.
    ///
    /// # Errors
    /// Why it is not to be believed.
    pub fn verify(&self, public_key: &str) -> Result<(), ReceiptError> {
        if self.format != FORMAT {
            return Err(ReceiptError::Format(self.format.clone()));
        }
        if !self.public_key.eq_ignore_ascii_case(public_key.trim()) {
            return Err(ReceiptError::OtherKey(self.public_key.clone()));
        }
        let key = from_hex(&self.public_key).and_then(|bytes| VerifyingKey::from_bytes(&bytes).ok());
        let key = key.ok_or(ReceiptError::Malformed("public_key"))?;
        let signature = from_hex(&self.signature).map(|bytes| Signature::from_bytes(&bytes));
        let signature = signature.ok_or(ReceiptError::Malformed("signature"))?;
        key.verify_strict(signed_text(self).as_bytes(), &signature).map_err(|_| ReceiptError::Forged)
    }
}

/// What the signature is over.
fn signed_text(receipt: &Receipt) -> String {
    let mut value = serde_json::to_value(receipt).unwrap_or(Value::Null);
    if let Value::Object(fields) = &mut value {
        fields.remove("signature");
    }
    let mut text = String::new();
    write_canonical(&value, &mut text);
    text
}

fn write_canonical(value: &Value, text: &mut String) {
    let mut list = |open: char, items: &mut dyn Iterator<Item = (Option<&String>, &Value)>, close: char| {
        text.push(open);
        for (i, (name, item)) in items.enumerate() {
            if i > 0 {
                text.push(',');
            }
            if let Some(name) = name {
                text.push_str(&Value::from(name.as_str()).to_string());
                text.push(':');
            }
            write_canonical(item, text);
        }
        text.push(close);
    };
    match value {
        Value::Array(items) => list('[', &mut items.iter().map(|item| (None, item)), ']'),
        Value::Object(fields) => {
            // In code points' order, whichever map other crates make serde_json use.
            let mut fields: Vec<_> = fields.iter().collect();
            fields.sort_by_key(|(name, _)| *name);
            list('{', &mut fields.into_iter().map(|(name, item)| (Some(name), item)), '}');
        }
        _ => text.push_str(&value.to_string()),
    }
}

/// Hexadecimal digits of bytes.
pub(crate) fn to_hex(bytes: &[u8]) -> String {
    bytes.iter().map(|byte| format!("{byte:02x}")).collect()
}

/// Exactly `N` bytes of hexadecimal digits.
pub(crate) fn from_hex<const N: usize>(text: &str) -> Option<[u8; N]> {
    if text.len() != 2 * N || !text.bytes().all(|byte| byte.is_ascii_hexdigit()) {
        return None;
    }
    let mut bytes = [0; N];
    for (i, byte) in bytes.iter_mut().enumerate() {
        *byte = u8::from_str_radix(text.get(2 * i..2 * i + 2)?, 16).ok()?;
    }
    Some(bytes)
}

/// Nobody but the server's user may read the key.
#[cfg(unix)]
fn keep_private(file: &std::fs::File) -> std::io::Result<()> {
    use std::os::unix::fs::PermissionsExt;
    file.set_permissions(std::fs::Permissions::from_mode(0o600))
}

#[cfg(not(unix))]
fn keep_private(_: &std::fs::File) -> std::io::Result<()> {
    Ok(())
}

#[cfg(test)]
mod tests;
