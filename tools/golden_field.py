#!/usr/bin/env python3
"""Golden values of the radiance field, from an independent implementation in PyTorch (float64, autograd).

    python3 -m venv venv && venv/bin/pip install torch numpy safetensors
    venv/bin/python tools/golden_field.py crates/relight-field/tests/golden

Writes field.json (encodings, field values, losses and probes of all gradients of V0 to V5), adam.json, soap.json, and
v5.safetensors (a weights file). Weights are not stored in field.json: both sides draw them from the same generator.
"""

import json
import math
import sys
from pathlib import Path

import numpy as np
import torch
from safetensors.torch import save_file

torch.set_default_dtype(torch.float64)
F32 = np.float32
MASK = (1 << 64) - 1

SEED = 3
TABLE_SCALE = 8e3
GRID = {"levels": 3, "features": 2, "log2_table": 7, "base": 2, "finest": 9}
BOUNDS = [[-0.5, -0.4, 0.0], [0.75, 0.6, 0.8]]
DENSITY_SCALE = 3.0
DEPTH_WEIGHT, DEPTH_MARGIN, DISTORTION_WEIGHT = 0.25, 0.125, 0.5
NEGLIGIBLE = 1e-3

# Light input, skip, where e enters, visibility.
MODELS = {
    "v0": (None, False, 1, False),
    "v1": ("pose", False, 1, False),
    "v2": ("direction", False, 1, False),
    "v3": ("direction", True, 1, False),
    "v4": ("direction", True, 2, False),
    "v5": ("direction", True, 2, True),
}


# --- the program's generator: SplitMix64 with random access ---------------------------------------------------------


def mix(z):
    z = ((z ^ (z >> 30)) * 0xBF58476D1CE4E5B9) & MASK
    z = ((z ^ (z >> 27)) * 0x94D049BB133111EB) & MASK
    return z ^ (z >> 31)


def uniform(seed, stream, n):
    gamma = 0x9E3779B97F4A7C15
    key = mix(mix((seed + gamma) & MASK) ^ ((stream * gamma) & MASK))
    return np.array([(mix((key + (i + 1) * gamma) & MASK) >> 40) / 2.0**24 for i in range(n)], dtype=F32)


# --- the field, from the description of the weights file and from the paper -----------------------------------------


def resolutions():
    growth = (GRID["finest"] / GRID["base"]) ** (1 / (GRID["levels"] - 1))
    return [math.floor(GRID["base"] * growth**level + 1e-6) for level in range(GRID["levels"])]


def level_entries(r):
    return min((r + 1) ** 3, 1 << GRID["log2_table"])


def hash_grid(table, position):
    lo, hi = torch.tensor(np.array(BOUNDS, dtype=F32).astype(np.float64))
    x = ((position - lo) / (hi - lo)).clamp(0, 1)
    size = 1 << GRID["log2_table"]
    offset, out = 0, []
    for r in resolutions():
        cell = torch.clamp(torch.floor(x * r), max=r - 1).long()
        frac = x * r - cell
        value = 0
        for corner in range(8):
            step = torch.tensor([corner & 1, corner >> 1 & 1, corner >> 2 & 1])
            i, j, k = (cell + step).unbind(-1)
            if (r + 1) ** 3 <= size:
                index = i + j * (r + 1) + k * (r + 1) ** 2
            else:
                wrap = 0xFFFFFFFF
                index = ((i * 1 & wrap) ^ (j * 2654435761 & wrap) ^ (k * 805459861 & wrap)) % size
            weight = torch.where(step == 1, frac, 1 - frac).prod(-1, keepdim=True)
            value = value + weight * table[offset + index]
        out.append(value)
        offset += level_entries(r)
    return torch.cat(out, -1)


def harmonics(d):
    """Real spherical harmonics by their textbook definition, bands 0 to 3, Condon-Shortley phase, m = -l to l.

    sin^m(theta) e^(i m phi) is written as (x + iy)^m, and `derivative` is the Legendre polynomial's m-th.
    """
    x, y, z = d.unbind(-1)
    rim = torch.complex(x, y)
    one = torch.ones_like(z)
    derivative = {
        (0, 0): one, (1, 0): z, (1, 1): one, (2, 0): (3 * z**2 - 1) / 2, (2, 1): 3 * z, (2, 2): 3 * one,
        (3, 0): (5 * z**3 - 3 * z) / 2, (3, 1): (15 * z**2 - 3) / 2, (3, 2): 15 * z, (3, 3): 15 * one,
    }
    out = []
    for l in range(4):
        for m in range(-l, l + 1):
            a = abs(m)
            norm = math.sqrt((2 * l + 1) / (4 * math.pi) * math.factorial(l - a) / math.factorial(l + a))
            wave = one if m == 0 else math.sqrt(2) * ((rim**a).real if m > 0 else (rim**a).imag)
            out.append((-1) ** a * norm * derivative[l, a] * wave)
    return torch.stack(out, -1)


def pose_code(pose):
    octaves = 2.0 ** torch.arange(6)
    angles = pose[..., :, None] * octaves
    return torch.cat([pose, angles.sin().flatten(-2), angles.cos().flatten(-2)], -1)


class Field:
    def __init__(self, model):
        self.light, self.skip, self.e_layer, self.visibility = MODELS[model]
        h = GRID["levels"] * GRID["features"]
        light = {None: 0, "pose": 156, "direction": 16}[self.light]
        rgb0 = 16 + light + (h if self.skip else 0) + (15 if self.e_layer == 1 else 0)
        shapes = {"grid.table": [sum(map(level_entries, resolutions())), 2]}
        shapes |= {"geo.0.weight": [64, h], "geo.1.weight": [16, 64]}
        shapes |= {"rgb.0.weight": [64, rgb0], "rgb.1.weight": [64, 64 + (15 if self.e_layer == 2 else 0)]}
        shapes |= {"rgb.2.weight": [64, 64], "rgb.3.weight": [3, 64]}
        if self.visibility:
            shapes |= {"vis.0.weight": [64, h + 16], "vis.1.weight": [64, 64]}
            shapes |= {"vis.2.weight": [64, 64], "vis.3.weight": [1, 64]}
        self.float32, self.tensors = {}, {}
        for stream, (name, shape) in enumerate(shapes.items()):
            bound = F32(1e-4) if name == "grid.table" else F32(1) / np.sqrt(F32(shape[1]))
            values = (F32(2) * uniform(SEED, stream, math.prod(shape)) - F32(1)) * bound
            if name == "grid.table":
                values = values * F32(TABLE_SCALE)
            self.float32[name] = values.reshape(shape)
            self.tensors[name] = torch.tensor(values.reshape(shape).astype(np.float64), requires_grad=True)

    def mlp(self, name, x, late=None):
        layers = [v for k, v in self.tensors.items() if k.startswith(name + ".")]
        for i, weight in enumerate(layers):
            if i == 1 and late is not None:
                x = torch.cat([x, late], -1)
            x = x @ weight.T
            if i + 1 < len(layers):
                x = torch.relu(x)
        return x

    def geometry(self, position):
        h = hash_grid(self.tensors["grid.table"], position)
        out = self.mlp("geo", h)
        return h, DENSITY_SCALE * torch.exp(out[..., 0]), out[..., 1:]

    def decode(self, h, e, direction, pose, position):
        """Colour before visibility, and visibility (ones without)."""
        to_light = pose.unflatten(-1, (3, 4))[..., 3] - position
        toward = harmonics(to_light / to_light.norm(dim=-1, keepdim=True))
        x = [harmonics(direction)]
        if self.light == "pose":
            x.append(pose_code(pose).expand(*h.shape[:-1], -1))
        if self.light == "direction":
            x.append(toward)
        if self.skip:
            x.append(h)
        if self.e_layer == 1:
            x.append(e)
        c = torch.sigmoid(self.mlp("rgb", torch.cat(x, -1), e if self.e_layer == 2 else None))
        o = torch.ones_like(c[..., :1])
        if self.visibility:
            o = torch.sigmoid(self.mlp("vis", torch.cat([h, toward], -1)))
        return c, o


def losses(field, shading, batch):
    """The three parts of the loss, and the loss."""
    lights, colours, penalty, distortion = torch.tensor(batch["lights"]), [], 0, 0
    rays = len(batch["origins"])
    for r in range(rays):
        origin, direction = torch.tensor(batch["origins"][r]), torch.tensor(batch["directions"][r])
        t, delta = torch.tensor(batch["t"][r]), torch.tensor(batch["delta"][r])
        x = origin + t[:, None] * direction
        h, sigma, e = field.geometry(x)
        alpha = 1 - torch.exp(-sigma * delta)
        alpha = torch.cat([alpha[:-1], torch.ones(1)])
        w = alpha * torch.cat([torch.ones(1), torch.cumprod(1 - alpha, 0)[:-1]])
        for light in batch["light_index"][r]:
            if shading == "per-sample":
                c, o = field.decode(h, e, direction.expand(len(t), 3), lights[light].expand(len(t), 12), x)
                colours.append((w[:, None] * o * c).sum(0))
            else:
                inside, beyond = w[:-1].sum(), w[-1]
                mean = [(w[:-1, None] * v[:-1]).sum(0) / inside for v in (h, e, x)]
                parts = [(inside, mean[0], mean[1], mean[2].detach()), (beyond, h[-1], e[-1], x[-1])]
                if min(inside, beyond) <= NEGLIGIBLE:
                    parts = [(torch.tensor(1.0), *parts[int(inside <= NEGLIGIBLE)][1:])]
                decoded = [(share, field.decode(*p[:2], direction, lights[light], p[2])) for share, *p in parts]
                colours.append(sum(share * o * c for share, (c, o) in decoded))
        if batch["depths"][r] is not None:
            u = (t - batch["depths"][r]) / DEPTH_MARGIN
            penalty = penalty + (w * u**2 / (1 + u**2)).sum() / rays
        edge = max(hi - lo for lo, hi in zip(*BOUNDS))
        s, length = t / edge, delta / edge
        pairs = (w[:, None] * w[None, :] * (s[:, None] - s[None, :]).abs()).sum()
        distortion = distortion + (pairs + (w**2 * length).sum() / 3) / rays
    colours = torch.stack(colours)
    mse = ((colours - torch.tensor(batch["colours"]).reshape(-1, 3)) ** 2).mean()
    return mse, penalty, distortion, mse + DEPTH_WEIGHT * penalty + DISTORTION_WEIGHT * distortion


# --- inputs ---------------------------------------------------------------------------------------------------------


def exact(values):
    """As numbers that a 32-bit float holds exactly."""
    return np.asarray(values, dtype=F32).astype(np.float64).tolist()


def make_batch(rng):
    rays, pairs = 3, 2
    directions = np.concatenate([rng.uniform(-0.3, 0.3, (rays, 2)), -np.ones((rays, 1))], 1)
    t = np.sort(rng.uniform(0.15, 1.1, (rays, 7)), 1)
    t = np.array(exact(t))
    # Intervals through which a ray shows what is inside and beyond, only the former, and only the latter.
    delta = np.concatenate([np.diff(t, axis=1), np.zeros((rays, 1))], 1) * [[1.0], [100.0], [1e-5]]
    lights = rng.uniform(-1, 1, (3, 3, 4))
    lights[:, :, 3] = 0.3 * lights[:, :, 3] + [-0.6, 0.5, 0.9]
    return {
        "origins": exact(np.concatenate([rng.uniform(-0.3, 0.3, (rays, 2)), np.ones((rays, 1))], 1)),
        "directions": exact(directions / np.linalg.norm(directions, axis=1, keepdims=True)),
        "lights": exact(lights.reshape(3, 12)),
        "light_index": [[0, 1], [2, 0], [1, 1]],
        "colours": exact(rng.uniform(0, 1, (rays, pairs, 3))),
        "depths": exact([0.5, 0.75]) + [None],
        "t": t.tolist(),
        "delta": delta.tolist(),
    }


def probes(gradient):
    """Two random projections of a gradient, its norm, and its largest entry."""
    g = gradient.detach().numpy().ravel()
    at = int(np.abs(g).argmax())
    projections = [float(g @ (2 * uniform(17, stream, g.size).astype(np.float64) - 1)) for stream in (0, 1)]
    return {"projections": projections, "norm": float(np.linalg.norm(g)), "largest": [at, float(g[at])]}


def field_values(model, points):
    field = Field(model)
    position, direction = torch.tensor(points["positions"]), torch.tensor(points["directions"])
    pose = torch.tensor(points["light"]).expand(len(position), 12)
    h, sigma, e = field.geometry(position)
    c, o = field.decode(h, e, direction, pose, position)
    return {"density": sigma.tolist(), "rgb": (o * c).tolist(), "visibility": o[:, 0].tolist()}


def golden_field():
    rng = np.random.default_rng(20)
    batch = make_batch(rng)
    directions = rng.normal(size=(6, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    positions = rng.uniform(BOUNDS[0], BOUNDS[1], (6, 3))
    positions[4], positions[5] = BOUNDS[1], BOUNDS[0]
    points = {"positions": exact(positions), "directions": exact(directions), "light": batch["lights"][0]}
    table = Field("v0").tensors["grid.table"]
    result = {
        "seed": SEED, "table_scale": TABLE_SCALE, "grid": GRID, "bounds": BOUNDS, "density_scale": DENSITY_SCALE,
        "depth_weight": DEPTH_WEIGHT, "depth_margin": DEPTH_MARGIN, "distortion_weight": DISTORTION_WEIGHT,
        "batch": batch,
        "points": points,
        "hash_grid": hash_grid(table, torch.tensor(points["positions"])).tolist(),
        "harmonics": harmonics(torch.tensor(points["directions"])).tolist(),
        "pose_code": pose_code(torch.tensor(points["light"])).tolist(),
        "models": {},
    }
    for model in MODELS:
        entry = {"values": field_values(model, points)}
        for shading in ("per-sample", "deferred"):
            field = Field(model)
            mse, penalty, distortion, total = losses(field, shading, batch)
            total.backward()
            entry[shading] = {
                "mse": mse.item(), "depth": penalty.item(),
                "distortion": distortion.item(), "total": total.item(),
                "gradient": {name: probes(v.grad) for name, v in field.tensors.items()},
            }
        result["models"][model] = entry
    return result


def golden_adam():
    """Four entries of two numbers over six steps; None where no ray touched the entry. One optimiser an entry."""
    rng = np.random.default_rng(5)
    gradients = exact(rng.normal(size=(6, 4, 2)) * [[[1e-3]], [[1.0]], [[1e-8]], [[1e-2]], [[1e-5]], [[0.1]]])
    touched = [[1, 1, 0, 0], [1, 0, 1, 0], [1, 1, 1, 0], [1, 0, 0, 0], [1, 1, 1, 0], [1, 0, 1, 0]]
    start = exact(rng.normal(size=(4, 2)))
    entries = [torch.tensor(v, requires_grad=True) for v in start]
    optimisers = [torch.optim.Adam([v], lr=float(F32(1e-2)), betas=(0.9, 0.999), eps=1e-15) for v in entries]
    for step in range(6):
        for entry in range(4):
            if touched[step][entry]:
                entries[entry].grad = torch.tensor(gradients[step][entry])
                optimisers[entry].step()
            else:
                gradients[step][entry] = [0.0, 0.0]
    return {"start": start, "gradients": gradients, "end": [v.tolist() for v in entries]}


def golden_soap():
    """One layer that SOAP (Vyas et al. 2024, algorithm 3) updates, with bases by torch's QR; their signs cancel."""
    outputs, inputs, layer, updates = 5, 7, 1, 130
    memory, period, early, floor, epsilon, rate, betas = 0.95, 40, 9, 1e-4, 1e-5, 0.01, (0.9, 0.999)

    def gradient(count):
        u = torch.tensor(uniform(SEED, 1000 + count, 3 + outputs * inputs).astype(float))
        total = 0.01 * (u[3:].reshape(outputs, inputs) - 0.5)
        for d in range(3):
            rows = torch.sin((d + 1.3) * (torch.arange(outputs) + 0.7))
            columns = torch.sin((d + 2.1) * (torch.arange(inputs) + 0.4))
            total = total + 10.0**-d * (u[d] - 0.4) * rows[:, None] * columns[None, :]
        return total

    start = torch.tensor(uniform(SEED, 999, outputs * inputs).astype(float)).reshape(outputs, inputs) - 0.5
    weight, first, second = start.clone(), torch.zeros_like(start), torch.zeros_like(start)
    sides = [[torch.zeros(n, n), torch.eye(n)] for n in (outputs, inputs)]
    for count in range(1, updates + 1):
        g = gradient(count)
        sides[0][0] = memory * sides[0][0] + g @ g.T
        sides[1][0] = memory * sides[1][0] + g.T @ g
        left, right = sides[0][1], sides[1][1]  # eigenvectors in columns
        turned = left.T @ g @ right
        first = betas[0] * first + (1 - betas[0]) * turned
        second = betas[1] * second + (1 - betas[1]) * turned**2
        root = (second / (1 - betas[1] ** count)).sqrt()
        step = first / (1 - betas[0] ** count) / (root + epsilon * (root**2).mean().sqrt())
        weight = weight - rate * left @ step @ right.T
        if count <= early or (count + layer) % period == 0:
            world = left @ first @ right.T
            for side in sides:
                shifted = side[0] / side[0].diagonal().mean() + floor * torch.eye(len(side[0]))
                side[1] = torch.linalg.qr(shifted @ side[1])[0]
            first = sides[0][1].T @ world @ sides[1][1]
    return {"seed": SEED, "layer": layer, "updates": updates, "start": start.tolist(), "end": weight.tolist()}


def main():
    out = Path(sys.argv[1])
    out.mkdir(parents=True, exist_ok=True)
    (out / "field.json").write_text(json.dumps(golden_field()) + "\n")
    (out / "adam.json").write_text(json.dumps(golden_adam()) + "\n")
    (out / "soap.json").write_text(json.dumps(golden_soap()) + "\n")
    metadata = {
        "format": "relight-1", "model": "v5", "bounds": json.dumps(BOUNDS), "density_scale": json.dumps(DENSITY_SCALE),
        "grid": json.dumps(GRID | {"resolutions": resolutions()}),
    }
    tensors = {name: torch.tensor(values) for name, values in Field("v5").float32.items()}
    save_file(tensors, str(out / "v5.safetensors"), metadata=metadata)
    (out / "v5.safetensors").chmod(0o644)


if __name__ == "__main__":
    main()
