"""Display error of glass from artists, by each choice of *Surface*, against the intended surface:
the limit of Subdivision, or the lathe of the same profile: `dev.py meant`.

Wine glass and bottle are Blender's, by one and two levels of Subdivision (`--levels-3`: by three);
the judge is the limit of the same cage by known/catmull_clark.py. The rings of 24 steps, with
several numbers of points around an uneven profile, and the bodies that end on their axis are judged
likewise. The vase is a quartic curve through its profile's points, at several densities, with 32
steps around. Normals are means, and the judge's own are exact.

Errors are in display px (median, rms, 99 %, and the number of lost rays), of random rays where the
judge's map is smooth: light one viewer pixel away, in each direction, lands on the display, too,
less than 10 px away and within 1 px of a linear map. The first row of a glass: difference of judges
with four times fewer triangles, and with four times more in facets, at 50 and 99 % of the rays.
`curved`: fraction of the triangles that *Automatic* treats as curved; `worse`: px rms, excess error
over the better of the other two.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import bpy
import numpy as np
from mathutils import Matrix
from numpy.polynomial import Polynomial
from numpy.typing import NDArray

from kiriko.core.light.compile_plan import compile_plan
from kiriko.core.light.plan import Plan
from kiriko.core.light.trace import trace_all
from kiriko.core.rig.rig import Mesh
from kiriko.core.rig.settings import Settings
from known import catmull_clark
from known.catmull_clark import Cage, limit_mesh
from known.judged_meshes import CHOICES
from known.reference_rigs import glass_rig, mean_normals, split_quads

from . import brought_glass as glasses
from .runner import Bench, Row, run

Floats = NDArray[np.float64]

RAYS = 20_000
STRETCH = 10.0  # display px a viewer pixel, at the most
BENT = 1.0  # display px, from where light a pixel aside on both sides lets it be expected
WALL = 0.002  # m, of the vase
STEPS = 32
RINGS = {4: 0, 5: 2, 6: 1, 8: 1}  # seeds of profiles of so many points
LATHES = 12, 24


def subdivided(name: str, levels: int) -> tuple[bpy.types.Object, Matrix]:
    """A glass whose last modifier is Subdivision, and its place on the bench."""
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    thing = glasses.GLASSES[name]()
    # as `made` places it, whatever the level
    place = glasses.place_of(name, thing)
    thing.modifiers[-1].levels = levels
    return thing, place


def as_drawn(name: str, levels: int) -> Mesh:
    """Blender's evaluated mesh."""
    return glasses.evaluated(*subdivided(name, levels))


def as_meant(name: str, levels: int) -> Mesh:
    """The limit of its cage, with its own normals."""
    thing, place = subdivided(name, 0)
    thing.modifiers[-1].show_viewport = False
    bpy.context.view_layer.update()
    result = thing.evaluated_get(bpy.context.evaluated_depsgraph_get())
    cage = cage_of(result.to_mesh())
    result.to_mesh_clear()
    matrix = np.array(place)
    return limit_mesh(
        replace(cage, vertices=cage.vertices @ matrix[:3, :3].T + matrix[:3, 3]), levels
    )


def cage_of(data: bpy.types.Mesh) -> Cage:
    """The faces of a mesh of Blender's."""
    vertices = np.empty((len(data.vertices), 3))
    sizes = np.empty(len(data.polygons), int)
    start = np.empty(len(data.loops), int)
    data.vertices.foreach_get("co", vertices.ravel())
    data.polygons.foreach_get("loop_total", sizes)
    data.loops.foreach_get("vertex_index", start)
    return Cage.of(vertices, sizes, start)


def vase(points: int, steps: int, own: bool) -> Mesh:
    """The vase of so many points along its curve, with its own normals or means; sharp rims."""
    profile = np.array(glasses.VASE)
    chords = np.linalg.norm(np.diff(profile, axis=0), axis=1)
    at = np.concatenate([[0], np.cumsum(chords)]) / chords.sum()
    curves = [Polynomial.fit(at, x, len(at) - 1) for x in profile.T]
    t = np.linspace(0, 1, points)
    outer = np.stack([curve(t) for curve in curves], axis=1)
    along = np.stack([curve.deriv()(t) for curve in curves], axis=1)
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    away = along[:, ::-1] * [1, -1]
    places = np.concatenate([outer, (outer - WALL * away)[::-1]])
    places[:, 1] -= profile[:, 1].mean()

    # strips between sharp edges: rows of the places, and their normals
    rows = np.arange(len(places))
    up = along[[-1, -1]]
    down = -along[[0, 0]]
    strips = [
        (rows[:points], away),
        (rows[points - 1 : points + 1], up),
        (rows[points:], -away[::-1]),
        (rows[[-1, 0]], down),
    ]
    a = 2 * np.pi * np.arange(steps) / steps

    def turned(of_profile: Floats) -> Floats:
        radius, height = of_profile.T[..., None]
        return np.stack(np.broadcast_arrays(radius * np.cos(a), radius * np.sin(a), height), -1)

    vertices = turned(places).reshape(-1, 3)
    triangles, normals = [], []
    for row, normal in strips:
        index = row[:, None] * steps + np.arange(steps)
        faces = split_quads(np.concatenate([index, index[:, :1]], axis=1))[:, ::-1]
        of_vertex = np.zeros_like(vertices)
        of_vertex[index.ravel()] = turned(normal).reshape(-1, 3)
        strip = Mesh(vertices, faces, of_vertex[faces], np.ones(len(faces), bool))
        triangles.append(faces)
        normals.append((strip if own else mean_normals(strip)).corner_normals)

    faces = np.concatenate(triangles)
    mesh = Mesh(vertices, faces, np.concatenate(normals), np.ones(len(faces), bool))
    return mesh if own else replace(mesh, has_mean_normals=True)


@dataclass(frozen=True)
class Meant:
    """A glass: the kinds of its mesh; the mesh of a kind; and its judge, from coarse to fine."""

    kinds: tuple[int, ...]
    mesh: Callable[[int], Mesh]
    judge: Callable[[int], Mesh]


def all_meant(levels: int) -> dict[str, Meant]:
    """The glasses by name, by so many levels of Subdivision at the most."""
    kinds = tuple(range(1, levels + 1))
    by_levels = {
        name: Meant(
            kinds,
            lambda k, name=name: as_drawn(name, k),
            lambda k, name=name: as_meant(name, levels + k),
        )
        for name in ("wine glass", "bottle")
    }
    cages = {
        f"ring of {points}": catmull_clark.ring_cage(catmull_clark.uneven_profile(seed, points), 24)
        for points, seed in RINGS.items()
    }
    for steps in LATHES:
        cages[f"lathe of {steps}"] = catmull_clark.lathe_cage(catmull_clark.LATHE, steps)
    by_cages = {
        name: Meant(
            kinds,
            lambda k, cage=cage: mean_normals(limit_mesh(cage, k)),
            lambda k, cage=cage: limit_mesh(cage, levels + k),
        )
        for name, cage in cages.items()
    }
    by_points = Meant(
        (5, 9, 17, 33),
        lambda points: vase(points, STEPS, own=False),
        lambda k: vase(64 * 2**k + 1, 2 * STEPS * 2**k, own=True),
    )
    return by_levels | by_cages | {"vase": by_points}


def planned(mesh: Mesh, choice: str) -> Plan:
    """The bench with a mesh, by one choice of surface."""
    return compile_plan(glass_rig(replace(mesh, surface=choice)), Settings())


def landings(plan: Plan, xy: Floats) -> Floats:
    """Where light lands on the display (n, 2), px, by places (n, 2) in the viewer; NaN if not."""
    found = trace_all(plan, *plan.rig.viewer.rays(xy))
    inside, _ = found.pixels(plan.rig.display.width, plan.rig.display.height)
    landed = np.full((len(xy), 2), np.nan)
    landed[found.sample[inside]] = found.xy[inside]
    return landed


def is_smooth_map(plan: Plan, xy: Floats, landed: Floats) -> NDArray[np.bool_]:
    """Whether the map is smooth at viewer positions (n, 2) with landings (n, 2)."""
    is_smooth = np.ones(len(xy), bool)
    for step in np.eye(2):
        back, on = (landings(plan, xy + way * step) for way in (-1, 1))
        is_smooth &= apart(on, back) < 2 * STRETCH  # not where one is NaN
        is_smooth &= apart(on + back, 2 * landed) < 2 * BENT
    return is_smooth


def apart(a: Floats, b: Floats) -> Floats:
    """Distances (n,), NaN where either is unknown."""
    return np.linalg.norm(a - b, axis=1)


def measure(name: str, meant: Meant, _: argparse.Namespace) -> Iterator[Row]:
    """Difference of the judges, then the errors of a glass's meshes by each choice."""
    xy = np.random.default_rng(3).uniform(1, 511, (RAYS, 2))
    judge = planned(meant.judge(1), "smooth")
    exact = landings(judge, xy)
    is_judged = is_smooth_map(judge, xy, exact)
    xy, exact = xy[is_judged], exact[is_judged]
    coarser = planned(meant.judge(0), "smooth"), planned(meant.judge(2), "facets")
    off = (np.nanquantile(apart(exact, landings(plan, xy)), (0.5, 0.99)) for plan in coarser)
    yield {"kind": "judge", "rays": len(xy)} | {
        choice: f"{half:.2g} and {most:.2g}"
        for choice, (half, most) in zip(("coarser", "by facets"), off, strict=True)
    }
    for kind in meant.kinds:
        mesh = meant.mesh(kind)
        row: Row = {"kind": str(kind), "triangles": len(mesh.triangles)}
        rms = []
        for choice in CHOICES:
            plan = planned(mesh, choice)
            px = apart(exact, landings(plan, xy))
            known = px[np.isfinite(px)]
            rms.append(float(np.sqrt((known**2).mean())))
            numbers = np.median(known), rms[-1], np.quantile(known, 0.99)
            row[choice] = " ".join(f"{x:8.3g}" for x in numbers) + f"{len(px) - len(known):6d}"
        row["curved"] = sum(plan.counts.n_curved) / len(mesh.triangles)
        yield row | {"worse": rms[2] - min(rms[:2])}


COLUMNS = {
    "kind": "d", "triangles": "d", **dict.fromkeys(CHOICES, ""), "curved": ".2f", "worse": ".3f",
    "rays": "d", "coarser": ">13", "by facets": ">13",
}  # fmt: skip

if __name__ == "__main__":
    tables = (Bench(all_meant(n), COLUMNS, measure) for n in (2, 3))
    run(__doc__, "bench.meant", next(tables), levels_3=next(tables))
