"""The judge of prisms, whose faces are not parallel: light is totally reflected inside."""

from __future__ import annotations

from typing import NamedTuple

import mpmath
import numpy as np

from kiriko.core.light.compile_plan import compile_plan
from kiriko.core.light.rays import Reason
from kiriko.core.light.trace import trace_all
from kiriko.core.rig.rig import ConstantIndex, Glass, Mesh
from kiriko.core.rig.settings import Settings

from .. import closed_forms
from ..reference_rigs import rig
from .light import OUT_OF_THE_WAY, PER_RIG, random_angles
from .verdicts import Cases, Verdict, dot, exactly, far_from, gathered, named, unit

MOST_EVENTS = 12  # light that meets more faces of a prism is not judged
AT_AN_EDGE = 1e-9  # m: nearer to an edge rounding decides which face is met


class Prism(NamedTuple):
    """A triangle (3, 2), counter-clockwise, drawn out along z, and its index."""

    corners: np.ndarray
    height: float
    index: float

    def __str__(self) -> str:
        return f"prism {self.corners.tolist()}, height {self.height!r}, index {self.index!r}"

    @property
    def mesh(self) -> Mesh:
        z = np.repeat([-self.height / 2, self.height / 2], 3)[:, None]
        t = [[0, 2, 1], [3, 4, 5], [0, 1, 4], [0, 4, 3], [1, 2, 5], [1, 5, 4], [2, 0, 3], [2, 3, 5]]
        return Mesh(np.hstack([np.tile(self.corners, (2, 1)), z]), np.array(t))

    @property
    def planes(self) -> list[tuple[list, object]]:
        """Unit normals out of the glass and their products with
        the planes' points, in mpmath's numbers.
        """
        a = exactly(self.corners)
        sides = np.roll(a, -1, axis=0) - a
        across = unit(np.stack([sides[:, 1], -sides[:, 0], 0 * sides[:, 0]], axis=1))
        half = mpmath.mpf(self.height) / 2
        zero = mpmath.mpf(0)
        found = [(list(m), dot(m[:2], p)) for m, p in zip(across, a, strict=True)]
        return [*found, ([zero, zero, zero + 1], half), ([zero, zero, zero - 1], half)]


def random_prism(random: np.random.Generator) -> Prism:
    """Of 5 to 60 mm, with angles from 20 degrees; glass, nearly air, or less than air."""
    while True:
        at = np.sort(random.uniform(0, 2 * np.pi, 3))
        if np.diff([*at, at[0] + 2 * np.pi]).min() > np.radians(40):
            break

    radius = random.uniform(0.005, 0.06)
    index = random.choice(
        [
            random.uniform(1.3, 2),
            random.uniform(2, 4),
            random.uniform(0.5, 0.95),
            1 + random.choice([-1, 1]) * 10 ** random.uniform(-12, -3),
        ]
    )

    return Prism(
        radius * np.stack([np.cos(at), np.sin(at)], axis=1), random.uniform(0.02, 0.1), float(index)
    )


def random_light_into(
    prism: Prism, random: np.random.Generator, n: int
) -> tuple[np.ndarray, np.ndarray]:
    """Rays (n, 3) onto the prism's sides, at all angles; half of
    them so that a second side is met as in random_angles.

    Those are found backwards: from a place on that side through the glass and out of another.
    """
    a, index = prism.corners, prism.index
    ahead = closed_forms.unit(np.roll(a, -1, axis=0) - a)
    normals = np.stack([ahead[:, 1], -ahead[:, 0], 0 * ahead[:, 0]], axis=1)
    side = random.integers(0, 3, n)
    t = random.uniform(0.02, 0.98, (n, 1))
    place = np.hstack(
        [
            (1 - t) * a[side] + t * a[(side + 1) % 3],
            random.uniform(-0.4, 0.4, (n, 1)) * prism.height,
        ]
    )
    is_inside = random.random(n) < 0.5
    n1 = np.where(is_inside, index, 1.0)
    angle = random_angles(random, n1, np.where(is_inside, 1.0, index))
    normal = normals[side]
    azimuth = random.uniform(0, 2 * np.pi, n)[:, None]
    along = np.hstack([ahead[side], np.zeros((n, 1))])
    across = np.cos(azimuth) * along + np.sin(azimuth) * np.array([0, 0, 1.0])
    out = np.cos(angle)[:, None] * normal + np.sin(angle)[:, None] * across
    out[is_inside] -= 2 * (out * normal)[is_inside].sum(axis=1)[:, None] * normal[is_inside]

    # of those in the glass, on to where they leave it, backwards
    way = np.full(n, np.inf)
    last = np.zeros((n, 3))
    for k in range(3):
        with np.errstate(divide="ignore", invalid="ignore"):
            slope = out @ normals[k]
            t = ((a[k] - place[:, :2]) @ normals[k, :2]) / slope
        nearer = is_inside & (side != k) & (slope > 0) & (t < way)
        way[nearer] = t[nearer]
        last[nearer] = normals[k]

    met = np.isfinite(way)
    place[met] += way[met, None] * out[met]
    out[met] = closed_forms.snell(out[met], last[met], index, 1.0)
    keep = (
        (met | ~is_inside)
        & np.isfinite(out).all(axis=1)
        & (np.abs(place[:, 2]) < 0.49 * prism.height)
    )
    d = -closed_forms.unit(out[keep])

    return place[keep] - 10 ** random.uniform(-3, 4, (len(d), 1)) * d, d


class End(NamedTuple):
    """Of one ray: place, direction, interfaces met, least
    cos^2, rad from a critical angle, m from an edge.
    """

    place: list
    direction: list
    n_events: int
    k: float
    off: float
    clear: float


def through_prism(
    prism: Prism, planes: list, origin: np.ndarray, direction: np.ndarray
) -> End | None:
    """Face after face of a convex solid: in where the last of
    the planes before it is met, on to the first behind.
    """
    p = [mpmath.mpf(x) for x in origin.tolist()]
    d = [mpmath.mpf(x) for x in direction.tolist()]
    length = mpmath.sqrt(sum(x * x for x in d))
    d = [x / length for x in d]
    index = mpmath.mpf(prism.index)
    k = mpmath.inf
    off = mpmath.inf
    is_inside, clear = False, mpmath.inf

    for event in range(1, MOST_EVENTS + 1):
        ways = []
        for m, level in planes:
            slope = m[0] * d[0] + m[1] * d[1] + m[2] * d[2]
            if slope:
                ways.append(((level - m[0] * p[0] - m[1] * p[1] - m[2] * p[2]) / slope, slope, m))
        into = sorted((w for w in ways if w[1] < 0), key=lambda w: -w[0])
        out = sorted((w for w in ways if w[1] > 0), key=lambda w: w[0])
        met, *others = out if is_inside else into
        t, c, m = met
        if (
            not is_inside and out[0][0] < t
        ):  # beside the solid: in by the last plane only after out by the first
            return None
        others += [] if is_inside else out
        clear = min([clear, *(abs((other[0] - t) * other[1]) for other in others)])
        p = [x + t * e for x, e in zip(p, d, strict=True)]
        n1, n2 = (index, mpmath.mpf(1)) if is_inside else (mpmath.mpf(1), index)
        along = [e - c * x for e, x in zip(d, m, strict=True)]
        sine = mpmath.sqrt(sum(x * x for x in along))
        if n1 > n2:
            off = min(off, abs(mpmath.atan2(sine, abs(c)) - mpmath.asin(n2 / n1)))
        sine *= n1 / n2
        behind = (1 - sine) * (1 + sine)
        k = min(k, c * c)
        if behind < 0:  # mirrored
            d = [a - c * x for a, x in zip(along, m, strict=True)]
        else:
            k = min(k, behind)
            depth = mpmath.sqrt(behind) * (1 if c > 0 else -1)
            d = [n1 / n2 * a + depth * x for a, x in zip(along, m, strict=True)]
            is_inside = not is_inside
        if not is_inside:
            return End(p, d, event, float(k), float(off), float(clear))

    return None


def through_one_prism(random: np.random.Generator) -> Cases:
    prism = random_prism(random)
    o, d = random_light_into(prism, random, PER_RIG // 4)
    planes = prism.planes
    ends = [through_prism(prism, planes, *ray) for ray in zip(o, d, strict=True)]
    some = [i for i, end in enumerate(ends) if end is not None and end.clear > AT_AN_EDGE]
    o = o[some]
    d = d[some]
    ends = [ends[i] for i in some]
    glass = Glass("prism", prism.mesh, ConstantIndex(prism.index))
    landings = trace_all(compile_plan(rig((glass,), **OUT_OF_THE_WAY), Settings()), o, d)
    place, direction, n_events, k, off, _ = (np.array(column) for column in zip(*ends, strict=True))
    is_wrong = (landings.n_events != n_events) | (landings.reason != Reason.MISSED_PLATE)
    error = far_from(place, landings.positions) / (np.linalg.norm(o, axis=1) + prism.height)
    error = np.maximum(error, far_from(direction, landings.directions))

    return Cases(error / n_events, k, is_wrong, off, named(prism, o, d))


def judge_prisms(n: int, seed: int = 0) -> list[Verdict]:
    """core.light.trace through prisms: where and in which
    direction light leaves the glass, after which events.

    The mark is for each of the faces that are met, up to MOST_EVENTS.
    """
    return [gathered("prism", n, seed, through_one_prism)]
