"""Paraboloids over flat triangles with bent normals, to measure the error of their flatness."""

from dataclasses import dataclass, fields
from functools import cached_property

import numpy as np

from ..base.arrays import Bools, Floats, Ints
from ..base.vectors import dot
from .curved import EDGE, MOST_OFFSET, CurvedFaces
from .meshes import spheres_of
from .quartics import N_TERMS, POWERS

# barycentric: paraboloids have no neighbours, and are followed this far beyond their edges
WIDE = 0.5


@dataclass(frozen=True, eq=False)
class Paraboloids(CurvedFaces):
    """Curved faces, and paraboloids over flat triangles, approximating their bent normals (t, 3,
    3).

    Rows from `first` on are paraboloids, those before are the `others`, None without any.
    """

    corner_normals: Floats | None = None
    first: int = 0
    others: CurvedFaces | None = None

    @classmethod
    def added_to(
        cls, others: CurvedFaces | None, corners: Floats, is_bent: Bools, corner_normals: Floats
    ) -> "Paraboloids":
        """Curved faces, if there are others, plus paraboloids over flat triangles (t, 3, 3) with
        bent (t,) normals at their corners (t, 3, 3).
        """
        faces = others or CurvedFaces.none(corners)
        n = int(is_bent.sum())
        first = len(faces.coefficients)
        row = faces.row.copy()
        row[is_bent] = first + np.arange(n)

        # a paraboloid has no neighbours, and only its own normals
        none = np.full((n, 3), -1)
        columns = {f.name: getattr(faces, f.name) for f in fields(CurvedFaces)}
        columns |= {
            "row": row,
            "neighbour": np.concatenate([faces.neighbour, none]),
            "neighbour_edge": np.concatenate([faces.neighbour_edge, none]),
            "normal_row": np.concatenate([faces.normal_row, none[:, 0]]),
            "bent_row": np.concatenate([faces.bent_row, none[:, 0]]),
        }
        return cls(**columns, corner_normals=corner_normals, first=first, others=others)

    def slack(self, row: Ints) -> Floats:
        """Barycentric distance to which faces of rows (n,) are followed beyond their edges."""
        return np.where(row >= self.first, WIDE, EDGE)

    @cached_property
    def spheres(self) -> tuple[Floats, Floats]:
        """Centres (t, 3) and radii (t,) of spheres around the triangles and their faces."""
        centre, radius = spheres_of(self.corners)
        return centre, (1 + MOST_OFFSET) * radius

    def terms(self, k: Ints) -> Floats:
        """Coefficients (14, 3, n) of points relative to the first corner of triangles k."""
        c = np.zeros((N_TERMS, 3, len(k)))
        old = np.flatnonzero(self.row[k] < self.first)
        if len(old):
            c[..., old] = super().terms(k[old])
        new = np.flatnonzero(self.row[k] >= self.first)
        c[..., new] = self._paraboloids(k[new])
        return c

    def _paraboloids(self, k: Ints) -> Floats:
        corners = self.corners[k]
        normals = self.corner_normals[k]
        c = np.zeros((N_TERMS, 3, len(k)))
        by_power = {power: c[i] for i, power in enumerate(POWERS)}
        by_power[1, 0][:], by_power[0, 1][:] = (corners[:, 1:] - corners[:, :1]).transpose(1, 2, 0)

        # sag of an edge with turning normals: the height of a parabola
        middle = normals.mean(axis=1)
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
