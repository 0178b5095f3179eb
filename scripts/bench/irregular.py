"""Display error of irregular, noisy and regular meshes by each choice of *Surface*, against closed
forms of the intended surface: `dev.py irregular`.

Rays and errors are those of regular meshes. The meshes are made in four ways. Vertices are moved by
up to a part of an edge (aside) and put back onto the surface, and then off it like a scanner's, by
a part of the size (noise). Blender's modifiers remake a mesh: Decimate, Remesh by voxels, Decimate
after noise as on a scan. The mesh is the convex hull of random points. Or it is regular and coarse,
with a number of segments around, or of segments and rings. Normals are Blender's means. For each
choice of *Surface*: median, rms, rms without the ten worst rays (they take another path, or leave
at a grazing angle), 99 %. `curved`: fraction of the triangles that *Automatic* treats as curved.
`worse`: px rms, excess error over the better of the others. `told`: the error that the result
reports for *Automatic*.

`--regular`: rms of facets with their own normals, with interpolated ones, and of curved faces.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from kiriko.core.base.steps import run_steps
from kiriko.core.light.compile_plan import compile_plan
from kiriko.core.rig.rig import Mesh
from kiriko.core.rig.settings import Settings
from kiriko.core.solve.tessellation import tessellation
from known.judged_meshes import (
    BALLS,
    CHOICES,
    KINDS,
    MESHES,
    OPTIONS,
    SEED,
    SHAPES,
    TORI,
    coarse,
    disturbed,
    drawn,
    errors,
    hull,
    rms_error,
    sheared,
)
from known.reference_rigs import icosphere, rig, torus

from .runner import Bench, Row, run

Floats = NDArray[np.float64]

# of an edge along the surface, of the size off it
DISTURBED = (
    *((aside, 0.0) for aside in (0.0, 0.1, 0.2, 0.3)),
    *((0.0, noise) for noise in (1e-6, 1e-5, 3e-5, 1e-4, 1e-3, 1e-2)),
    *((0.2, 1e-5), (0.2, 1e-3)),
)
SEGMENTS = 32, 64, 128, 256
THINNED = {"kind": "DECIMATE", "ratio": 1 / 16}
VOXELS = {"kind": "REMESH", "mode": "VOXEL", "voxel_size": 0.0015, "use_smooth_shade": True}


FINE, MEDIUM = 6, 4  # subdivisions of a ball of 20 triangles; tori are as fine


def divided(shape: str, times: int) -> Mesh:
    """A shape in even triangles, divided so many times."""
    if shape in BALLS:
        return icosphere(BALLS[shape], times)
    radii, around, across = TORI[shape]
    return torus(*radii, around * 2**times, int(across * 2**times))


# shape, resolution, noise as a fraction of the size, and remaking modifier
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


def rebuilt(name: str) -> Mesh:
    """A fine mesh, made anew by one of Blender's modifiers."""
    # needs Blender, but tests of core read this file without it
    from . import brought_glass as glasses

    shape, times, noise, options = REBUILT[name]
    fine = divided(shape, times)
    random = np.random.default_rng(SEED)
    away = noise * np.ptp(fine.bounds, axis=0).max() / 2 * random.normal(size=fine.vertices.shape)
    return glasses.rebuilt(replace(fine, vertices=fine.vertices + away), **options)


Meshes = Iterator[tuple[str, str, Mesh]]  # treatment, shape, mesh


def disturbances(name: str) -> Meshes:
    """A mesh, disturbed in several ways."""
    for aside, noise in DISTURBED:
        yield f"{aside:g} {noise:g}", MESHES[name][0], disturbed(name, aside, noise)


def one(shape: str, make: Callable[[], Mesh]) -> Meshes:
    """A mesh that approximates a shape."""
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
        reported = run_steps(tessellation(compile_plan(rig(mesh, **OPTIONS), Settings())))
        yield row | {"told": reported.error}


def measure_regular(shape: str, kinds: tuple[str, ...], _: argparse.Namespace) -> Iterator[Row]:
    """The errors of finer and finer meshes."""
    for segments in SEGMENTS:
        n_triangles = len(drawn(shape, segments, kinds[0]).glasses[0].mesh.triangles)
        yield {"triangles": n_triangles} | {
            kind: rms_error(shape, segments, kind) for kind in kinds
        }


CASES = {
    **{name: partial(disturbances, name) for name in MESHES},
    **{name: partial(one, REBUILT[name][0], partial(rebuilt, name)) for name in REBUILT},
    **{name: partial(one, HULLS[name][0], partial(hull, *HULLS[name])) for name in HULLS},
    **{f"{shape}, coarse": partial(coarse_ones, shape) for shape in COARSE},
}
COLUMNS = {
    "mesh": "", **dict.fromkeys(CHOICES, ""), "curved": ".3f", "worse": ".3f", "told": ".3g",
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
