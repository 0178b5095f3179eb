"""Light followed from mirror to mirror through a plate, in
three dimensions: the judge of core/light/plate.py.

Nothing is unfolded here: light goes to the nearest mirror of the slit or hole it is in, is
reflected there, and goes on until it is through the layer. docs/theory.md says why one fold
comes to the same.
"""

from typing import NamedTuple

import numpy as np

from .closed_forms import snell


class March(NamedTuple):
    """Where light comes out and how.

    positions (n, 3), drawn back to the middle plane; directions (n, 3); n_reflections (2, n) at the
    mirrors of the first and second direction; path (n,) the way from middle plane to middle plane,
    m; clearance (n,) by how much light passes the edges of mirrors, m: nearer than rounding, it may
    go either way
    """

    positions: np.ndarray
    directions: np.ndarray
    n_reflections: np.ndarray
    path: np.ndarray
    clearance: np.ndarray


def turned(v, axis, angle):
    """Rodrigues' rotation of a vector at right angles to a unit axis."""
    return np.cos(angle) * v + np.sin(angle) * np.cross(axis, v)


def mirrors(array, axes, faces):
    """Unit normals (n, 3) of the two directions of mirrors, and
    how far from the centre mirror number 0 is (n,).
    """
    if array.layout != "radial":
        first = np.tile((axes[0] + axes[1]) / np.sqrt(2), (len(faces), 1))
        second = turned(first, axes[2], np.pi / 2 + array.crossing_error)
        return [
            (normal, array.pitch * phase)
            for normal, phase in zip((first, second), array.phase, strict=True)
        ]

    # The corners of holes are sqrt(2) pitches apart along circles
    # with radii of as many: number them from azimuth 0.
    x = faces @ axes[0]
    y = faces @ axes[1]
    step = np.sqrt(2) * array.pitch
    ring = np.round(np.hypot(x, y) / step)
    azimuth = np.arctan2(y, x)
    outward = np.cos(azimuth)[:, None] * axes[0] + np.sin(azimuth)[:, None] * axes[1]
    sideways = turned(outward, axes[2], np.pi / 2)

    found = []
    for sign, phase in zip((1, -1), array.phase, strict=True):
        normal = (sign * outward + sideways) / np.sqrt(2)
        # the corner at azimuth 0, unrolled beside the light's own radius
        corner = (step * ring)[:, None] * (outward - azimuth[:, None] * sideways)
        found.append((normal, (corner * normal).sum(axis=1) + array.pitch * phase))

    return found


def follow_one(p, d, families, slits, pitch, forward, end):
    """Follow one ray (3,) to the plane at height `end`; returns place, direction, reflections.

    In Python's floats, which step fifty times as fast as arrays of one row: light that grazes the
    plate meets a hundred thousand mirrors.
    """

    def along(a, b):
        return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]

    p, d, forward = p.tolist(), d.tolist(), forward.tolist()
    layers = [
        (normal[0].tolist(), float(np.ravel(first)[0]), float(slit[0]))
        for (normal, first), slit in zip(families, slits, strict=True)
    ]
    counts = [0] * len(layers)

    while True:
        nearest = (end - along(p, forward)) / along(d, forward)
        hit = None
        for k, (normal, first, slit) in enumerate(layers):
            slope = along(d, normal)
            if slope:
                gap = pitch * (slit + (slope > 0)) - (along(p, normal) - first)
                way = gap / slope
                if way < nearest:
                    nearest, hit = way, k
        p = [x + nearest * e for x, e in zip(p, d, strict=True)]
        if hit is None:
            return p, d, counts

        normal = layers[hit][0]
        slope = 2 * along(d, normal)
        d = [e - slope * m for e, m in zip(d, normal, strict=True)]
        counts[hit] += 1


def through_layer(p, d, families, pitch, forward, end):
    """Follow light (n, 3) to the plane at height `end` along
    `forward`: from mirror to mirror of its own slits.

    Returns positions, directions, reflections per family and
    the least distance from an edge of a mirror.
    """
    p = p.copy()
    d = d.copy()
    rays = np.arange(len(p))
    counts = np.zeros((len(families), len(p)), int)
    clearance = np.full(len(p), np.inf)

    def beyond(normal, first):  # distance from mirror number 0
        return (p * normal).sum(axis=1) - first

    slits = [np.floor(beyond(*family) / pitch) for family in families]
    for family, slit in zip(families, slits, strict=True):
        inside = beyond(*family) - pitch * slit
        clearance = np.minimum(clearance, np.minimum(inside, pitch - inside))

    if len(rays) == 1:
        p[0], d[0], counts[:, 0] = follow_one(p[0], d[0], families, slits, pitch, forward, end)
        rays = rays[:0]

    while len(rays):
        to_end = (end - p[rays] @ forward) / (d[rays] @ forward)
        ways = [to_end]
        for (normal, first), slit in zip(families, slits, strict=True):
            slope = (d * normal).sum(axis=1)[rays]
            gap = pitch * (slit[rays] + (slope > 0)) - beyond(normal, first)[rays]
            with np.errstate(divide="ignore", invalid="ignore"):
                ways.append(np.where(slope == 0, np.inf, gap / slope))
        nearest = np.argmin(ways, axis=0)
        p[rays] += np.min(ways, axis=0)[:, None] * d[rays]
        for k, (normal, _) in enumerate(families):
            hit = rays[nearest == k + 1]
            d[hit] -= 2 * (d[hit] * normal[hit]).sum(axis=1)[:, None] * normal[hit]
            counts[k, hit] += 1
        rays = rays[nearest > 0]

    for family, slit in zip(families, slits, strict=True):
        inside = beyond(*family) - pitch * slit
        clearance = np.minimum(clearance, np.minimum(inside, pitch - inside))

    return p, d, counts, clearance


def march(array, centre, axes, positions, directions):
    """Light (n, 3) that would meet the plate's middle plane at
    positions, through refraction, layers and refraction.
    """
    out = [np.empty_like(positions), np.empty_like(positions)]
    counts = np.zeros((2, len(positions)), int)
    path = np.empty(len(positions))
    clearance = np.empty(len(positions))

    for side in (1, -1):
        some = np.flatnonzero(np.sign(directions @ axes[2]) == side)
        forward = side * axes[2]
        d = directions[some]
        half = array.thickness / 2
        p = positions[some] - centre
        back = (-half - p @ forward) / (d @ forward)
        p = p + back[:, None] * d
        families = mirrors(array, axes, p)
        normals = np.tile(forward, (len(p), 1))
        d = snell(d, normals, 1, array.ior)
        way = -back + array.thickness / (d @ forward)
        layers = [[0, 1]] if array.layout != "crossed" else [[0], [1]][::side]
        clear = np.full(len(p), np.inf)
        for number, layer in enumerate(layers, start=1):
            end = array.thickness * number / len(layers) - half
            chosen = [families[k] for k in layer]
            p, d, hits, free = through_layer(p, d, chosen, array.pitch, forward, end)
            counts[np.ix_(layer, some)] += hits
            clear = np.minimum(clear, free)
        d = snell(d, normals, array.ior, 1)
        back = -(p @ forward) / (d @ forward)
        out[0][some] = centre + p + back[:, None] * d
        out[1][some] = d
        path[some], clearance[some] = way - back, clear

    return March(*out, counts, path, clearance)
