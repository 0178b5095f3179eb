"""Display error of irregular, noisy and regular meshes by each choice of *Surface*, against closed
forms of the surface that was meant: `dev.py irregular`.

Rays and errors are those of surface.py. Vertices are moved by up to a part of an edge (aside) and
put back onto the surface, and then off it as a scanner's are, by a part of the size (noise); or
Blender's modifiers make a mesh anew: Decimate, Remesh by voxels, Decimate after noise as on a scan;
or it is the convex hull of random places; or it is regular and coarse, of so many segments around,
or segments and rings. Normals are Blender's means. For each choice of *Surface*: median, rms, rms
without the ten worst rays (they go another way, or leave at a grazing angle), 99 %. `curved`: part
of the triangles that *Automatic* follows as curved. `worse`: px rms by which it is further off than
the better of the others. `told`: the error that the result tells of *Automatic*. `away`: part of
the light that *Smooth* would send another way where the mesh is too coarse to tell which is right.

`--regular`: rms of facets with their own normals, with interpolated ones, and of curved faces.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import partial
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from kiriko.core.base.steps import finish
from kiriko.core.light.compile_plan import make_plan
from kiriko.core.light.trace import trace_all
from kiriko.core.rig.rig import Mesh, SurfaceChoice
from kiriko.core.rig.settings import Settings
from kiriko.core.solve.tessellation import tessellation
from known.reference_rigs import icosphere, mean_normals, rig, torus, uv_ellipsoid

from .runner import Bench, Row, run
from .surface import (
    BALL,
    BLENDERS,
    BLENDERS_TORUS,
    ELLIPSOID,
    KINDS,
    LENTIL,
    OPTIONS,
    SHAPES,
    TORUS,
    drawn,
    judged,
)
from .surface import errors as rms_of

Floats = NDArray[np.float64]

CHOICES: tuple[SurfaceChoice, ...] = ("facets", "smooth", "automatic")
# of an edge along the surface, of the size off it
DISTURBED = (
    *((aside, 0.0) for aside in (0.0, 0.1, 0.2, 0.3)),
    *((0.0, noise) for noise in (1e-6, 1e-5, 3e-5, 1e-4, 1e-3, 1e-2)),
    *((0.2, 1e-5), (0.2, 1e-3)),
)
SEGMENTS = 32, 64, 128, 256
SEED = 6
THINNED = {"kind": "DECIMATE", "ratio": 1 / 16}
VOXELS = {"kind": "REMESH", "mode": "VOXEL", "voxel_size": 0.0015, "use_smooth_shade": True}


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


FINE, MEDIUM = 6, 4  # times that a ball of 20 triangles is divided, or tori are as fine
TORI = {"torus": (TORUS, 4, 2), "Blender's torus": (BLENDERS_TORUS, 6, 1.5)}
BALLS = {"ball": BALL, "ellipsoid": ELLIPSOID, "lentil": LENTIL}


def divided(shape: str, times: int) -> Mesh:
    """A shape in even triangles, divided so many times."""
    if shape in BALLS:
        return icosphere(BALLS[shape], times)
    radii, around, across = TORI[shape]
    return torus(*radii, around * 2**times, int(across * 2**times))


# a shape, how fine a mesh of it is, its noise, of the size, and the modifier that makes it anew
REBUILT: dict[str, tuple[str, int, float, dict[str, object]]] = {
    f"{shape}, {kind}": (shape, times, noise, options)
    for shape in (*BALLS, *TORI)
    for kind, times, noise, options in (
        ("decimated", FINE, 0.0, THINNED),
        ("dec. to 1/64", FINE, 0.0, THINNED | {"ratio": 1 / 64}),
        ("dec. to 0.4", MEDIUM, 0.0, THINNED | {"ratio": 0.4}),
        ("remeshed", FINE, 0.0, VOXELS),
        ("scanned", FINE, 2e-4, THINNED),
    )
}

# a shape, the number of random places on it, and noise, of the size
HULLS: dict[str, tuple[str, int, float]] = {
    f"{shape}, hull of {n}": (shape, n, noise)
    for shape in BALLS
    for n, noise in ((120, 0.0), (250, 0.0), (500, 0.0), (800, 1e-4), (2000, 0.0))
}

# shapes of regular meshes, and their segments, or segments and rings
COARSE: dict[str, tuple[int | tuple[int, int], ...]] = {
    "ball": (8, 9, 12),
    "ellipsoid": (
        *(8, 9, 10, 11, 12, 13, 14, 15, 16),
        *((8, 6), (8, 12), (9, 6), (9, 9), (10, 7), (12, 5), (12, 9), (16, 6)),
    ),
    "lentil": (12, 16, 17, 20, 24, (8, 12), (11, 8)),
    "torus": (12, 13, 16, 20, 24, (16, 6), (16, 7), (24, 6)),
    "Blender's torus": (32, 48),
    "wavy slab": (16, 24, 32),
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


def rebuilt(name: str) -> Mesh:
    """A fine mesh, made anew by one of Blender's modifiers."""
    # needs Blender, which tests of core that read this file do without
    from . import brought_glass as glasses

    shape, times, noise, options = REBUILT[name]
    fine = divided(shape, times)
    random = np.random.default_rng(SEED)
    away = noise * np.ptp(fine.bounds, axis=0).max() / 2 * random.normal(size=fine.vertices.shape)
    return glasses.rebuilt(replace(fine, vertices=fine.vertices + away), **options)


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
    plan = make_plan(rig(replace(mesh, surface=choice), **OPTIONS), Settings())
    px = np.linalg.norm(trace_all(plan, rays.origins, rays.directions).xy - rays.xy, axis=1)
    arrived = np.sort(px[np.isfinite(px)])
    rms, rest = (float(np.sqrt((x**2).mean())) for x in (arrived, arrived[:-10]))
    median, p99 = (float(np.quantile(arrived, q)) for q in (0.5, 0.99))
    curved = sum(plan.counts.n_curved) / len(mesh.triangles)
    return Errors(median, rms, rest, p99, len(px) - len(arrived), curved)


Meshes = Iterator[tuple[str, str, Mesh]]  # what was done, shape, mesh


def disturbances(name: str) -> Meshes:
    """A mesh, disturbed in several ways."""
    for aside, noise in DISTURBED:
        yield f"{aside:g} {noise:g}", MESHES[name][0], disturbed(name, aside, noise)


def one(shape: str, make: Callable[[], Mesh]) -> Meshes:
    """A mesh that stands for a shape."""
    yield "", shape, make()


def coarse_ones(shape: str) -> Meshes:
    """Regular meshes of a shape."""
    for segments in COARSE[shape]:
        plain = f"{segments}" if isinstance(segments, int) else "{} x {}".format(*segments)
        yield plain, shape, coarse(shape, segments)
    if shape == "torus":
        yield "24 x 12, sheared", shape, sheared(shape, 24, 12)


def measure(_: str, meshes: Callable[[], Meshes], __: argparse.Namespace) -> Iterator[Row]:
    """The errors of each mesh by each choice."""
    for done, shape, mesh in meshes():
        row: Row = {"mesh": done}
        found = [errors(shape, mesh, choice) for choice in CHOICES]
        for choice, e in zip(CHOICES, found, strict=True):
            row[choice] = " ".join(f"{x:8.3g}" for x in (e.median, e.rms, e.rest, e.p99))
        drawn_rms, smooth_rms, rms = (e.rms for e in found)
        row |= {"curved": found[-1].curved, "worse": rms - min(drawn_rms, smooth_rms)}
        mesh = replace(mesh, surface="automatic")
        reported = finish(tessellation(make_plan(rig(mesh, **OPTIONS), Settings())))
        yield row | {"told": reported.error, "away": reported.coarse.elsewhere}


def measure_regular(shape: str, kinds: tuple[str, ...], _: argparse.Namespace) -> Iterator[Row]:
    """The errors of finer and finer meshes."""
    for segments in SEGMENTS:
        n_triangles = len(drawn(shape, segments, kinds[0]).glasses[0].mesh.triangles)
        yield {"triangles": n_triangles} | {kind: rms_of(shape, segments, kind) for kind in kinds}


CASES = {
    **{name: partial(disturbances, name) for name in MESHES},
    **{name: partial(one, REBUILT[name][0], partial(rebuilt, name)) for name in REBUILT},
    **{name: partial(one, HULLS[name][0], partial(hull, *HULLS[name])) for name in HULLS},
    **{f"{shape}, coarse": partial(coarse_ones, shape) for shape in COARSE},
}
COLUMNS = {
    "mesh": "", **dict.fromkeys(CHOICES, ""), "curved": ".3f", "worse": ".3f", "told": ".3g",
    "away": ".3f",
}  # fmt: skip

if __name__ == "__main__":
    run(
        __doc__,
        "bench.irregular",
        Bench(CASES, COLUMNS, measure),
        regular=Bench(
            dict.fromkeys(SHAPES, KINDS),
            {"triangles": "d", **dict.fromkeys(KINDS, ".3g")},
            measure_regular,
        ),
    )
