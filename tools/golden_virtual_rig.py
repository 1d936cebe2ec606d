#!/usr/bin/env python3
"""Golden pictures of Mitsuba 3 for crates/relight-capture/tests/golden/virtual_rig.json.

    pip install mitsuba numpy        # 3.9.1 was used; DRJIT_LIBLLVM_PATH must name an LLVM of at least version 16
    python3 tools/golden_virtual_rig.py > crates/relight-capture/tests/golden/virtual_rig.json

A cube of thin rods in rough plastic and a rough metal sphere on a chequered floor with two walls, in a grey room, under a
small spherical lamp at two places; direct light and one bounce. Pictures are kept as means over blocks of 8x8 pixels. The
sphere is white metal (every facet reflects all light). Mitsuba loses the light that facets pass among themselves, outside
and under the plastic's coat: half a per cent of it at this roughness, but a tenth of the base's light at an alpha of 0.3.
"""
import json
import sys

import numpy as np
import mitsuba as mi

mi.set_variant('llvm_ad_rgb')
WIDTH, HEIGHT, FOCAL, BLOCK = 160, 120, 257.6, 8
EYE, TARGET = [0.36, -0.42, 0.33], [0.0, 0.0, 0.05]
LIGHTS = [[0.22, -0.28, 0.42], [-0.05, -0.2, 0.5]]
RADIUS, WALL_X, WALL_Y, WALL_HEIGHT, CHECK = 0.005, 0.38, 0.30, 0.29, 0.03
SPHERE, SPHERE_RADIUS = [0.09, 0.06, 0.03], 0.03
DARK, BRIGHT = [0.2, 0.15, 0.1], [0.75, 0.7, 0.6]
PLASTIC, PLASTIC_ALPHA, IOR, METAL_ALPHA, ROOM = [0.5, 0.105, 0.022], 0.1, 1.49, 0.1, 0.5


def box(a, b):
    a, b = np.asarray(a, float), np.asarray(b, float)
    v = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)]) * (b - a) + a
    f = np.array([[0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1], [2, 3, 7], [2, 7, 6],
                  [0, 2, 6], [0, 6, 4], [1, 5, 7], [1, 7, 3]])
    return v, f


def frame():
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


def quad(o, u, v):
    o, u, v = (np.array(k, float) for k in (o, u, v))
    size = np.array([np.linalg.norm(u), np.linalg.norm(v)])
    uv = np.array([[0, 0], [1, 0], [1, 1], [0, 1]]) * size / (2 * CHECK)
    return np.array([o, o + u, o + u + v, o + v]), np.array([[0, 1, 2], [0, 2, 3]]), uv


def look_at():
    z = np.subtract(TARGET, EYE)
    z /= np.linalg.norm(z)
    x = np.cross(z, [0, 0, 1])
    x /= np.linalg.norm(x)
    m = np.eye(4)
    m[:3, 0], m[:3, 1], m[:3, 2], m[:3, 3] = x, np.cross(z, x), z, EYE
    return m


def both_sides(bsdf):
    return {'type': 'twosided', 'bsdf': bsdf}


def main():
    checks = np.array([[DARK, BRIGHT], [BRIGHT, DARK]], np.float32)
    cloth = both_sides({'type': 'diffuse', 'reflectance': {
        'type': 'bitmap', 'bitmap': mi.Bitmap(checks), 'raw': True, 'filter_type': 'nearest', 'wrap_mode': 'repeat'}})
    plastic = {'type': 'roughplastic', 'distribution': 'ggx', 'alpha': PLASTIC_ALPHA, 'nonlinear': True,
               'int_ior': IOR, 'ext_ior': 1.0, 'diffuse_reflectance': {'type': 'rgb', 'value': PLASTIC}}
    metal = {'type': 'roughconductor', 'distribution': 'ggx', 'alpha': METAL_ALPHA, 'material': 'none'}
    grey = both_sides({'type': 'diffuse', 'reflectance': {'type': 'rgb', 'value': ROOM}})
    quads = [((-WALL_X, -.95, 0), (WALL_X + .95, 0, 0), (0, WALL_Y + .95, 0)),
             ((-WALL_X, WALL_Y, 0), (0, -WALL_Y - .85, 0), (0, 0, WALL_HEIGHT)),
             ((-WALL_X, WALL_Y, 0), (WALL_X + .85, 0, 0), (0, 0, WALL_HEIGHT))]
    v, f = frame()
    room = [[-1.25, -1.25, -.3], [1.25, 1.25, 1.6]]
    pictures = []
    for light in LIGHTS:
        scene = {'type': 'scene', 'frame': mesh('frame', v, f, plastic), 'room': mesh('room', *box(*room), grey)}
        for i, q in enumerate(quads):
            qv, qf, uv = quad(*q)
            scene[f'quad{i}'] = mesh(f'quad{i}', qv, qf, cloth, uv)
        scene['sphere'] = {'type': 'sphere', 'center': SPHERE, 'radius': SPHERE_RADIUS, 'bsdf': metal}
        radiance = 1 / (np.pi * RADIUS ** 2)
        scene['lamp'] = {'type': 'sphere', 'center': light, 'radius': RADIUS,
                         'emitter': {'type': 'area', 'radiance': {'type': 'rgb', 'value': radiance}}}
        scene['integrator'] = {'type': 'path', 'max_depth': 3, 'rr_depth': 100}
        scene['sensor'] = {
            'type': 'perspective', 'fov': float(np.degrees(2 * np.arctan(WIDTH / 2 / FOCAL))), 'fov_axis': 'x',
            'to_world': mi.ScalarTransform4f((look_at() @ np.diag([-1., -1, 1, 1])).tolist()),
            'near_clip': .01, 'far_clip': 10.,
            'film': {'type': 'hdrfilm', 'width': WIDTH, 'height': HEIGHT, 'rfilter': {'type': 'box'},
                     'pixel_format': 'rgb'}, 'sampler': {'type': 'independent'}}
        loaded = mi.load_dict(scene)
        image = np.mean([np.array(mi.render(loaded, spp=256, seed=s)) for s in range(12)], 0)
        blocks = image.reshape(HEIGHT // BLOCK, BLOCK, WIDTH // BLOCK, BLOCK, 3).mean((1, 3))
        pictures.append([float(f'{x:.5g}') for x in blocks.ravel()])
    json.dump({
        'size': [WIDTH, HEIGHT], 'focal': FOCAL, 'block': BLOCK, 'eye': EYE, 'target': TARGET, 'lights': LIGHTS,
        'radius': RADIUS, 'check': CHECK, 'dark': DARK, 'bright': BRIGHT, 'quads': quads, 'room': room, 'grey': ROOM,
        'positions': np.round(v, 9).tolist(), 'triangles': f.tolist(), 'plastic': PLASTIC,
        'plastic_alpha': PLASTIC_ALPHA, 'ior': IOR, 'sphere': SPHERE, 'sphere_radius': SPHERE_RADIUS,
        'metal_alpha': METAL_ALPHA, 'pictures': pictures}, sys.stdout)


if __name__ == '__main__':
    main()
