"""mpmath at fifty digits as the judge of core: random cases,
hard ones among them, and what is kept of the marks.

What a case is given in float64 counts as exact, also where a direction is not quite unit. Arrays of
mpmath's numbers are numpy's arrays of objects. Nothing here follows core's way: refraction goes by
angles, stacks of slabs by the sine that all layers share, balls and prisms by the roots of their
own equations, mirrors from mirror to mirror.
"""

from collections.abc import Callable
from typing import NamedTuple

import mpmath
import numpy as np

from kiriko.core.light.landings import Reason
from kiriko.core.light.optics import refract
from kiriko.core.light.planning import make_plan
from kiriko.core.light.plate import ArrayFrame, PlatePath
from kiriko.core.light.trace import trace_all
from kiriko.core.rig import ConstantIndex, Glass, Mesh, MirrorArray, Rig
from kiriko.core.settings import Settings

from . import closed_forms
from .reference_rigs import box, rig

EPS = np.finfo(float).eps
DIGITS = 50
# k, the square of the cosine behind a face: from here on an
# error may be EXACT, below it 4 eps / sqrt k
STEEP = 1e-6
EXACT = 1e-12
SAME_CLASS = (
    1e-14  # rad: beyond this from the critical angle it is known whether light is totally reflected
)

exactly = np.frompyfunc(mpmath.mpf, 1, 1)
sqrt = np.frompyfunc(mpmath.sqrt, 1, 1)
atan2 = np.frompyfunc(mpmath.atan2, 2, 1)
asin = np.frompyfunc(mpmath.asin, 1, 1)


class Verdict(NamedTuple):
    """What was judged in how many cases; worst error where the
    problem is a good one, and worst part of a mark.

    error: relative, where k > STEEP; part: of its mark, of all cases; where: the case with that
    part; n_wrong: cases of the wrong class that rounding does not explain; off: the furthest that a
    case of the wrong class was from where classes part, rad or m
    """

    what: str
    n_cases: int
    error: float
    part: float
    where: str
    n_wrong: int
    off: float

    @property
    def is_kept(self) -> bool:
        return self.part <= 1 and self.n_wrong == 0


def mark(k: np.ndarray) -> np.ndarray:
    """Relative error (n,) that is allowed where k (n,) is the least squared cosine on the way."""
    return np.where(k > STEEP, EXACT, 4 * EPS / np.sqrt(np.maximum(k, EPS**2)))


def verdict(
    what: str,
    error: np.ndarray,
    k: np.ndarray,
    describe: Callable[[int], str],
    is_wrong: np.ndarray | None = None,
    off: np.ndarray | None = None,
    same: float = SAME_CLASS,
) -> Verdict:
    """Of errors (n,), NaN where there is none, with k (n,); `off`
    tells those of the wrong class from the border.
    """
    has_error = np.isfinite(error)
    part = np.where(has_error, error, 0) / mark(k)
    worst = int(np.argmax(part))
    is_wrong = np.zeros(len(error), bool) if is_wrong is None else is_wrong
    off = np.full(len(error), np.inf) if off is None else off
    wrong = np.flatnonzero(is_wrong & (off > same))
    shown = describe(int(wrong[0])) if len(wrong) else describe(worst)
    good = has_error & (k > STEEP)
    furthest = off[is_wrong].max(initial=0.0)
    return Verdict(
        what, len(error), error[good].max(initial=0.0), part[worst], shown, len(wrong), furthest
    )


class Cases(NamedTuple):
    """Errors (n,), k (n,), is_wrong and off (n,) as of `verdict`, and what the cases are."""

    error: np.ndarray
    k: np.ndarray
    is_wrong: np.ndarray
    off: np.ndarray
    text: list[str]


def gathered(
    what: str, n: int, seed: int, judged: Callable[[np.random.Generator], Cases]
) -> Verdict:
    """The verdict on rig after rig, until there are n cases."""
    random = np.random.default_rng(seed)
    parts = []
    with mpmath.workdps(DIGITS):
        while sum(len(part.error) for part in parts) < n:
            parts.append(judged(random))
    error, k, is_wrong, off, text = (np.concatenate(column) for column in zip(*parts, strict=True))
    return verdict(
        what, np.where(is_wrong, np.nan, error), k, lambda i: str(text[i]), is_wrong, off
    )


def dot(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Row-wise scalar product (n,)."""
    return (a * b).sum(axis=-1)


def unit(v: np.ndarray) -> np.ndarray:
    """Rows (n, 3) of mpmath's numbers, scaled to length 1."""
    return v / sqrt(dot(v, v))[:, None]


def far_from(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Distance (n,) float64 between rows of numbers (n, 3), either of them mpmath's."""
    with np.errstate(
        invalid="ignore"
    ):  # what is totally reflected has no place behind the face: NaN
        return np.linalg.norm((a - b).astype(float), axis=1)


def random_indices(random: np.random.Generator, n: int) -> tuple[np.ndarray, np.ndarray]:
    """Pairs of indices (n,): air and glass, up to 4, and such that differ by 1e-12 to 1e-3.

    Either way round.
    """
    low = np.where(random.random(n) < 0.5, 1.0, random.uniform(1, 2, n))
    ratio = np.select(
        [np.arange(n) % 3 == 0, np.arange(n) % 3 == 1],
        [random.uniform(1.3, 1.9, n), 1 + 10 ** random.uniform(-12, -3, n)],
        4 ** random.random(n),
    )
    pair = np.stack([low, np.minimum(low * ratio, 4.0)], axis=1)
    return tuple(random.permuted(pair, axis=1).T)


def random_angles(random: np.random.Generator, n1: np.ndarray, n2: np.ndarray) -> np.ndarray:
    """Angles of incidence (n,) rad: any, near the critical one, grazing, near normal and normal."""
    n = len(n1)
    nearly = 10 ** random.uniform(-15, -3, n) * random.choice([-1, 1], n)
    grazing = np.pi / 2 - np.radians(10 ** random.uniform(-6, -1, n))
    critical = np.where(n1 > n2, np.arcsin(np.minimum(n2 / n1, 1)) + nearly, grazing)
    normal = np.where(random.random(n) < 0.5, 0.0, 10 ** random.uniform(-16, -3, n))
    angle = np.choose(
        random.integers(0, 4, n), [np.arccos(random.random(n)), critical, grazing, normal]
    )
    return np.clip(angle, 0, np.radians(90 - 1e-6))


def random_frames(random: np.random.Generator, n: int) -> tuple[np.ndarray, np.ndarray]:
    """Unit normals (n, 3) and unit vectors across them."""
    normals = closed_forms.unit(random.normal(size=(n, 3)))
    return normals, closed_forms.unit(np.cross(normals, random.normal(size=(n, 3))))


# refraction at given normals


def snell(
    d: np.ndarray, normals: np.ndarray, n1: np.ndarray, n2: np.ndarray
) -> tuple[np.ndarray, ...]:
    """Refraction of exact d at exact normals against it, by angles.

    Returns the direction (n, 3), NaN where light is totally reflected, cos^2 behind the face (n,),
    negative there, and by how much the angle is beyond the critical one (n,), rad.
    """
    across = d + (-dot(d, normals))[:, None] * normals
    cosine = -dot(d, normals)
    sine = sqrt(dot(across, across))
    behind = n1 / n2 * sine
    k = (1 - behind) * (1 + behind)
    is_through = k >= 0
    depth = sqrt(np.where(is_through, k, 0 * k))
    out = (n1 / n2)[:, None] * across - depth[:, None] * normals
    out[~is_through] = mpmath.nan
    # sines beyond 1 have no angle; the critical angle is then 90 degrees and more away
    critical = asin(np.where(n2 < n1, n2 / n1, 1 + 0 * n1))
    beyond = np.where(n2 < n1, atan2(sine, cosine) - critical, -mpmath.pi)
    return out, k, beyond.astype(float)


def transmitted(
    cos1: np.ndarray, cos2: np.ndarray, sin1: np.ndarray, sin2: np.ndarray
) -> np.ndarray:
    """Fresnel's equations in their form with sines and tangents: unpolarised transmittance.

    Not at normal incidence.
    """
    sin_sum = sin1 * cos2 + cos1 * sin2
    sin_less = sin1 * cos2 - cos1 * sin2
    cos_sum = cos1 * cos2 - sin1 * sin2
    cos_less = cos1 * cos2 + sin1 * sin2
    s = (sin_less / sin_sum) ** 2
    p = s * (cos_sum / cos_less) ** 2
    return 1 - (s + p) / 2


def judge_refraction(n: int, seed: int = 0) -> list[Verdict]:
    """core.light.optics.refract: direction, class, transmittance."""
    random = np.random.default_rng(seed)
    n1, n2 = random_indices(random, n)
    angle = random_angles(random, n1, n2)
    normals, across = random_frames(random, n)
    directions = closed_forms.unit(
        np.sin(angle)[:, None] * across - np.cos(angle)[:, None] * normals
    )
    out, is_tir, transmittance = refract(directions, normals, n1, n2)

    def describe(i: int) -> str:
        return f"n {n1[i]:.17g} to {n2[i]:.17g} at {np.degrees(angle[i]):.17g} deg"

    with mpmath.workdps(DIGITS):
        m1 = exactly(n1)
        m2 = exactly(n2)
        d = unit(exactly(directions))
        m = unit(exactly(normals))
        exact, k, beyond = snell(d, m, m1, m2)
        error = far_from(exact, out)
        found = verdict(
            "refraction", error, k.astype(float), describe, is_tir != (k < 0), np.abs(beyond)
        )
        some = np.flatnonzero(~is_tir & (k > 0))
        d = d[some]
        m = m[some]
        m1 = m1[some]
        m2 = m2[some]
        cos1 = -dot(d, m)
        cos2 = sqrt(k[some])
        along = d + cos1[:, None] * m
        sin1 = sqrt(dot(along, along))
        given = sin1 > 0
        sin1 = np.where(given, sin1, sin1 + 1)
        fresnel = transmitted(cos1, cos2, sin1, sin1 * m1 / m2)
        plain = 1 - ((m1 - m2) / (m1 + m2)) ** 2
        # the transmittance's own slope against the cosine
        # behind the face, which alone is held to the mark
        slope = 2 * (m1 / m2 + m2 / m1) / cos1
        error = np.abs(
            ((np.where(given, fresnel, plain) - transmittance[some]) / (1 + slope)).astype(float)
        )
    return [
        found,
        verdict("transmittance", error, k[some].astype(float), lambda i: describe(some[i])),
    ]


# stacks of slabs: layers of glass side by side, or one inside another

PER_RIG = 400  # rays
OUT_OF_THE_WAY = {
    "distance": 1e3,
    "plate": 1e-5,
    "display": 1e-5,
}  # of what is judged where it leaves the glass
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
    """What becomes of light: place and direction (n, 3) of its end
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
    plan = make_plan(rig(stack.glasses, **OUT_OF_THE_WAY), Settings())
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


def named(glass: object, o: np.ndarray, d: np.ndarray) -> list[str]:
    """What the cases are, for whoever wants to see one again."""
    return [f"{glass}, from {a.tolist()} along {b.tolist()}" for a, b in zip(o, d, strict=True)]


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
    landings = trace_all(make_plan(a_rig, Settings()), o, d)
    error = far_from(landing(a_rig, path.places, path.directions), landings.positions)
    error /= np.linalg.norm(o, axis=1) + HALF
    return Cases(error, path.k, ~landings.has_arrived, path.off, named(stack, o, d))


def judge_landings(n: int, seed: int = 0) -> list[Verdict]:
    """core.light.trace through stacks of slabs and the ideal
    plate to the display, from 0.1 m to 1 km away.
    """
    return [gathered("landing behind slabs and plate", n, seed, onto_the_display)]


# a prism: faces that are not parallel, total reflection inside

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
    index = random.choice([
        random.uniform(1.3, 2), random.uniform(2, 4), random.uniform(0.5, 0.95),
        1 + random.choice([-1, 1]) * 10 ** random.uniform(-12, -3),
    ])  # fmt: skip
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
    place = np.hstack([
        (1 - t) * a[side] + t * a[(side + 1) % 3], random.uniform(-0.4, 0.4, (n, 1)) * prism.height
    ])  # fmt: skip
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
    landings = trace_all(make_plan(rig((glass,), **OUT_OF_THE_WAY), Settings()), o, d)
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


# a ball


def through_ball(
    o: np.ndarray, d: np.ndarray, radius: np.ndarray, index: np.ndarray
) -> tuple[np.ndarray, ...]:
    """Both roots of the ball's equation, the radius as normal: two
    places and two directions (n, 3); k, beyond (n,).
    """
    middle = -dot(o, d)
    first = o + (middle - sqrt(middle**2 - dot(o, o) + radius**2))[:, None] * d
    one = 0 * index + 1
    inside, k, beyond = snell(d, first / radius[:, None], one, index)
    last = first - 2 * dot(first, inside)[:, None] * inside
    out, k_out, _ = snell(inside, -last / radius[:, None], index, one)
    with np.errstate(
        invalid="ignore"
    ):  # what is totally reflected has no place behind the ball: NaN
        return first, last, inside, out, np.fmin(k.astype(float), k_out.astype(float)), beyond


def judge_balls(n: int, seed: int = 0) -> list[Verdict]:
    """The tests' closed form of a ball, and optics.refract at
    its two normals, from 1.001 radii to 10 km away.
    """
    random = np.random.default_rng(seed)
    radius = 10 ** random.uniform(-3, 0, n)
    index = random_indices(random, n)
    index = index[0] / index[1]
    beside = np.choose(random.integers(0, 4, n), [
        np.sqrt(random.random(n)), 1 - 10 ** random.uniform(-12, -1, n), 10 ** random.uniform(-16,
        -3, n),
        np.clip(index * (1 + 10 ** random.uniform(-15, -3, n) * random.choice([-1, 1], n)), 0,
        1 - 1e-12),
    ])  # fmt: skip
    d, across = random_frames(random, n)
    far = radius * np.maximum(1.001, 10 ** random.uniform(-3, 4, n) / radius)
    o = (beside * radius)[:, None] * across - far[:, None] * d
    scale = 1 + far / radius  # a rounding of where light comes from, in parts of the radius
    with mpmath.workdps(DIGITS):
        exact_o = exactly(o)
        exact_d = unit(exactly(d))
        r = exactly(radius)
        meets = dot(exact_o, exact_o) - dot(exact_o, exact_d) ** 2 < r**2
    o, d, radius, index, scale, exact_o, exact_d, r = (
        column[meets] for column in (o, d, radius, index, scale, exact_o, exact_d, r)
    )
    with np.errstate(invalid="ignore"):
        places, directions = closed_forms.through_ball(o, d, radius, index)

    def describe(i: int) -> str:
        return (
            f"ball {radius[i]:.17g}, index {index[i]:.17g}, from {o[i].tolist()} along"
            f" {d[i].tolist()}"
        )

    with mpmath.workdps(DIGITS):
        first, last, inside, out, k, beyond = through_ball(exact_o, exact_d, r, exactly(index))
        is_tir = k < 0
        is_wrong = np.isnan(places[:, 0]) != is_tir
        error = np.maximum(far_from(places, last) / radius, far_from(directions, out)) / scale
        # as a distance from the axis: what light from far away is off
        # by there is the more in angle the more it grazes
        off = np.abs(beyond) * np.sqrt(1 - np.minimum(index, 1) ** 2) / scale
        closed = verdict("ball, closed form", error, k, describe, is_wrong, off)
        one = np.ones(len(o))
        with np.errstate(invalid="ignore"):
            m1 = closed_forms.unit(first.astype(float))
            m2 = -closed_forms.unit(last.astype(float))
        within, is_mirrored, _ = refract(d, m1, one, index)
        m2[is_tir] = -within[is_tir]
        left, never, _ = refract(closed_forms.unit(within), m2, index, one)
        error = np.maximum(far_from(within, inside), far_from(left, out)) / scale
        is_wrong = (is_mirrored != is_tir) | never & ~is_tir
        refracted = verdict(
            "ball, refracted at its normals", error, k, describe, is_wrong, np.abs(beyond) / scale
        )
    return [closed, refracted]


# the mirror array

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
    cosine = np.choose(random.integers(0, 3, n), [
        random.random(n), np.sin(np.radians(10 ** random.uniform(-6, -1, n))),
        1 - 10 ** random.uniform(-16, -3, n),
    ])  # fmt: skip
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
    and in which direction light comes out, after what.

    Light that passes a mirror's edge nearer than rounding, in parts of the way, may go either way.
    """
    return [gathered("mirror array", n, seed, through_one_array)]


JUDGES = (judge_refraction, judge_balls, judge_stacks, judge_landings, judge_prisms, judge_arrays)
