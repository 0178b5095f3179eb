"""Meshes that stand for surfaces of closed form, and their display errors.

The rig is reference_rigs.rig with a display of 0.2 m and 512 px. Judged are those of 20 000 random
rays that, by the closed form, are far from grazing and from edges and land in the display's middle,
80 % of its side: the same rays for all meshes. Rays that a mesh loses are left out of its errors.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from kiriko.core.light.compile_plan import compile_plan
from kiriko.core.light.trace import trace_all
from kiriko.core.rig.rig import Mesh, Rig, SurfaceChoice
from kiriko.core.rig.settings import Settings

from . import closed_forms
from .reference_rigs import icosphere, mean_normals, rig, torus, uv_ellipsoid, wavy_slab

Floats = NDArray[np.float64]

N = 1.49
RAYS = 20_000
# |cos| to the normal, in or out: nearer to grazing,
# facets send single rays anywhere and rule the rms
GRAZING = 0.3
MIDDLE = 0.8  # of the display's side: so far from its border a landing is judged
OPTIONS = {"display": 0.2, "display_pixels": 512, "ior": N}
BALL = (0.025,) * 3
ELLIPSOID = (0.025, 0.020, 0.015)
TORUS = (0.018, 0.007)
LENTIL = (0.025, 0.025, 0.012)
BLENDERS_TORUS = (0.020, 0.005)  # of the proportions that Add > Mesh > Torus gives it
FLOOR = 1e-6  # px: below, rounding and the end of the Newton steps set the error, not the mesh


@dataclass(frozen=True)
class Shape:
    """A solid: its mesh of some segments x half as many rings (x 2
    sides, for the slab), rays through it exactly.
    """

    mesh: Callable[[int], Mesh]
    through: Callable[[Floats, Floats], tuple[Floats, Floats, NDArray[np.bool_]]]


def through_ellipsoid(
    o: Floats, d: Floats, radii: tuple[float, ...]
) -> tuple[Floats, Floats, NDArray[np.bool_]]:
    """The closed form, and which rays neither enter nor leave at a grazing angle."""
    p, e = closed_forms.through_ellipsoid(o, d, radii, N)
    # light goes back the way it came
    entry, _ = closed_forms.through_ellipsoid(p + e, -e, radii, N)
    normals = (closed_forms.unit(at / np.square(radii)) for at in (entry, p))
    slopes = [
        np.abs((ray * normal).sum(axis=1)) for ray, normal in zip((d, e), normals, strict=True)
    ]
    return p, e, np.minimum(*slopes) > GRAZING


SHAPES = {
    "ball": Shape(
        lambda s: uv_ellipsoid(BALL, s, s // 2, pole=1), lambda o, d: through_ellipsoid(o, d, BALL)
    ),
    "ellipsoid": Shape(
        lambda s: uv_ellipsoid(ELLIPSOID, s, s // 2),
        lambda o, d: through_ellipsoid(o, d, ELLIPSOID),
    ),
    "torus": Shape(
        lambda s: torus(*TORUS, s, s // 2),
        lambda o, d: closed_forms.through_torus(o, d, *TORUS, N, GRAZING),
    ),
    "wavy slab": Shape(
        lambda s: wavy_slab(s // 2, 0.075, 0.02, 0.001),
        lambda o, d: closed_forms.through_wavy_slab(o, d, 0.075, 0.02, 0.001, N, GRAZING),
    ),
}
# judged elsewhere only: the torus is of some segments x a quarter as many around the tube
BLENDERS = {
    "lentil": Shape(
        lambda s: uv_ellipsoid(LENTIL, s, s // 2), lambda o, d: through_ellipsoid(o, d, LENTIL)
    ),
    "Blender's torus": Shape(
        lambda s: torus(*BLENDERS_TORUS, s, s // 4),
        lambda o, d: closed_forms.through_torus(o, d, *BLENDERS_TORUS, N, GRAZING),
    ),
}
KINDS = ("facet normals", "interpolated normals", "curved faces")


@dataclass(frozen=True)
class Judged:
    """Rays (n, 3) with exact landings (n, 2), display px."""

    origins: Floats
    directions: Floats
    xy: Floats


@cache
def judged(shape: str) -> Judged:
    """The rays that all meshes of a shape are judged by."""
    solid = (SHAPES | BLENDERS)[shape]
    a_rig = rig(solid.mesh(16), **OPTIONS)
    viewer, display = a_rig.viewer, a_rig.display
    o, d = viewer.rays(
        np.random.default_rng(3).uniform(0, [viewer.width, viewer.height], (RAYS, 2))
    )
    p, e, is_regular = solid.through(o, d)
    xy = closed_forms.landing(a_rig, p, e)
    off = np.abs(xy / [display.width, display.height] - 0.5)
    lands = np.isfinite(p[:, 0]) & is_regular & (off < MIDDLE / 2).all(axis=1)
    return Judged(o[lands], d[lands], xy[lands])


def drawn(shape: str, segments: int, kind: str, mean: bool = False) -> Rig:
    """The rig with the shape's mesh: own or mean normals, as facets or as curved faces."""
    mesh = SHAPES[shape].mesh(segments)
    if mean:
        mesh = mean_normals(mesh)
    if kind == "facet normals":
        mesh = replace(mesh, is_smooth=None)
    mesh = replace(mesh, surface="smooth" if kind == "curved faces" else "facets")
    return rig(mesh, **OPTIONS)


def distances(shape: str, segments: int, kind: str, mean: bool = False) -> Floats:
    """Display px (n,) from each judged ray's landing to the exact one; NaN where it was lost."""
    rays = judged(shape)
    landings = trace_all(
        compile_plan(drawn(shape, segments, kind, mean), Settings()), rays.origins, rays.directions
    )
    return np.linalg.norm(landings.xy - rays.xy, axis=1)


def rms(px: Floats) -> float:
    """Root of the mean square of the distances that are known."""
    return float(np.sqrt(np.nanmean(px**2)))


def rms_error(shape: str, segments: int, kind: str, mean: bool = False) -> float:
    """Display error, rms px, of one mesh."""
    return rms(distances(shape, segments, kind, mean))


def order(triangles: list[int], px: list[float]) -> float:
    """Slope of log error against log edge (triangles^-1/2), over
    the errors above the floor; NaN if fewer than 2.
    """
    used = np.array(px) > FLOOR
    if used.sum() < 2:
        return np.nan
    return float(
        np.polyfit(-0.5 * np.log(np.array(triangles)[used]), np.log(np.array(px)[used]), 1)[0]
    )


# Irregular ones, and choices of *Surface*

CHOICES: tuple[SurfaceChoice, ...] = ("facets", "smooth", "automatic")
SEED = 6
TORI = {"torus": (TORUS, 4, 2), "Blender's torus": (BLENDERS_TORUS, 6, 1.5)}
BALLS = {"ball": BALL, "ellipsoid": ELLIPSOID, "lentil": LENTIL}


def onto_ball(places: Floats) -> Floats:
    """The nearest places on the ball."""
    return BALL[0] * places / np.linalg.norm(places, axis=1, keepdims=True)


def onto_torus(places: Floats) -> Floats:
    """The nearest places on the torus around the y axis."""
    major, minor = TORUS
    ring = places * [1, 0, 1]
    ring *= major / np.linalg.norm(ring, axis=1, keepdims=True)
    out = places - ring
    return ring + minor * out / np.linalg.norm(out, axis=1, keepdims=True)


MESHES: dict[str, tuple[str, Callable[[], Mesh], Callable[[Floats], Floats]]] = {
    "ball, 1280": ("ball", lambda: icosphere(BALL[0], 3), onto_ball),
    "ball, 5120": ("ball", lambda: icosphere(BALL[0], 4), onto_ball),
    "torus, 4096": ("torus", lambda: torus(*TORUS, 64, 32), onto_torus),
}


@dataclass(frozen=True)
class Errors:
    """Errors of one choice of surface, display px, over the rays that arrived.

    rest : rms without the ten worst; lost : rays that did not; curved : share, 0..1, of the
        triangles that are followed as curved
    """

    median: float
    rms: float
    rest: float
    p99: float
    lost: int
    curved: float


def disturbed(name: str, aside: float, noise: float) -> Mesh:
    """A mesh whose vertices were moved on its surface and off it; mean normals."""
    _, make, onto = MESHES[name]
    mesh = make()
    random = np.random.default_rng(SEED)
    edge = np.linalg.norm(mesh.corners[:, 1] - mesh.corners[:, 0], axis=1).mean()
    places = onto(mesh.vertices + aside * edge * random.uniform(-1, 1, mesh.vertices.shape))
    away = noise * np.ptp(mesh.bounds, axis=0).max() / 2
    normals = mesh.vertices.copy()
    normals[mesh.triangles] = mesh.corner_normals
    return mean_normals(
        replace(mesh, vertices=places + away * random.normal(size=(len(places), 1)) * normals)
    )


def hull(shape: str, n: int, noise: float, seed: int = SEED) -> Mesh:
    """The convex hull of so many random places on a shape, and
    then off it by a part of the size; mean normals.
    """
    random = np.random.default_rng(seed)
    places = random.normal(size=(n, 3))
    places /= np.linalg.norm(places, axis=1, keepdims=True)
    away = 1 + noise * random.normal(size=(n, 1))
    triangles = hull_of(places)
    corner_normals = np.zeros((len(triangles), 3, 3))
    is_smooth = np.ones(len(triangles), bool)
    return mean_normals(Mesh(away * places * BALLS[shape], triangles, corner_normals, is_smooth))


def hull_of(places: Floats) -> NDArray[np.int64]:
    """Triangles (t, 3) of the convex hull of places (n, 3) on the unit sphere, four of the first
    of them around its middle: each place takes away those that it sees, and joins their outline.
    """
    first = next(
        four
        for four in combinations(range(len(places)), 4)
        if (np.linalg.solve(np.c_[places[list(four)], np.ones(4)].T, [0, 0, 0, 1]) > 0).all()
    )
    triangles = np.array([list(three) for three in combinations(first, 3)])
    around = np.cross(*(places[triangles[:, k]] - places[triangles[:, 0]] for k in (1, 2)))
    is_inward = (around * places[triangles[:, 0]]).sum(axis=1) < 0
    triangles[is_inward] = triangles[is_inward][:, ::-1]

    for place in np.setdiff1d(np.arange(len(places)), first):
        at = places[triangles]
        around = np.cross(at[:, 1] - at[:, 0], at[:, 2] - at[:, 0])
        is_seen = ((places[place] - at[:, 0]) * around).sum(axis=1) > 0
        edges = triangles[is_seen][:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
        outline = edges[~np.isin(edges @ [len(places), 1], edges @ [1, len(places)])]
        added = np.c_[outline, np.full(len(outline), place)]
        triangles = np.concatenate([triangles[~is_seen], added])

    return triangles


def coarse(shape: str, segments: int | tuple[int, int]) -> Mesh:
    """A regular mesh of so many segments around, or segments and rings, with mean normals."""
    if isinstance(segments, int):
        return mean_normals((SHAPES | BLENDERS)[shape].mesh(segments))
    return mean_normals(
        uv_ellipsoid(BALLS[shape], *segments)
        if shape in BALLS
        else torus(*TORI[shape][0], *segments)
    )


def sheared(shape: str, segments: int, rings: int) -> Mesh:
    """A torus whose rings go on a segment further each, so that its quads are sheared."""
    plain = coarse(shape, (segments, rings))
    ring, segment = np.divmod(plain.triangles, segments)

    # a triangle that joins the last ring to the first goes once around the tube
    ring = np.where((ring == 0) & (ring.max(axis=1, keepdims=True) > 1), rings, ring)
    turned = ring % rings * segments + (segment + ring) % segments
    return mean_normals(replace(plain, triangles=turned))


def errors(shape: str, mesh: Mesh, choice: SurfaceChoice) -> Errors:
    """How far a mesh that stands for a shape is off by one choice of surface."""
    rays = judged(shape)
    plan = compile_plan(rig(replace(mesh, surface=choice), **OPTIONS), Settings())
    px = np.linalg.norm(trace_all(plan, rays.origins, rays.directions).xy - rays.xy, axis=1)
    arrived = np.sort(px[np.isfinite(px)])
    rms, rest = (float(np.sqrt((x**2).mean())) for x in (arrived, arrived[:-10]))
    median, p99 = (float(np.quantile(arrived, q)) for q in (0.5, 0.99))
    curved = sum(plan.counts.n_curved) / len(mesh.triangles)
    return Errors(median, rms, rest, p99, len(px) - len(arrived), curved)
