#!/usr/bin/env python3
"""Light that random walks over rough surfaces send back, for crates/relight-capture/tests/golden/microfacets.json.

    pip install numpy
    python3 tools/golden_microfacets.py > crates/relight-capture/tests/golden/microfacets.json

A ray goes from facet to facet of a GGX surface with Smith's independent heights, until it leaves (Heitz et al. 2016, "Multiple-
scattering microfacet BSDFs with the Smith model"). No formula for masking enters, and nothing of the rig's. Facets are of metal
(Schlick's reflectance) or clear (Fresnel's; what enters them is gone). Kept are the share of light that leaves after one facet, and
after any number, with their standard errors.

Walks are too noisy to tell the little light that smooth surfaces lose. What does not leave after one facet is kept besides, by
masking's formula, integrated over all facets; the script ends with an error unless it is what the walks say, within their errors.
"""
import json
import sys

import numpy as np

RAYS, MOST = 400_000, 60


def slope(w, alpha):
    """Smith's Lambda of directions of the whole sphere."""
    z = np.where(np.abs(w[:, 2]) < 1e-9, 1e-9, w[:, 2])
    tangent = alpha * np.sqrt(np.clip(1 - z * z, 1e-14, 1)) / z
    return (np.sign(tangent) * np.sqrt(1 + tangent**2) - 1) / 2


def facets(v, alpha, rng):
    """Normals of facets that are seen from v (Dupuy and Benyoub 2023)."""
    s = v * [alpha, alpha, 1]
    s /= np.linalg.norm(s, axis=1)[:, None]
    u, angle = rng.random(len(v)), 2 * np.pi * rng.random(len(v))
    z = (1 - u) * (1 + s[:, 2]) - s[:, 2]
    r = np.sqrt(np.clip(1 - z * z, 0, 1))
    n = (np.stack([r * np.cos(angle), r * np.sin(angle), z], 1) + s) * [alpha, alpha, 1]
    n[:, 2] = np.maximum(n[:, 2], 0)
    return n / np.linalg.norm(n, axis=1)[:, None]


def walk(cosine, alpha, reflectance, rng):
    """Energy of each ray that leaves after one facet, and after any number."""
    ways = np.tile([-np.sqrt(1 - cosine**2), 0, -cosine], (RAYS, 1))
    below = np.ones(RAYS)                                       # share of facets lower than the ray
    energy, index = np.ones(RAYS), np.arange(RAYS)
    once, ever = np.zeros(RAYS), np.zeros(RAYS)
    for order in range(MOST):
        u, s = rng.random(len(ways)), slope(ways, alpha)
        with np.errstate(over='ignore', divide='ignore'):
            leaves = (ways[:, 2] > 0) & (u > 1 - below**s)
            below = np.clip(below / (1 - u)**(1 / np.where(np.abs(s) < 1e-9, 1e-9, s)), 0, 1)
        ever[index[leaves]] = energy[leaves]
        if order == 1:
            once = ever.copy()
        ways, below, energy, index = (k[~leaves] for k in (ways, below, energy, index))
        n = facets(-ways, alpha, rng)
        c = -np.sum(ways * n, 1)
        energy, ways = energy * reflectance(np.clip(c, 0, 1)), ways + 2 * c[:, None] * n
    return once, ever


def every_facet(alpha, slopes=1600, turns=800):
    """Facets of one half, whose light arrives in the x-z plane: sines, cosines, turns about the normal, and shares of all facets
    (as seen from above). Gauss's rule in the turn and in the slope's logarithm, so that steep facets are there as flat ones."""
    (x, weights), (y, widths) = (np.polynomial.legendre.leggauss(n) for n in (slopes, turns))
    reach = np.arcsinh(1e6) / 2
    slope, turn = np.sinh((x + 1) * reach)[:, None], (y + 1) * np.pi / 2
    shares = (weights * reach * np.cosh((x + 1) * reach))[:, None] * widths * slope / (1 + slope**2)**2
    z = 1 / np.sqrt(1 + (alpha * slope)**2)
    return alpha * slope * z, z, turn, shares


def lost(cosine, alpha, reflectance):
    """Share of light that does not leave after one facet (masking and shadowing as in Heitz 2014, correlated by height)."""
    sine, z, turn, shares = every_facet(alpha)
    facing = np.maximum(np.sqrt(1 - cosine**2) * sine * np.cos(turn) + cosine * z, 0)
    out = 2 * facing * z - cosine
    arriving, leaving = (np.sqrt(1 + alpha**2 * (1 / c**2 - 1)) / 2 - 0.5 for c in (cosine, np.where(out > 0, out, 1)))
    leaves = np.where(out > 0, reflectance(np.minimum(facing, 1)) * (1 + arriving) / (1 + arriving + leaving), 0)
    return float((shares * facing / (cosine * z) / (1 + arriving) * (1 - leaves)).sum())


def metal(colour):
    return lambda c: colour + (1 - colour) * (1 - c)**5


def clear(ior):
    def reflectance(c):
        inside = np.sqrt(1 - (1 - c * c) / ior**2)
        return (((ior * c - inside) / (ior * c + inside))**2 + ((c - ior * inside) / (c + ior * inside))**2) / 2
    return reflectance


def main():
    rng = np.random.default_rng(7)
    kinds = [('metal', 1.0, metal(1.0)), ('metal', 0.6, metal(0.6)), ('clear', 1.5, clear(1.5))]
    walks, table = [], []
    for kind, value, reflectance in kinds:
        for alpha in (0.1, 0.25, 0.5, 1.0):
            for cosine in (0.2, 0.5, 1.0):
                kept = dict(kind=kind, value=value, alpha=alpha, cosine=cosine)
                for name, energy in zip(('once', 'ever'), walk(cosine, alpha, reflectance, rng)):
                    kept[name] = [round(float(energy.mean()), 5), round(float(energy.std() / np.sqrt(RAYS)), 5)]
                share, error = kept['once']
                if abs(1 - share - lost(cosine, alpha, reflectance)) > 4 * error + 1e-5:
                    sys.exit(f'{kept}: {lost(cosine, alpha, reflectance)} is lost by the formula')
                walks.append(kept)
    for kind, value, reflectance in kinds[::2]:
        for alpha in (0.01, 0.02, 0.05, 0.1, 0.3, 0.7, 1.0):
            for cosine in (0.02, 0.05, 0.2, 0.5, 0.8, 0.95, 1.0):
                share = float(f'{lost(cosine, alpha, reflectance):.4g}')
                table.append(dict(kind=kind, value=value, alpha=alpha, cosine=cosine, lost=share))
    json.dump({'walks': walks, 'lost': table}, sys.stdout)


if __name__ == '__main__':
    main()
