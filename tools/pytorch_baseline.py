#!/usr/bin/env python3
"""Trains V5 with the paper's recipe in plain PyTorch on the CPU and prints rays a second, for comparison.

    venv/bin/pip install torch numpy
    venv/bin/python tools/pytorch_baseline.py [--rays 4096] [--samples 128 128] [--steps 2] [--threads 2]

The data are random: the time of a step does not depend on them. A ray is a pixel under one light. By default 128
stratified samples find the weights from which 128 more are drawn; all 256 are evaluated. The default grid of torch-ngp; Adam at
1e-2 on every weight.
"""

import argparse
import math
import time

import torch
from torch import nn

LEVELS, TABLE, BASE, FINEST = 16, 1 << 19, 16, 2048
CHUNK = 131072  # samples whose activations are held at once


class HashGrid(nn.Module):
    def __init__(self):
        super().__init__()
        growth = (FINEST / BASE) ** (1 / (LEVELS - 1))
        self.resolutions = [math.floor(BASE * growth**level + 1e-6) for level in range(LEVELS)]
        self.tables = nn.ParameterList(
            nn.Parameter(torch.empty(min((r + 1) ** 3, TABLE), 2).uniform_(-1e-4, 1e-4)) for r in self.resolutions
        )
        self.register_buffer("corners", torch.tensor([[c & 1, c >> 1 & 1, c >> 2 & 1] for c in range(8)]))
        self.register_buffer("primes", torch.tensor([1, 2654435761, 805459861]))

    def forward(self, x):
        features = []
        for r, table in zip(self.resolutions, self.tables):
            cell = (x * r).floor().clamp(max=r - 1)
            offset = (x * r - cell)[:, None]
            vertex = cell.long()[:, None] + self.corners
            if (r + 1) ** 3 <= TABLE:
                index = vertex[..., 0] + vertex[..., 1] * (r + 1) + vertex[..., 2] * (r + 1) ** 2
            else:
                i, j, k = (vertex * self.primes).unbind(-1)
                index = (i ^ j ^ k) & (TABLE - 1)
            weight = torch.where(self.corners.bool(), offset, 1 - offset).prod(-1, keepdim=True)
            features.append((weight * table[index]).sum(1))
        return torch.cat(features, -1)


def harmonics(d):
    x, y, z = d.unbind(-1)
    xx, yy, zz = x * x, y * y, z * z
    c = [0.28209479, 0.48860251, 1.09254843, 0.94617470, 0.31539157, 0.54627422]
    c += [0.59004359, 2.89061144, 0.45704580, 0.37317633, 1.44530572]
    return torch.stack(
        [
            torch.full_like(x, c[0]), -c[1] * y, c[1] * z, -c[1] * x, c[2] * x * y, -c[2] * y * z,
            c[3] * zz - c[4], -c[2] * x * z, c[5] * (xx - yy), c[6] * y * (yy - 3 * xx), c[7] * x * y * z,
            c[8] * y * (1 - 5 * zz), c[9] * z * (5 * zz - 3), c[8] * x * (1 - 5 * zz), c[10] * z * (xx - yy),
            c[6] * x * (3 * yy - xx),
        ],
        -1,
    )


def linear(inputs, outputs):
    return nn.Linear(inputs, outputs, bias=False)


class V5(nn.Module):
    def __init__(self):
        super().__init__()
        h = 2 * LEVELS
        self.grid = HashGrid()
        self.geo = nn.Sequential(linear(h, 64), nn.ReLU(), linear(64, 16))
        self.rgb_in = nn.Sequential(linear(32 + h, 64), nn.ReLU())
        self.rgb = nn.Sequential(
            linear(64 + 15, 64), nn.ReLU(), linear(64, 64), nn.ReLU(), linear(64, 3), nn.Sigmoid()
        )
        self.vis = nn.Sequential(
            linear(h + 16, 64), nn.ReLU(), linear(64, 64), nn.ReLU(), linear(64, 64), nn.ReLU(), linear(64, 1),
            nn.Sigmoid(),
        )

    def geometry(self, x):
        h = self.grid(x)
        out = self.geo(h)
        return h, out[:, 0].clamp(max=15).exp(), out[:, 1:]

    def radiance(self, h, e, view, x, light):
        toward = harmonics(nn.functional.normalize(light - x, dim=-1))
        colour = self.rgb(torch.cat([self.rgb_in(torch.cat([view, toward, h], -1)), e], -1))
        return self.vis(torch.cat([h, toward], -1)) * colour


def weights(sigma, t, far):
    delta = torch.diff(torch.cat([t, far], -1))
    passed = torch.exp(-sigma * delta)
    before = torch.cumprod(torch.cat([torch.ones_like(far), passed], -1), -1)[:, :-1]
    return before * (1 - passed)


def render(field, origin, direction, light, coarse, fine):
    """Colours of some rays through the unit cube; `light` is one position a ray."""
    n = len(origin)
    near, far = torch.full((n, 1), 0.2), torch.full((n, 1), 1.2)
    point = lambda t: (origin[:, None] + t[..., None] * direction[:, None]).clamp(0, 1).reshape(-1, 3)
    with torch.no_grad():
        edges = near + (far - near) * torch.arange(coarse) / coarse
        t = edges + (far - near) / coarse * torch.rand(n, coarse)
        if fine:
            seen = weights(field.geometry(point(t))[1].view(n, coarse), t, far) + 1e-5
            cumulative = torch.cumsum(seen / seen.sum(-1, keepdim=True), -1)
            interval = torch.searchsorted(cumulative, torch.rand(n, fine)).clamp(max=coarse - 1)
            more = edges.expand(n, -1).gather(1, interval) + (far - near) / coarse * torch.rand(n, fine)
            t = torch.cat([t, more], -1).sort(-1).values
    x = point(t)
    h, sigma, e = field.geometry(x)
    each = lambda v: v[:, None].expand(n, coarse + fine, -1).reshape(-1, v.shape[-1])
    colour = field.radiance(h, e, each(harmonics(direction)), x, each(light))
    return (weights(sigma.view(n, -1), t, far)[..., None] * colour.view(n, -1, 3)).sum(1)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rays", type=int, default=4096)
    parser.add_argument("--samples", type=int, nargs=2, default=(128, 128), metavar=("STRATIFIED", "IMPORTANCE"))
    parser.add_argument("--steps", type=int, default=2)
    parser.add_argument("--threads", type=int, default=2)
    arguments = parser.parse_args()
    if min(arguments.rays, arguments.samples[0]) < 1 or arguments.samples[1] < 0:
        parser.error("there must be a ray and a stratified sample")
    torch.set_num_threads(arguments.threads)
    torch.manual_seed(0)
    field = V5()
    coarse, fine = arguments.samples
    chunk = max(1, CHUNK // (coarse + fine))
    optimiser = torch.optim.Adam(field.parameters(), lr=1e-2)
    for step in range(arguments.steps):
        begin = time.perf_counter()
        optimiser.zero_grad()
        loss = 0.0
        for first in range(0, arguments.rays, chunk):
            n = min(chunk, arguments.rays - first)
            origin = torch.cat([torch.rand(n, 2), torch.full((n, 1), 1.2)], -1)
            direction = nn.functional.normalize(torch.randn(n, 3) * 0.2 - torch.tensor([0.0, 0.0, 1.0]), dim=-1)
            light = torch.rand(n, 3) + torch.tensor([0.0, 0.0, 1.0])
            error = (render(field, origin, direction, light, coarse, fine) - torch.rand(n, 3)) ** 2
            part = error.sum() / (3 * arguments.rays)
            part.backward()
            loss += part.item()
        optimiser.step()
        seconds = time.perf_counter() - begin
        print(f"step {step}: loss {loss:.4f}, {seconds:.1f} s, {arguments.rays / seconds:.1f} rays/s", flush=True)


if __name__ == "__main__":
    main()
