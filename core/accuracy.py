"""How far off is the result, as far as it can tell by itself?"""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from .curved import MOST_OFFSET, N_TERMS, POWERS, CurvedFaces
from .optics import dot
from .plan import Plan
from .ray_engine import Layer
from .rig import Floats, Ints
from .trace import Landings, trace_all

SAMPLES = 48  # rays along each side of the viewer's image
WIDE = 0.5  # barycentric: faces without neighbours are followed this far beyond their edges


@dataclass(frozen=True, eq=False)
class _Parabolic(CurvedFaces):
    """Over each flat triangle with bent normals (t, 3, 3) the paraboloid that has about these normals."""

    corner_normals: Floats | None = None

    @cached_property
    def _spheres(self) -> tuple[Floats, Floats]:
        centre = self.corners.mean(axis=1)
        return centre, (1 + MOST_OFFSET) * np.linalg.norm(self.corners - centre[:, None], axis=2).max(axis=1)

    def _load(self, table: Floats, rows: Ints, k: Ints) -> Floats:
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
    row = np.full(len(triangles), -1)
    row[is_bent] = np.arange(n)
    none = np.full((n, 3), -1)
    empty = np.empty((0, N_TERMS, 3))
    return layer.bent(
        _Parabolic(layer.corners, row, empty, none, none, none[:, 0], empty, none, np.empty((0, 3)), slack=WIDE,
                   corner_normals=plan.corner_normals[triangles])
    )  # fmt: skip


def _difference(one: Landings, other: Landings) -> float:
    """Distance of landings on the same branch, rms in display px; 0 where there are none."""
    same = one.has_arrived & other.has_arrived & (one.branch == other.branch)
    return float(np.sqrt(((one.xy - other.xy)[same] ** 2).sum(axis=1).mean())) if same.any() else 0.0


def tessellation_error(plan: Plan) -> float:
    """About how far landings are from those of the surface that was meant, rms in display px; 0 where all is flat.

    It is seen from what the degree of the surface changes for a sample of the viewer's rays. Flat triangles with bent
    normals are compared with paraboloids. Curved faces are of degree 4; what degree 5 would change is taken to follow
    on the changes from 2 to 3 and from 3 to 4 as a geometric sequence.
    """
    has_curved = any(layer.curved is not None for layer in plan.layers)
    pairs = list(zip(plan.layers, plan.layer_triangles, strict=True))
    is_drawn = [layer.curved is None and plan.is_bent[numbers].any() for layer, numbers in pairs]
    if not (has_curved or any(is_drawn)):
        return 0.0
    viewer = plan.rig.viewer
    x, y = ((np.arange(SAMPLES) + 0.5) / SAMPLES * size for size in (viewer.width, viewer.height))
    rays = viewer.rays(np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2))

    def landings(layers: list[Layer]) -> Landings:
        return trace_all(replace(plan, layers=tuple(layers)), *rays)

    here, of_curved, of_drawn = landings(list(plan.layers)), 0.0, 0.0
    if any(is_drawn):
        changed = [
            _as_parabolic(plan, *pair) if drawn else pair[0] for pair, drawn in zip(pairs, is_drawn, strict=True)
        ]
        of_drawn = _difference(here, landings(changed))
    if has_curved:
        square, cubic = (
            landings([
                layer if layer.curved is None else layer.bent(replace(layer.curved, degree=degree))
                for layer in plan.layers
            ])
            for degree in (2, 3)
        )  # fmt: skip
        last, before = _difference(here, cubic), _difference(cubic, square)
        of_curved = last * min(1.0, last / before) if before else last
    return float(np.hypot(of_curved, of_drawn))
