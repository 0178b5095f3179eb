"""The judge of mirror arrays: light goes from mirror to mirror."""

from __future__ import annotations

from typing import NamedTuple

import mpmath
import numpy as np

from kiriko.core.light.plate import ArrayFrame, PlatePath
from kiriko.core.rig.rig import MirrorArray

from .light import PER_RIG
from .verdicts import Cases, Verdict, far_from, gathered, named

MOST_REFLECTIONS = 200  # in one layer; grazing light in a plate without glass would have millions


class March(NamedTuple):
    """Of one ray: place on the middle plane, direction;
    reflections at the mirrors of both directions.

    path m, clear m: the way through the plate, and by how much mirrors' edges are missed
    """

    place: list
    direction: list
    n_reflections: list[int]
    path: float
    clear: float


def margin(x: object, y: object, layer: list, slits: list, pitch: object) -> object:
    """How far light is from the nearest mirror of the slits it is in."""
    inside = [
        x * c + y * s - first - pitch * slit
        for (_, c, s, first), slit in zip(layer, slits, strict=True)
    ]
    return min(min(i, pitch - i) for i in inside)


def march(array: MirrorArray, place: np.ndarray, direction: np.ndarray) -> March | None:
    """From mirror to mirror through a plate in its own
    frame, in plane coordinates: each layer is upright.
    """
    x, y = (mpmath.mpf(c) for c in place.tolist()[:2])
    dx, dy, dz = (mpmath.mpf(c) for c in direction.tolist())
    length = mpmath.sqrt(dx * dx + dy * dy + dz * dz)
    dx = dx / length
    dy = dy / length
    dz = dz / length
    pitch, height, index = (mpmath.mpf(c) for c in (array.pitch, array.height, array.ior))
    back = array.n_layers * height / 2 / abs(dz)
    x = x - back * dx
    y = y - back * dy
    dx = dx / index
    dy = dy / index
    depth = mpmath.sqrt(1 - dx * dx - dy * dy)
    way = height / depth  # through one layer
    angles = mpmath.pi / 4, 3 * mpmath.pi / 4 + mpmath.mpf(array.crossing_error)
    families = [
        (k, mpmath.cos(a), mpmath.sin(a), array.phase[k] * pitch) for k, a in enumerate(angles)
    ]
    counts = [0, 0]
    clear = mpmath.inf
    layers = (
        [families] if array.layout == "holes" else [[f] for f in families][:: 1 if dz > 0 else -1]
    )

    for layer in layers:
        slits = [mpmath.floor((x * c + y * s - first) / pitch) for _, c, s, first in layer]
        clear = min(clear, margin(x, y, layer, slits, pitch))
        left = way
        while True:
            nearest, which = left, None
            for family, slit in zip(layer, slits, strict=True):
                _, c, s, first = family
                slope = dx * c + dy * s
                if slope:
                    gap = (pitch * (slit + (slope > 0)) + first - x * c - y * s) / slope
                    if gap < nearest:
                        nearest, which = gap, family
            x = x + nearest * dx
            y = y + nearest * dy
            left = left - nearest
            if which is None:
                break
            k, c, s, _ = which
            slope = 2 * (dx * c + dy * s)
            dx = dx - slope * c
            dy = dy - slope * s
            counts[k] = counts[k] + 1
            if counts[k] > MOST_REFLECTIONS:
                return None
        clear = min(clear, margin(x, y, layer, slits, pitch))

    dx, dy = dx * index, dy * index
    path = 2 * back + len(layers) * way
    return March(
        [x - back * dx, y - back * dy, mpmath.mpf(0)],
        [dx, dy, dz],
        counts,
        float(path),
        float(clear),
    )


def random_array(random: np.random.Generator) -> MirrorArray:
    """Crossed slits or holes, any phase, glass or nearly none between the mirrors."""
    layout = random.choice(["crossed", "holes"])
    return MirrorArray(
        layout=str(layout),
        pitch=10 ** random.uniform(-4, -2.5),
        height=10 ** random.uniform(-4, -2.5),
        ior=float(
            random.choice([1.0, 1.52, random.uniform(1, 2), 1 + 10 ** random.uniform(-12, -3)])
        ),
        reflectance=0.5,
        crossing_error=random.uniform(-0.02, 0.02) if layout == "crossed" else 0.0,
        has_fresnel=False,
        phase=tuple(random.uniform(-1, 1, 2).tolist()),
    )


def through_one_array(random: np.random.Generator) -> Cases:
    array = random_array(random)
    n = PER_RIG // 4
    cosine = np.choose(
        random.integers(0, 3, n),
        [
            random.random(n),
            np.sin(np.radians(10 ** random.uniform(-6, -1, n))),
            1 - 10 ** random.uniform(-16, -3, n),
        ],
    )
    azimuth = random.uniform(0, 2 * np.pi, n)
    sine = np.sqrt((1 - cosine) * (1 + cosine))
    along = sine * np.stack([np.cos(azimuth), np.sin(azimuth)])
    d = np.vstack([along, cosine * random.choice([-1, 1], n)]).T
    place = np.hstack([random.uniform(-0.25, 0.25, (n, 2)), np.zeros((n, 1))])
    crossed = array.height * sine / np.sqrt(array.ior**2 - sine**2) / array.pitch
    place = place[crossed < MOST_REFLECTIONS]
    d = d[crossed < MOST_REFLECTIONS]
    ends = [march(array, *ray) for ray in zip(place, d, strict=True)]
    some = [i for i, end in enumerate(ends) if end is not None]
    place = place[some]
    d = d[some]
    ends = [ends[i] for i in some]
    found = ArrayFrame(array, np.zeros(3), np.eye(3)).folded(place, d)
    exact, direction, counts, path, clear = (np.array(column) for column in zip(*ends, strict=True))
    is_odd = (counts % 2 == 1).astype(int)
    kinds = np.array(
        [[PlatePath.THROUGH, PlatePath.STRAY_2], [PlatePath.STRAY_1, PlatePath.IMAGED]]
    )
    is_wrong = (found.path != kinds[tuple(is_odd.T)]) | (
        found.throughput != 0.5 ** counts.sum(axis=1)
    )
    scale = np.linalg.norm(place, axis=1) + path
    error = np.maximum(
        far_from(exact, found.positions) / scale, far_from(direction, found.directions)
    )
    k = d[:, 2] ** 2

    return Cases(error, k, is_wrong, clear / scale * np.sqrt(k), named(array, place, d))


def judge_arrays(n: int, seed: int = 0) -> list[Verdict]:
    """core.light.plate's fold of crossed and single layers: where
    and in which direction light comes out, after which reflections.

    Light that passes a mirror's edge nearer than rounding, in parts of the way, may go either way.
    """
    return [gathered("mirror array", n, seed, through_one_array)]
