"""Golden values of relight-metrics, from torchmetrics and scikit-image.

    pip install torch torchmetrics scikit-image pillow
    python tools/golden_metrics.py crates/relight-metrics/tests/golden

Writes raw RGB8 images (`NAME.rgb`, row-major, interleaved, with the size in `scores.txt`) and `scores.txt`, one line a
pair: name of the image, name of the ground truth, width, height, psnr, ssim, ssim_uniform7.
"""

import sys
from pathlib import Path

import numpy as np
import torch
from skimage.metrics import peak_signal_noise_ratio, structural_similarity
from torchmetrics.functional.image import peak_signal_noise_ratio as torch_psnr
from torchmetrics.functional.image import structural_similarity_index_measure


def picture(rng, width, height):
    """Smooth shading with an edge and a fine pattern, differing between channels."""
    y, x = np.mgrid[0:height, 0:width] / 10.0
    channels = [np.sin(x + k) * np.cos(0.7 * y - k) + 0.3 * np.sin(9 * x) * (y > 1.5) for k in range(3)]
    image = 127 + 70 * np.stack(channels, -1) + rng.normal(0, 3, (height, width, 3))
    image[:, width * 2 // 3 :] *= 0.4
    return image


def main():
    out = Path(sys.argv[1])
    out.mkdir(parents=True, exist_ok=True)
    rng = np.random.default_rng(7)
    lines = []
    for size, (width, height) in {"wide": (40, 30), "tall": (13, 29), "smallest": (11, 11)}.items():
        truth = picture(rng, width, height)
        variants = {
            "noisy": truth + rng.normal(0, 12, truth.shape),
            "shifted": np.roll(truth, 1, axis=1),
            "darker": 0.8 * truth - 10,
            "unrelated": rng.uniform(0, 255, truth.shape),
            "nearly": truth,
            "constant": np.full_like(truth, 90),
        }
        quantise = lambda image: np.clip(np.rint(image), 0, 255).astype(np.uint8)
        truth = quantise(truth)
        truth.tofile(out / f"{size}-truth.rgb")
        for name, image in variants.items():
            image = quantise(image)
            if name == "nearly":
                image[height // 2, width // 2, 1] ^= 1
            image.tofile(out / f"{size}-{name}.rgb")
            a, b = (torch.from_numpy(i.astype(np.float64) / 255).permute(2, 0, 1)[None] for i in (image, truth))
            psnr = float(peak_signal_noise_ratio(truth, image, data_range=255))
            # torchmetrics divides by a logarithm in single precision.
            assert abs(psnr - torch_psnr(a, b, data_range=1.0).item()) < 1e-5
            ssim = structural_similarity_index_measure(a, b, data_range=1.0).item()
            uniform7 = structural_similarity(truth, image, channel_axis=2, data_range=255)
            lines.append(f"{size}-{name} {size}-truth {width} {height} {psnr!r} {ssim!r} {float(uniform7)!r}")
    (out / "scores.txt").write_text("\n".join(lines) + "\n")


if __name__ == "__main__":
    main()
