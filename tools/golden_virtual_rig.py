#!/usr/bin/env python3
"""Golden pictures of Mitsuba 3 for crates/relight-capture/tests/golden/virtual_rig.json.

    pip install mitsuba numpy        # 3.9.1 was used; DRJIT_LIBLLVM_PATH must name an LLVM of at least version 16
    python3 tools/golden_virtual_rig.py > crates/relight-capture/tests/golden/virtual_rig.json
    python3 tools/golden_virtual_rig.py --models        # compares the surfaces written here with Mitsuba's own

Two kinds of pictures, each under a small spherical lamp at two places. `room`: rods, spheres and a sheet of all materials on a
chequered floor with two walls, in a grey room; direct light and one bounce. `balls`: a sphere of one material alone, for direct
light at many roughnesses. Kept are means over blocks of pixels and their standard errors, in parts of 10,000 of the mean, from
pictures of different seeds.

Geometry, paths, lamps, GGX facets and their sampling are Mitsuba's. Its own rough metal and plastic are other models than the
rig's, in two ways: masking and shadowing of a facet are taken as independent, and light that facets pass among themselves is
lost, outside and under the plastic's coat. So the two surfaces are written here, from the papers (Heitz 2014, height-correlated
Smith; Kulla and Conty 2017), with albedos integrated over all facets. `--models` draws the balls with both
simplifications, which is Mitsuba's model, with the second one, and with neither, each beside Mitsuba's own surfaces.
"""
import json
import sys

import drjit as dr
import mitsuba as mi
import numpy as np
from golden_microfacets import every_facet

mi.set_variant('llvm_ad_rgb')
SEEDS = 16
SIZE, FOCAL, BLOCK = [160, 120], 257.6, 8
EYE, TARGET = [0.36, -0.42, 0.33], [0.0, 0.0, 0.05]
LIGHTS = [[0.22, -0.28, 0.42], [-0.05, -0.2, 0.5]]
RADIUS, WALL_X, WALL_Y, WALL_HEIGHT, CHECK = 0.005, 0.38, 0.30, 0.29, 0.03
DARK, BRIGHT, ROOM = [0.2, 0.15, 0.1], [0.75, 0.7, 0.6], 0.5
RED, BLUE, GOLD = [0.5, 0.105, 0.022], [0.1, 0.25, 0.6], [0.95, 0.7, 0.35]
# After a bounce the rig knows no roughness below 0.25.
RODS = {'kind': 'glossy', 'colour': RED, 'alpha': 0.25, 'ior': 1.49}
SHEET = {'kind': 'translucent', 'colour': [0.5, 0.45, 0.2], 'through': [0.3, 0.4, 0.1]}
SHEET_QUAD = ((-0.19, -0.07, 0.0), (0.06, -0.08, 0.0), (0.02, 0.0, 0.12))
SPHERES = [([0.09, 0.06, 0.03], 0.03, {'kind': 'metal', 'colour': GOLD, 'alpha': 0.25}),
           ([0.12, -0.06, 0.025], 0.025, {'kind': 'metal', 'colour': [1.0, 1.0, 1.0], 'alpha': 0.5}),
           ([-0.09, 0.1, 0.04], 0.04, {'kind': 'glossy', 'colour': BLUE, 'alpha': 0.5, 'ior': 1.6})]
BALL_SIZE, BALL_FOCAL, BALL_BLOCK, BALL_RADIUS = [24, 24], 110.0, 4, 0.05
BALL_EYE, BALL_LIGHTS = [0.0, -0.5, 0.0], [[0.25, -0.3, 0.25], [0.3, 0.25, 0.1]]
BALLS = [{'kind': 'metal', 'colour': GOLD, 'alpha': alpha} for alpha in (0.05, 0.1, 0.25, 0.5, 1.0)]
BALLS += [{'kind': 'glossy', 'colour': BLUE, 'alpha': alpha, 'ior': 1.5} for alpha in (0.1, 0.3, 0.6)]


def reflectance(cosine, ior):
    """Fresnel's, of unpolarised light; `ior` is that of the far side."""
    inside = np.sqrt(np.maximum(1 - (1 - cosine**2) / ior**2, 0))
    parallel = (ior * cosine - inside) / (ior * cosine + inside)
    return (parallel**2 + ((cosine - ior * inside) / (cosine + ior * inside))**2) / 2


def scattered(alpha, ior, correlated, through=False):
    """Share of light that GGX facets reflect at once, or let through at once, at the squares of even numbers from 0 to 1; facets of
    white metal where `ior` is 0. Integrated over all facets."""
    x, z, phi, weights = every_facet(alpha, 600, 300)
    x = x * np.cos(phi)

    def slope(cosine):
        return (np.sqrt(1 + alpha**2 * (1 - cosine**2) / cosine**2) - 1) / 2
    shares = []
    for cosine in np.maximum(np.linspace(0, 1, 128)**2, 1e-4):
        facing = np.sqrt(1 - cosine**2) * x + cosine * z
        c = np.where(facing > 0, facing, 1)
        mirrored = reflectance(c, ior) if ior else 1
        if through:
            out = cosine / ior + (np.sqrt(np.maximum(1 - (1 - c**2) / ior**2, 0)) - c / ior) * z
        else:
            out = 2 * facing * z - cosine
        seen = (facing > 0) & (out > 0)
        a, b = slope(cosine), slope(np.where(seen, out, 1))
        shown = 1 / (1 + a + b) if correlated else 1 / ((1 + a) * (1 + b))
        share = 1 - mirrored if through else mirrored
        shares.append((weights * np.where(seen, share * shown * facing / (cosine * z), 0)).sum())
    return np.array(shares)


def average(shares):
    """Mean over the cosine-weighted hemisphere."""
    roots = np.linspace(0, 1, len(shares))
    return float(np.trapezoid(4 * roots**3 * shares, roots))


class Facets(mi.BSDF):
    """GGX facets, of metal or of a clear coat over a matt base."""

    def __init__(self, props):
        mi.BSDF.__init__(self, props)
        self.alpha, self.ior = props['alpha'], props.get('ior', 0.0)
        self.colour = mi.Color3f(props['colour'])
        self.correlated, self.shares = props['correlated'], props['shares']
        self.facets = mi.MicrofacetDistribution(mi.MicrofacetType.GGX, self.alpha)
        reach = 1 - scattered(self.alpha, self.ior, self.correlated)
        if self.ior:
            entering = average(reach) / self.ior**2
            if not self.shares:
                reach = scattered(self.alpha, self.ior, self.correlated, through=True)
                entering = 1 - average(scattered(self.alpha, 1 / self.ior, self.correlated))
            self.base = self.colour / self.ior**2 / (1 - self.colour * (1 - entering))
        else:
            mean, mirrored = average(reach), self.colour + (1 - self.colour) / 21
            self.base = mirrored**2 * (1 - mean) / (1 - mirrored * mean) / mean if self.shares else mi.Color3f(0)
        self.reach = mi.Texture1f(mi.TensorXf(reach[:, None].astype(np.float32)))
        self.m_components = [mi.BSDFFlags.GlossyReflection | mi.BSDFFlags.FrontSide]
        self.m_flags = self.m_components[0]

    def reached(self, cosine):
        n = self.reach.shape[0]
        return self.reach.eval(mi.Point1f((dr.sqrt(cosine) * (n - 1) + 0.5) / n))[0]

    def density(self, viewer, light):
        half = dr.normalize(viewer + light)
        facets = self.facets.pdf(viewer, half) / (4 * dr.abs(dr.dot(viewer, half)))
        return 0.5 * facets + 0.5 * mi.warp.square_to_cosine_hemisphere_pdf(light)

    def eval(self, ctx, si, light, active=True):
        viewer, half = si.wi, dr.normalize(si.wi + light)
        cosine = dr.dot(light, half)
        if self.ior:
            mirrored = mi.Color3f(mi.fresnel(cosine, self.ior)[0])
        else:
            mirrored = self.colour + (1 - self.colour) * (1 - cosine)**5
        a, b = (self.facets.smith_g1(v, half) for v in (viewer, light))
        shown = 1 / (1 / a + 1 / b - 1) if self.correlated else a * b
        facets = self.facets.eval(half) * shown / (4 * viewer.z * light.z)
        under = self.reached(viewer.z) * self.reached(light.z) * dr.inv_pi
        seen = active & (viewer.z > 0) & (light.z > 0)
        return dr.select(seen, (mirrored * facets + self.base * under) * light.z, 0)

    def pdf(self, ctx, si, light, active=True):
        return dr.select(active & (si.wi.z > 0) & (light.z > 0), self.density(si.wi, light), 0)

    def eval_pdf(self, ctx, si, light, active=True):
        return self.eval(ctx, si, light, active), self.pdf(ctx, si, light, active)

    def sample(self, ctx, si, choice, point, active=True):
        half = self.facets.sample(si.wi, point)[0]
        light = dr.select(choice < 0.5, mi.reflect(si.wi, half), mi.warp.square_to_cosine_hemisphere(point))
        return drawn(self, ctx, si, light, mi.BSDFFlags.GlossyReflection, active)


class Sheet(mi.BSDF):
    """A thin sheet that scatters evenly to both sides."""

    def __init__(self, props):
        mi.BSDF.__init__(self, props)
        self.back, self.through = mi.Color3f(props['colour']), mi.Color3f(props['through'])
        sides = mi.BSDFFlags.FrontSide | mi.BSDFFlags.BackSide
        self.m_components = [mi.BSDFFlags.DiffuseReflection | mi.BSDFFlags.DiffuseTransmission | sides]
        self.m_flags = self.m_components[0]

    def eval(self, ctx, si, light, active=True):
        share = dr.select(si.wi.z * light.z > 0, self.back, self.through)
        return dr.select(active, share * dr.abs(light.z) * dr.inv_pi, 0)

    def pdf(self, ctx, si, light, active=True):
        return dr.select(active, dr.abs(light.z) * dr.inv_two_pi, 0)

    def eval_pdf(self, ctx, si, light, active=True):
        return self.eval(ctx, si, light, active), self.pdf(ctx, si, light, active)

    def sample(self, ctx, si, choice, point, active=True):
        light = mi.warp.square_to_cosine_hemisphere(point)
        light.z = dr.select(choice < 0.5, light.z, -light.z)
        return drawn(self, ctx, si, light, mi.BSDFFlags.DiffuseReflection, active)


def drawn(bsdf, ctx, si, light, kind, active):
    sample = dr.zeros(mi.BSDFSample3f)
    sample.wo, sample.eta, sample.sampled_type = light, 1.0, mi.UInt32(+kind)
    value, sample.pdf = bsdf.eval_pdf(ctx, si, light, active)
    seen = active & (sample.pdf > 0)
    return dr.select(seen, sample, dr.zeros(mi.BSDFSample3f)), dr.select(seen, value / sample.pdf, 0)


mi.register_bsdf('facets', Facets)
mi.register_bsdf('sheet', Sheet)


def surface(material, correlated=True, shares=True):
    if material['kind'] == 'translucent':
        return {'type': 'sheet', 'colour': mi.ScalarColor3f(material['colour']),
                'through': mi.ScalarColor3f(material['through'])}
    return {'type': 'facets', 'alpha': material['alpha'], 'ior': material.get('ior', 0.0),
            'colour': mi.ScalarColor3f(material['colour']), 'correlated': correlated, 'shares': shares}


def box(a, b):
    a, b = np.asarray(a, float), np.asarray(b, float)
    v = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)]) * (b - a) + a
    f = np.array([[0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1], [2, 3, 7], [2, 7, 6],
                  [0, 2, 6], [0, 6, 4], [1, 5, 7], [1, 7, 3]])
    return v, f


def rods():
    edge, half = 0.088, 0.0029
    boxes = []
    for u in (0, edge):
        for w in (0, edge):
            boxes += [box((-half, u - half, w - half), (edge + half, u + half, w + half)),
                      box((u - half, -half, w - half), (u + half, edge + half, w + half)),
                      box((u - half, w - half, -half), (u + half, w + half, edge + half))]
    v = np.concatenate([b[0] for b in boxes])
    f = np.concatenate([b[1] + 8 * i for i, b in enumerate(boxes)])
    z = np.ones(3) / np.sqrt(3)                                 # the body diagonal stands upright
    x = np.cross([0, 0, 1], z)
    x /= np.linalg.norm(x)
    v = v @ np.array([x, np.cross(z, x), z]).T
    v -= [0.02, 0.0, v[:, 2].min() - 0.002]
    return v, f


def mesh(name, v, f, bsdf, uv=None):
    props = mi.Properties()
    props['bsdf'] = mi.load_dict(bsdf)
    m = mi.Mesh(name, len(v), len(f), has_vertex_texcoords=uv is not None, props=props)
    p = mi.traverse(m)
    p['vertex_positions'] = np.ascontiguousarray(v, np.float32).ravel()
    p['faces'] = np.ascontiguousarray(f, np.uint32).ravel()
    if uv is not None:
        p['vertex_texcoords'] = np.ascontiguousarray(uv, np.float32).ravel()
    p.update()
    return m


def quad(name, o, u, v, bsdf):
    o, u, v = (np.array(k, float) for k in (o, u, v))
    size = np.array([np.linalg.norm(u), np.linalg.norm(v)])
    uv = np.array([[0, 0], [1, 0], [1, 1], [0, 1]]) * size / (2 * CHECK)
    return mesh(name, np.array([o, o + u, o + u + v, o + v]), np.array([[0, 1, 2], [0, 2, 3]]), bsdf, uv)


def look_at(eye, target):
    z = np.subtract(target, eye)
    z /= np.linalg.norm(z)
    x = np.cross(z, [0, 0, 1])
    x /= np.linalg.norm(x)
    m = np.eye(4)
    m[:3, 0], m[:3, 1], m[:3, 2], m[:3, 3] = x, np.cross(z, x), z, eye
    return m


def pictures(shapes, lights, eye, target, size, focal, block, depth, samples):
    """Means over blocks, and their standard errors, one picture a light."""
    means, errors = [], []
    for light in lights:
        scene = {'type': 'scene', **shapes}
        scene['lamp'] = {'type': 'sphere', 'center': light, 'radius': RADIUS, 'emitter': {
            'type': 'area', 'radiance': {'type': 'rgb', 'value': 1 / (np.pi * RADIUS**2)}}}
        scene['integrator'] = {'type': 'path', 'max_depth': depth, 'rr_depth': 100}
        scene['sensor'] = {
            'type': 'perspective', 'fov': float(np.degrees(2 * np.arctan(size[0] / 2 / focal))), 'fov_axis': 'x',
            'to_world': mi.ScalarTransform4f((look_at(eye, target) @ np.diag([-1., -1, 1, 1])).tolist()),
            'near_clip': .01, 'far_clip': 10., 'sampler': {'type': 'independent'},
            'film': {'type': 'hdrfilm', 'width': size[0], 'height': size[1], 'rfilter': {'type': 'box'},
                     'pixel_format': 'rgb'}}
        loaded = mi.load_dict(scene)
        images = np.array([np.array(mi.render(loaded, spp=samples, seed=s)) for s in range(SEEDS)])
        blocks = images.reshape(SEEDS, size[1] // block, block, size[0] // block, block, 3).mean((2, 4))
        means.append(blocks.mean(0).ravel())
        errors.append(blocks.std(0, ddof=1).ravel() / np.sqrt(SEEDS))
    return means, errors


def ball(bsdf, samples=4096):
    shapes = {'ball': {'type': 'sphere', 'center': [0.0] * 3, 'radius': BALL_RADIUS, 'bsdf': bsdf}}
    return pictures(shapes, BALL_LIGHTS, BALL_EYE, [0.0] * 3, BALL_SIZE, BALL_FOCAL, BALL_BLOCK, 2, samples)


def room(samples=256):
    def both_sides(bsdf):
        return {'type': 'twosided', 'bsdf': bsdf}
    checks = np.array([[DARK, BRIGHT], [BRIGHT, DARK]], np.float32)
    cloth = both_sides({'type': 'diffuse', 'reflectance': {
        'type': 'bitmap', 'bitmap': mi.Bitmap(checks), 'raw': True, 'filter_type': 'nearest', 'wrap_mode': 'repeat'}})
    grey = both_sides({'type': 'diffuse', 'reflectance': {'type': 'rgb', 'value': ROOM}})
    shapes = {'rods': mesh('rods', *rods(), surface(RODS)), 'room': mesh('room', *box(*AROUND), grey)}
    for i, q in enumerate(QUADS):
        shapes[f'quad{i}'] = quad(f'quad{i}', *q, cloth)
    shapes['sheet'] = quad('sheet', *SHEET_QUAD, surface(SHEET))
    for i, (centre, radius, material) in enumerate(SPHERES):
        shapes[f'sphere{i}'] = {'type': 'sphere', 'center': centre, 'radius': radius, 'bsdf': surface(material)}
    return pictures(shapes, LIGHTS, EYE, TARGET, SIZE, FOCAL, BLOCK, 3, samples)


QUADS = [((-WALL_X, -.95, 0), (WALL_X + .95, 0, 0), (0, WALL_Y + .95, 0)),
         ((-WALL_X, WALL_Y, 0), (0, -WALL_Y - .85, 0), (0, 0, WALL_HEIGHT)),
         ((-WALL_X, WALL_Y, 0), (WALL_X + .85, 0, 0), (0, 0, WALL_HEIGHT))]
AROUND = [[-1.25, -1.25, -.3], [1.25, 1.25, 1.6]]


def compare_models():
    def native(m):
        if m['kind'] == 'metal':
            return {'type': 'roughconductor', 'distribution': 'ggx', 'alpha': m['alpha'], 'material': 'none'}
        return {'type': 'roughplastic', 'distribution': 'ggx', 'alpha': m['alpha'], 'nonlinear': True,
                'int_ior': m['ior'], 'ext_ior': 1.0, 'diffuse_reflectance': {'type': 'rgb', 'value': m['colour']}}
    for m in BALLS:
        if m['kind'] == 'metal':
            m = {**m, 'colour': [1.0] * 3}                      # as Mitsuba's `none`
        theirs, noise = (np.array(k) for k in ball(native(m)))
        said = []
        for correlated, shares in ((False, False), (True, False), (True, True)):
            ours, own = (np.array(k) for k in ball(surface(m, correlated, shares)))
            both = np.hypot(noise, own)
            lit = both > 0
            z = ((ours - theirs)[lit] / both[lit])
            said.append(f'{ours.sum() / theirs.sum() - 1:+.4f} (z {np.sqrt(np.mean(z**2)):.2f})')
        print(m['kind'], m['alpha'], 'apart from Mitsuba with both simplifications, without the first, with neither:',
              *said)


def main():
    if '--models' in sys.argv:
        return compare_models()

    def kept(means, errors):
        relative = np.array(errors) / np.maximum(means, 1e-12)
        return {'means': [[float(f'{x:.5g}') for x in p] for p in means],
                'errors': np.ceil(1e4 * relative).astype(int).tolist()}
    v, f = rods()
    json.dump({
        'radius': RADIUS,
        'room': {'size': SIZE, 'focal': FOCAL, 'block': BLOCK, 'eye': EYE, 'target': TARGET, 'lights': LIGHTS,
                 **kept(*room())},
        'check': CHECK, 'dark': DARK, 'bright': BRIGHT, 'quads': QUADS, 'around': AROUND, 'grey': ROOM,
        'positions': np.round(v, 9).tolist(), 'triangles': f.tolist(), 'rods': RODS, 'sheet': SHEET,
        'sheet_quad': SHEET_QUAD, 'spheres': [list(s) for s in SPHERES],
        'ball_radius': BALL_RADIUS,
        'balls': [{'material': m, 'view': {
            'size': BALL_SIZE, 'focal': BALL_FOCAL, 'block': BALL_BLOCK, 'eye': BALL_EYE, 'target': [0.0] * 3,
            'lights': BALL_LIGHTS, **kept(*ball(surface(m)))}} for m in BALLS]}, sys.stdout)


if __name__ == '__main__':
    main()
