"""The judges of stacks of slabs, side by side or nested, and of landings behind them."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from kiriko.core.light.compile_plan import compile_plan
from kiriko.core.light.rays import Reason
from kiriko.core.light.trace import trace_all
from kiriko.core.rig.rig import ConstantIndex, Glass, Mesh, Rig
from kiriko.core.rig.settings import Settings

from .. import closed_forms
from ..reference_rigs import box, rig
from .light import OUT_OF_THE_WAY, PER_RIG, random_angles
from .verdicts import Cases, Verdict, asin, dot, exactly, far_from, gathered, named, sqrt, unit

# m: half the width of slabs, and how far from their middle light enters
HALF = 0.1
ENTRY = 0.02


class Stack(NamedTuple):
    """Layers between the heights bounds (m + 1,) along y, with
    indices (m,), and the glass they are made of.
    """

    bounds: np.ndarray
    indices: np.ndarray
    glasses: tuple[Glass, ...]

    def __str__(self) -> str:
        return f"indices {self.indices.tolist()} between y = {self.bounds.tolist()}"


def slab(low: float, high: float, half: float) -> Mesh:
    """A box from y = low to y = high, to the last bit."""
    mesh = box([2 * half, 1, 2 * half])
    mesh.vertices[:, 1] = np.where(mesh.vertices[:, 1] < 0, low, high)
    return mesh


def random_stack(random: np.random.Generator, least: float) -> Stack:
    """One to four layers of 1 um to 10 mm, touching or nested.

    Indices from `least` that differ by 1e-12 to 1.
    """
    m = int(random.integers(1, 5))
    indices = [random.uniform(1.3, 1.9) if random.random() < 0.7 else random.uniform(least, 1)]
    for _ in range(m - 1):
        nearly = indices[-1] * (1 + random.choice([-1, 1]) * 10 ** random.uniform(-12, -3))
        indices.append(nearly if random.random() < 0.5 else random.uniform(least, 2))

    bounds = np.cumsum([0, *10 ** random.uniform(-6, -2, m)])
    bounds -= bounds[-1] / 2
    if m == 3 and random.random() < 0.7:
        indices[2] = indices[0]
        solids = [slab(bounds[0], bounds[3], HALF), slab(bounds[1], bounds[2], 0.9 * HALF)]
    else:
        solids = [slab(*bounds[i : i + 2], HALF) for i in range(m)]

    glasses = (
        Glass(f"{i}", mesh, ConstantIndex(n))
        for i, (mesh, n) in enumerate(zip(solids, indices, strict=False))
    )
    return Stack(bounds, np.array(indices), tuple(glasses))


class Path(NamedTuple):
    """The fate of light: place and direction (n, 3) of its end
    in mpmath's numbers, n_events (n,) interfaces met.

    k (n,) least cos^2 before or behind an interface; off (n,) rad, by how much the
    nearest class was missed; reach (n,) m, how far light went from where it entered
    """

    places: np.ndarray
    directions: np.ndarray
    n_events: np.ndarray
    k: np.ndarray
    off: np.ndarray
    reach: np.ndarray


def through_stack(stack: Stack, origins: np.ndarray, directions: np.ndarray) -> Path:
    """All layers share n sin a: each moves light sideways by its
    thickness times the tangent, on the way back again.
    """
    y = exactly(stack.bounds)
    media = exactly(np.array([1.0, *stack.indices, 1.0]))
    o = exactly(origins)
    d = unit(exactly(directions))
    along = np.where(np.array([True, False, True]), d, 0 * d)
    sine = sqrt(dot(along, along))
    shift = 0 * sine
    going = np.ones(len(o), bool)
    events = np.ones(len(o), int)
    k = (d[:, 1] ** 2).astype(float)
    off = np.full(len(o), np.inf)
    off_back = off.copy()  # on the way back through the layers passed

    def beyond(inner: object, outer: object) -> np.ndarray:
        """By how much (n,) rad light in one medium misses the critical angle to another."""
        if outer >= inner:
            return np.full(len(o), np.inf)
        angle = np.where(sine < inner, sine / inner, 1 + 0 * sine)
        return np.abs((asin(angle) - asin(outer / inner)).astype(float))

    height = np.full(len(o), y[-1])
    for j in range(1, len(media)):
        behind = (1 - sine / media[j]) * (1 + sine / media[j])
        off = np.where(going, np.minimum(off, beyond(media[j - 1], media[j])), off)
        turned = going & (behind < 0)
        height[turned], shift[turned], going = y[0], 2 * shift[turned], going & ~turned
        off[turned] = np.minimum(off, off_back)[turned]
        events[turned] = 2 * j - 1
        k = np.where(going, np.minimum(k, behind.astype(float)), k)
        off_back = np.minimum(off_back, beyond(media[j], media[j - 1]))
        if j < len(media) - 1:
            thickness = y[j] - y[j - 1]
            tangent = sine / media[j] / sqrt(np.where(going, behind, 1 + 0 * sine))
            shift = shift + np.where(going, thickness * tangent, 0 * shift)
            events += going

    lost = sine == 0
    sideways = shift[:, None] * along / np.where(lost, 1 + sine, sine)[:, None]
    entry = o + ((y[0] - o[:, 1]) / d[:, 1])[:, None] * d
    places = entry + sideways
    places[:, 1] = height
    out = d.copy()
    out[~going, 1] *= -1

    return Path(places, out, events, k, off, np.abs(shift.astype(float)))


def random_light_on(
    stack: Stack, random: np.random.Generator, n: int
) -> tuple[np.ndarray, np.ndarray]:
    """Rays (n, 3) from 1 mm to 10 km away, of all angles, also
    those at which a layer begins to reflect totally.
    """
    media = np.array([1.0, *stack.indices])
    angle = random_angles(random, np.ones(n), random.choice(media, n))
    azimuth = random.uniform(0, 2 * np.pi, n)
    d = np.stack(
        [np.sin(angle) * np.cos(azimuth), np.cos(angle), np.sin(angle) * np.sin(azimuth)], axis=1
    )
    place = random.uniform(-ENTRY, ENTRY, (n, 3))
    place[:, 1] = stack.bounds[0]
    d = closed_forms.unit(d)
    return place - 10 ** random.uniform(-3, 4, (n, 1)) * d, d


def through_one_stack(random: np.random.Generator) -> Cases:
    stack = random_stack(random, 0.4)
    o, d = random_light_on(stack, random, PER_RIG)
    path = through_stack(stack, o, d)
    some = (path.reach < HALF / 2) & (o[:, 1] < stack.bounds[0])
    o = o[some]
    d = d[some]
    path = Path(*(part[some] for part in path))
    plan = compile_plan(rig(stack.glasses, **OUT_OF_THE_WAY), Settings())
    landings = trace_all(plan, o, d)
    is_wrong = (landings.n_events != path.n_events) | (landings.reason != Reason.MISSED_PLATE)

    # an error of the direction at cosine c in a layer is one of
    # the way along it, which it divides by c once more
    scale = np.linalg.norm(o, axis=1) + HALF + path.reach / np.sqrt(path.k)
    error = np.maximum(
        far_from(path.places, landings.positions) / scale,
        far_from(path.directions, landings.directions),
    )

    return Cases(error, path.k, is_wrong, path.off, named(stack, o, d))


def judge_stacks(n: int, seed: int = 0) -> list[Verdict]:
    """light.trace through stacks of slabs: where and in which
    direction light leaves the glass, after which events.
    """
    return [gathered("stack of slabs", n, seed, through_one_stack)]


def landing(a_rig: Rig, places: np.ndarray, directions: np.ndarray) -> np.ndarray:
    """Where light (n, 3) that leaves the glass ends on the
    display: the mirror image of the point it goes to.
    """

    def plane(mesh: Mesh) -> tuple[np.ndarray, np.ndarray]:
        a, b, c = exactly(mesh.vertices[:3])
        return a, unit(np.cross(b - a, c - a)[None])[0]

    def mirrored(p: np.ndarray) -> np.ndarray:
        return p - 2 * dot(p - corner, normal)[:, None] * normal

    corner, normal = plane(a_rig.plates[0].mesh)
    start, facing = plane(a_rig.display.mesh)
    aerial = mirrored(start[None])[0]
    facing = facing - 2 * dot(facing, normal) * normal
    way = dot(aerial - places, facing) / dot(directions, facing)
    return mirrored(places + way[:, None] * directions)


def onto_the_display(random: np.random.Generator) -> Cases:
    stack = random_stack(random, 1.0)
    d = closed_forms.unit(np.array([0, 1, 0]) + 0.15 * random.uniform(-1, 1, (PER_RIG, 3)))
    place = np.insert(random.uniform(-ENTRY, ENTRY, (PER_RIG, 2)), 1, stack.bounds[0], axis=1)
    o = place - 10 ** random.uniform(-1, 3, (PER_RIG, 1)) * d
    path = through_stack(stack, o, d)
    a_rig = rig(stack.glasses, display=0.4)
    landings = trace_all(compile_plan(a_rig, Settings()), o, d)
    error = far_from(landing(a_rig, path.places, path.directions), landings.positions)
    error /= np.linalg.norm(o, axis=1) + HALF
    return Cases(error, path.k, ~landings.has_arrived, path.off, named(stack, o, d))


def judge_landings(n: int, seed: int = 0) -> list[Verdict]:
    """core.light.trace through stacks of slabs and the ideal
    plate to the display, from 0.1 m to 1 km away.
    """
    return [gathered("landing behind slabs and plate", n, seed, onto_the_display)]
