"""How far off is the result, as far as it can tell by itself?"""

from collections.abc import Callable, Generator
from dataclasses import dataclass, fields, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np

from .curved import EDGE, MOST_OFFSET, N_TERMS, POWERS, CurvedFaces
from .display import display_pixel
from .meshes import areas_of
from .optics import dot
from .plan import Kind, Plan
from .ray_engine import FLOAT32, Layer
from .rig import Bools, Floats, Ints
from .trace import Landings, Step, trace

SAMPLES = 32  # rays along each side of the viewer's image
TILTED = 0.25  # of a face's tilt: normals are means of some faces, and light turns by half of what they turn
NEAR = 1e-3  # of the glass's size
WIDE = 0.5  # barycentric: faces without neighbours are followed this far beyond their edges


class Tessellation(NamedTuple):
    """What the mesh leaves open of the surface that was meant.

    Parameters
    ----------
    error : display px rms, about how far landings are from those of that surface; 0 where all is flat
    undecided : share of the light, 0..1, that passes two solids so near each other that it arrives elsewhere, or does
        not, where the curved faces are of degree 3 instead of 4: the solids have other triangles there
    """

    error: float
    undecided: float


@dataclass(frozen=True, eq=False)
class _Parabolic(CurvedFaces):
    """Curved faces, and beside them paraboloids over flat triangles, with about their bent normals (t, 3, 3).

    Rows from `first` on are paraboloids.
    """

    corner_normals: Floats | None = None
    first: int = 0

    def _is_within(self, least: Floats, row: Ints) -> Bools:
        # paraboloids have no neighbours to go on to
        return least >= np.where(row >= self.first, -WIDE, -EDGE)

    def _is_in_box(self, k: Ints, origins: Floats, directions: Floats) -> Bools:
        return super()._is_in_box(k, origins, directions) | (self.row[k] >= self.first)

    @cached_property
    def _spheres(self) -> tuple[Floats, Floats]:
        centre = self.corners.mean(axis=1)
        return centre, (1 + MOST_OFFSET) * np.linalg.norm(self.corners - centre[:, None], axis=2).max(axis=1)

    def _load(self, table: Floats, rows: Ints, k: Ints) -> Floats:
        c = np.zeros((N_TERMS, 3, len(k)))
        old = np.flatnonzero(rows < self.first)
        if len(old):
            c[..., old] = super()._load(table, rows[old], k[old])
        new = np.flatnonzero(rows >= self.first)
        c[..., new] = self._paraboloids(k[new])
        return c

    def _paraboloids(self, k: Ints) -> Floats:
        corners, normals = self.corners[k], self.corner_normals[k]
        c = np.zeros((N_TERMS, 3, len(k)))
        by_power = {power: c[i] for i, power in enumerate(POWERS)}
        by_power[1, 0][:], by_power[0, 1][:] = (corners[:, 1:] - corners[:, :1]).transpose(1, 2, 0)
        middle = normals.mean(axis=1)
        # sag of an edge whose normals turn: its height is that of a parabola
        high = [
            0.5 * dot(normals[:, j] - normals[:, i], corners[:, j] - corners[:, i]) * middle.T
            for i, j in ((0, 1), (0, 2), (1, 2))
        ]
        # (1 - u - v) u, (1 - u - v) v and u v
        by_power[1, 0][:] += high[0]
        by_power[2, 0][:] -= high[0]
        by_power[0, 1][:] += high[1]
        by_power[0, 2][:] -= high[1]
        by_power[1, 1][:] += high[2] - high[0] - high[1]
        return c


def _as_parabolic(plan: Plan, layer: Layer, triangles: Ints) -> Layer:
    """A layer whose flat triangles with bent normals are paraboloids instead."""
    is_bent = plan.is_bent[triangles]
    n = int(is_bent.sum())
    old = layer.curved
    if old is None:
        whole, few = np.full((0, 3), -1), np.empty((0, N_TERMS, 3))
        old = CurvedFaces(
            layer.corners, np.full(len(triangles), -1), few, whole, whole, whole[:, 0], few, whole, few[:, 0]
        )
    first = len(old.coefficients)
    row = old.row.copy()
    row[is_bent] = first + np.arange(n)
    none = np.full((n, 3), -1)
    columns = {f.name: getattr(old, f.name) for f in fields(CurvedFaces)}
    columns |= {
        "row": row,
        "neighbour": np.concatenate([old.neighbour, none]),
        "bent_row": np.concatenate([old.bent_row, none[:, 0]]),
    }
    normals = plan.corner_normals[triangles]
    if layer.motion is not None:
        normals = normals @ layer.motion.rotation
    return layer.bent(_Parabolic(**columns, corner_normals=normals, first=first))


def _difference(one: Landings, other: Landings) -> float:
    """Distance of landings on the same branch, rms in display px; 0 where there are none."""
    same = one.has_arrived & other.has_arrived & (one.branch == other.branch)
    return float(np.sqrt(((one.xy - other.xy)[same] ** 2).sum(axis=1).mean())) if same.any() else 0.0


def tessellation(plan: Plan) -> Generator[float, None, Tessellation]:
    """What the mesh leaves open of the surface that was meant.

    It is seen from what a change of the surface does to a sample of the viewer's rays. Flat triangles with bent normals
    are compared with paraboloids; faces whose edges are held straight with what they would be if they were not. Curved
    faces are of degree 4; what degree 5 would change is taken to follow on the changes from 2 to 3 and from 3 to 4 as a
    geometric sequence. Yields progress 0..1.
    """
    pairs = list(zip(plan.layers, plan.layer_triangles, strict=True))
    has_curved = any(layer.curved is not None for layer in plan.layers)
    is_drawn = [bool(plan.is_bent[numbers].any()) and layer.has_engine for layer, numbers in pairs]
    if not (has_curved or any(is_drawn)):
        return Tessellation(0.0, 0.0)
    viewer = plan.rig.viewer
    x, y = ((np.arange(SAMPLES) + 0.5) / SAMPLES * size for size in (viewer.width, viewer.height))
    every = viewer.rays(np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2))
    ways: tuple[list[Step], list[Step]] = [], []
    whole = trace(plan, *every, steps=ways[0])
    here = Landings(*(getattr(whole, f.name)[whole.has_arrived] for f in fields(Landings)))
    rays = [values[here.sample] for values in every]  # with the others nothing is compared
    yield 0.2

    def landings(layers: list[Layer], steps: list[Step] | None = None) -> Landings:
        return trace(replace(plan, layers=tuple(layers)), *rays, steps=steps)

    def changed(change: Callable[[CurvedFaces], CurvedFaces], steps: list[Step] | None = None) -> Landings:
        curved = [layer if layer.curved is None else layer.bent(change(layer.curved)) for layer in plan.layers]
        return landings(curved, steps)

    parts, undecided = [], 0.0
    if any(is_drawn):
        drawn = zip(pairs, is_drawn, strict=True)
        parts.append(_difference(here, landings([_as_parabolic(plan, *pair) if so else pair[0] for pair, so in drawn])))
        yield 0.4
    if has_curved:
        square = changed(lambda curved: replace(curved, degree=2))
        yield 0.6
        cubic = changed(lambda curved: replace(curved, degree=3), ways[1])
        yield 0.8
        is_changed = cubic.branch != here.branch
        if is_changed.any():
            with np.errstate(invalid="ignore"):
                off = np.abs(cubic.xy - here.xy).max(axis=1)
                is_changed &= ~(cubic.has_arrived & (off <= plan.settings.tolerance))
            is_near = _passes_near(plan, every[0], ways[0])[here.sample] | _passes_near(plan, rays[0], ways[1])
            undecided = float((is_changed & is_near).mean())
        last, before = _difference(here, cubic), _difference(cubic, square)
        parts.append(last * min(1.0, last / before) if before else last)
    if any(layer.curved is not None and layer.curved.has_straight_edges for layer in plan.layers):
        parts.append(_difference(here, changed(_let_go)))
    return Tessellation(float(np.linalg.norm(parts)), undecided)


def rounding_error(plan: Plan) -> float:
    """About how far landings may be off because Blender keeps places and vertices as float32, display px.

    Each part is shifted by half a step of its place. Vertices that are off tilt the faces between them, by the more the
    smaller those are: light is turned by TILTED of it, and lands beside by that times its way from the glass.
    """
    rig = plan.rig
    pixel = display_pixel(rig.display)
    plate, display = (part.mesh.bounds.mean(axis=0) for part in (rig.plates[0], rig.display))
    off = FLOAT32 / 4 * max(float(np.abs(part.mesh.bounds).max()) for part in (*rig.glasses, *rig.plates, rig.display))
    for part in (*rig.glasses, *rig.mirrors):
        if not part.mesh.rounding:
            continue
        corners = part.mesh.corners
        area, edge = areas_of(corners), np.linalg.norm(corners[:, 1] - corners[:, 0], axis=1)
        has_area = area > 0
        if not has_area.any():
            continue
        tilt = part.mesh.rounding * float(np.average(1 / edge[has_area], weights=area[has_area]))
        way = np.linalg.norm(part.mesh.bounds.mean(axis=0) - plate) + np.linalg.norm(plate - display)
        off = max(off, TILTED * tilt * float(way))
    return off / pixel


def _passes_near(plan: Plan, origins: Floats, steps: list[Step]) -> Bools:
    """Which rays (n,) meet two solids one after the other within NEAR of the glass's size of each other?"""
    size = max(float(np.ptp(glass.mesh.bounds, axis=0).max()) for glass in plan.rig.glasses)
    last, solid, is_near = origins.copy(), np.full(len(origins), -1), np.zeros(len(origins), bool)
    for step in steps:
        part = plan.part[step.patch]  # a patch has the number of one of its triangles
        part = np.where(plan.kind[part] == Kind.GLASS, part, -1)
        is_other = (part >= 0) & (solid[step.rays] >= 0) & (part != solid[step.rays])
        is_near[step.rays] |= is_other & (np.linalg.norm(step.place - last[step.rays], axis=1) < NEAR * size)
        last[step.rays], solid[step.rays] = step.place, part
    return is_near


def _let_go(curved: CurvedFaces) -> CurvedFaces:
    """Curved faces whose straight edges are not held straight."""
    coefficients = curved.coefficients.copy()
    held = np.flatnonzero(curved.bent_row >= 0)
    coefficients[held] = curved.bent[curved.bent_row[held]]
    return replace(curved, coefficients=coefficients)
