use relight_scene::Split;

use super::*;
use crate::disclosure::{ToldMean, ToldScene};

/// A receipt that the key of 32 bytes 7 signs.
fn receipt() -> Receipt {
    let mean = |split, psnr| ToldMean { split, images: 3, psnr, ssim: 0.612 };
    ReceiptKey(SigningKey::from_bytes(&[7; 32])).sign(Receipt {
        format: String::new(),
        submission: "0123456789abcdef".into(),
        benchmark: "rene".into(),
        method: "Größe \"5\"".into(),
        sha256: "ab".repeat(32),
        submitted_at: "2025-11-24T16:00:00Z".into(),
        scored_at: "2025-11-24T16:01:00Z".into(),
        evaluator: "relight 0.1.0, scores 1".into(),
        scores: ToldScores {
            means: vec![mean(Split::Easy, Some(25.0)), mean(Split::Hard, None)],
            scenes: vec![ToldScene { scene: "cube".into(), means: vec![mean(Split::Easy, Some(25.79))] }],
            images: Vec::new(),
        },
        public_key: String::new(),
        signature: String::new(),
    })
}

#[test]
fn receipts_verify_with_their_key_and_only_unchanged() {
    let receipt = receipt();
    let key = receipt.public_key.clone();
    // Also after they were written and read.
    let text = serde_json::to_string(&receipt).unwrap();
    let read: Receipt = serde_json::from_str(&text).unwrap();
    read.verify(&key).unwrap();
    let other = to_hex(SigningKey::from_bytes(&[8; 32]).verifying_key().as_bytes());
    assert!(matches!(read.verify(&other), Err(ReceiptError::OtherKey(_))));
    for (from, to) in
        [("25.79", "26.79"), ("cube", "cubе"), ("abab", "abac"), ("null", "99.0"), ("rene", "reno")]
    {
        let changed: Receipt = serde_json::from_str(&text.replacen(from, to, 1)).unwrap();
        assert!(matches!(changed.verify(&key), Err(ReceiptError::Forged)), "{from}");
    }
    // Someone else's key in the receipt, with a signature by it: it is not the server's.
    let mut forged = receipt.clone();
    forged.public_key.clone_from(&other);
    assert!(forged.verify(&key).is_err() && forged.verify(&other).is_err());
}

/// `tools/golden_receipts.py` made the signature, by the Python package `cryptography` over the text of `json.dumps`.
#[test]
fn signatures_are_those_that_python_makes() {
    let golden = include_str!("golden.txt");
    let receipt = receipt();
    assert_eq!(golden.lines().collect::<Vec<_>>(), [receipt.public_key, receipt.signature]);
}

#[test]
fn keys_are_kept_and_are_nobody_elses() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("receipt-key");
    let made = ReceiptKey::open(&path).unwrap();
    assert_eq!(ReceiptKey::open(&path).unwrap().public(), made.public());
    #[cfg(unix)]
    {
        use std::os::unix::fs::PermissionsExt;
        assert_eq!(std::fs::metadata(&path).unwrap().permissions().mode() & 0o777, 0o600);
    }
    for damaged in ["", "relight-receipt-key-2 00", "relight-receipt-key-1 xyz"] {
        std::fs::write(&path, damaged).unwrap();
        assert!(matches!(ReceiptKey::open(&path), Err(KeyError::Damaged(_))), "{damaged}");
    }
}
