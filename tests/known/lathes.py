"""Bodies turned on a lathe about y, each smooth between its sharp rims, with Blender's means."""

from dataclasses import replace

import numpy as np

from kiriko.core.rig.mesh import Mesh

from .reference_rigs import mean_normals, split_quads

APERTURE = 0.022  # m, the radius of the bodies below
BULGE = 0.05  # m, the radius of the lens's faces


def lathe(profiles, segments):
    """A body of profiles, each (m, 2) of radius and y, whose surfaces meet at sharp rims."""
    sides = [_turned(np.asarray(profile, float), segments) for profile in profiles]
    places = np.concatenate([side.vertices for side in sides])
    starts = np.cumsum([0, *(len(side.vertices) for side in sides)])
    _, first, one = np.unique(
        np.round(places / 1e-9).astype(np.int64), axis=0, return_index=True, return_inverse=True
    )
    triangles = [side.triangles + start for side, start in zip(sides, starts, strict=False)]
    n_before = np.cumsum([0, *(side.polygon.max() + 1 for side in sides)])
    polygons = [side.polygon + n for side, n in zip(sides, n_before, strict=False)]
    return Mesh(
        places[first],
        one.ravel()[np.concatenate(triangles)],
        np.concatenate([side.corner_normals for side in sides]),
        np.ones(sum(map(len, triangles)), bool),
        has_mean_normals=True,
        polygon=np.unique(np.concatenate(polygons), return_inverse=True)[1],
    )


def _turned(profile, segments):
    radius, height = profile.T
    turn = 2 * np.pi * np.arange(segments) / segments
    places = np.stack(
        np.broadcast_arrays(
            radius[:, None] * np.cos(turn), height[:, None], -radius[:, None] * np.sin(turn)
        ),
        axis=-1,
    )
    index = np.arange(places[..., 0].size).reshape(places.shape[:2])
    for end in (0, -1):
        if radius[end] == 0:
            index[end] = index[end, 0]
    triangles = split_quads(np.concatenate([index, index[:, :1]], axis=1))[:, ::-1]
    polygon = np.tile(np.arange(len(triangles) // 2), 2)

    has_area = (triangles != np.roll(triangles, 1, axis=1)).all(axis=1)
    order = np.flatnonzero(has_area)[np.argsort(polygon[has_area], kind="stable")]
    flat = np.zeros((len(order), 3, 3))
    mesh = Mesh(places.reshape(-1, 3), triangles[order], flat, np.ones(len(order), bool))
    return replace(mean_normals(mesh), polygon=polygon[order])


def lens(segments=96, rings=16):
    """A biconvex lens of 44 mm, of two spheres that meet at a sharp rim."""
    angle = np.linspace(np.arcsin(APERTURE / BULGE), 0, rings + 1)
    cap = BULGE * np.stack([np.sin(angle), np.cos(angle) - np.cos(angle[0])], axis=1)
    return lathe([cap, cap[::-1] * [1, -1]], segments)


def lens_normals(places, given):
    """Its own normals at places (n, 3), on the side of the given ones."""
    side = np.sign(given[:, 1])
    away = places + np.sqrt(BULGE**2 - APERTURE**2) * side[:, None] * [0, 1, 0]
    return away / np.linalg.norm(away, axis=1, keepdims=True)
