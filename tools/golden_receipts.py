"""Makes crates/relight-server/src/receipt/golden.txt: public key and signature of a receipt, by the package cryptography.

    pip install cryptography
    python tools/golden_receipts.py > crates/relight-server/src/receipt/golden.txt
"""

import json

from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey
from cryptography.hazmat.primitives.serialization import Encoding, PublicFormat

key = Ed25519PrivateKey.from_private_bytes(bytes([7] * 32))
public = key.public_key().public_bytes(Encoding.Raw, PublicFormat.Raw).hex()


def mean(split, psnr):
    return {"split": split, "images": 3, "psnr": psnr, "ssim": 0.612}


receipt = {
    "format": "relight-receipt-1",
    "submission": "0123456789abcdef",
    "benchmark": "rene",
    "method": 'Größe "5"',
    "sha256": "ab" * 32,
    "submitted_at": "2025-11-24T16:00:00Z",
    "scored_at": "2025-11-24T16:01:00Z",
    "evaluator": "relight 0.1.0, scores 1",
    "scores": {
        "means": [mean("easy", 25.0), mean("hard", None)],
        "scenes": [{"scene": "cube", "means": [mean("easy", 25.79)]}],
    },
    "public_key": public,
}
text = json.dumps(receipt, sort_keys=True, separators=(",", ":"), ensure_ascii=False)
print(public)
print(key.sign(text.encode()).hex())
