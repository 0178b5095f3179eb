"""Closed forms of the surfaces that meshes stand for, and the display error of a mesh against them.

The rig is reference_rigs.rig with a display of 0.2 m and 512 px. Judged are those of 20 000 random
rays that, by the closed form, are far from grazing and from edges and land in the display's middle,
80 % of its side: the same rays for all meshes. Rays that a mesh loses are left out of its errors.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache

import numpy as np
from numpy.typing import NDArray

from kiriko.core.light.compile_plan import make_plan
from kiriko.core.light.trace import trace_all
from kiriko.core.rig.rig import Mesh, Rig
from kiriko.core.rig.settings import Settings
from known import closed_forms
from known.reference_rigs import mean_normals, rig, torus, uv_ellipsoid, wavy_slab

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
        make_plan(drawn(shape, segments, kind, mean), Settings()), rays.origins, rays.directions
    )
    return np.linalg.norm(landings.xy - rays.xy, axis=1)


def rms(px: Floats) -> float:
    """Root of the mean square of the distances that are known."""
    return float(np.sqrt(np.nanmean(px**2)))


def errors(shape: str, segments: int, kind: str, mean: bool = False) -> float:
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
