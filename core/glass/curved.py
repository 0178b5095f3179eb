"""Curved faces over triangles: quartics in barycentric coordinates.

`curved_hits` intersects them with rays; `bounding_shell` makes the mesh for the ray engine. A face
of another kind than a quartic overrides `terms`, `slack` and `spheres`.
"""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from ..base.arrays import Floats, Ints
from ..base.products import combine
from ..base.vectors import normalise
from .meshes import spheres_of
from .motion import Motion
from .quartics import (
    AT_NODES,
    LOWER,
    N_TERMS,
    by_term,
    cross,
    grid,
    monomials,
    table,
    value,
    value_and_slopes,
)

# rays or faces in one batch: their arrays stay in the cache
FACES_AT_ONCE = 1 << 12
# barycentric slack: a ray through an edge or vertex must hit a face
EDGE = 1e-10
# fraction of the longest edge: a face further from its facet is rejected
MOST_OFFSET = 0.3
# bound of a face's bulge, over the largest sampled one
HIGHER = 1.5
# columns of row numbers, and the columns they index: renumbered when faces are joined
NUMBERED = {
    "row": "coefficients",
    "neighbour": "corners",
    "vertex": "vertex_normal",
    "normal_row": "normal_terms",
    "bent_row": "bent",
}


@dataclass(frozen=True, eq=False)
class CurvedFaces:
    """Curved faces over some of t triangles: point(u, v) = facet + sum of 14 terms u^a v^b times
    coefficients.

    corners : (t, 3, 3) m
    row : (t,) curved face of each triangle, -1 without one
    coefficients : (p, 14, 3) m, best stored term by term
    neighbour, neighbour_edge : (p, 3) triangle across each edge (from corner e to e + 1) where the
        surface continues smoothly, -1 elsewhere, and its edge there
    vertex : (p, 3) vertices of the corners
    vertex_normal : (f, 3), shared by all faces around a vertex
    normal_row, normal_terms : (p,), (q, 14, 3) if its own normals disagree with a neighbour's, or
        an edge is straight, a face refracts by the interpolated normals of its vertices plus 14
        terms; row -1: by its own normals
    bent_row, bent : (p,), (q, 14, 3) coefficients of faces with a straight edge as if it were not
        straight
    degree : 4; lower for faces to be compared with the quartics
    lowered_from : the faces of degree 4, None if these are
    """

    corners: Floats
    row: Ints
    coefficients: Floats
    neighbour: Ints
    neighbour_edge: Ints
    vertex: Ints
    vertex_normal: Floats
    normal_row: Ints
    normal_terms: Floats
    bent_row: Ints
    bent: Floats
    degree: int = 4
    lowered_from: "CurvedFaces | None" = None

    @classmethod
    def none(cls, corners: Floats) -> "CurvedFaces":
        """Empty set of curved faces over triangles (t, 3, 3)."""
        no_rows = np.full(0, -1)
        no_edges = np.full((0, 3), -1)
        no_terms = np.empty((0, N_TERMS, 3))
        return cls(
            corners=corners,
            row=np.full(len(corners), -1),
            coefficients=no_terms,
            neighbour=no_edges,
            neighbour_edge=no_edges,
            vertex=no_edges,
            vertex_normal=np.empty((0, 3)),
            normal_row=no_rows,
            normal_terms=no_terms,
            bent_row=no_rows,
            bent=no_terms,
        )

    @classmethod
    def join(cls, parts: "list[CurvedFaces | None]", corners: list[Floats]) -> "CurvedFaces | None":
        """Curved faces of several surfaces, with facets (t, 3, 3) each, in one numbering."""
        if all(part is None for part in parts):
            return None

        starts = np.cumsum([0, *(len(facets) for facets in corners)])
        numbered: dict[str, list[Ints]] = {name: [] for name in NUMBERED}
        n_before = dict.fromkeys(NUMBERED, 0)

        for part, facets, start in zip(parts, corners, starts, strict=False):
            if part is None:
                numbered["row"].append(np.full(len(facets), -1, np.int32))
                continue
            n_before["neighbour"] = start
            for name, counted in NUMBERED.items():
                rows = getattr(part, name)
                numbered[name].append(np.where(rows >= 0, rows + n_before[name], -1))
                n_before[name] = n_before[name] + len(getattr(part, counted))

        full = [part for part in parts if part is not None]
        others = ("neighbour_edge", "vertex_normal", "normal_terms", "bent")
        return cls(
            corners=np.concatenate(corners),
            coefficients=by_term(np.concatenate([part.coefficients for part in full])),
            **{name: np.concatenate(rows) for name, rows in numbered.items()},
            **{name: np.concatenate([getattr(part, name) for part in full]) for name in others},
        )

    def moved(self, motion: Motion) -> "CurvedFaces":
        """The same faces after a rigid motion."""
        vectors = ("coefficients", "bent", "vertex_normal", "normal_terms")
        turned = {name: motion.directions(getattr(self, name)) for name in vectors}
        whole = None if self.lowered_from is None else self.lowered_from.moved(motion)
        return replace(self, corners=motion.points(self.corners), lowered_from=whole, **turned)

    def by_own_normals(self) -> "CurvedFaces":
        """The same faces with their own normals, except faces with a straight edge."""
        return replace(self, normal_row=np.where(self.bent_row >= 0, self.normal_row, -1))

    def lowered(self, degree: int) -> "CurvedFaces":
        """Faces of a lower degree through these, with their own normals."""
        return replace(self.by_own_normals(), degree=degree, lowered_from=self.whole)

    @property
    def whole(self) -> "CurvedFaces":
        """The faces of degree 4 before `lowered`, or these."""
        return self.lowered_from or self

    @property
    def triangle(self) -> Ints:
        """Triangle (p,) of each curved face."""
        return np.flatnonzero(self.row >= 0)

    @property
    def has_straight_edges(self) -> bool:
        """Whether any face has an edge held straight."""
        return len(self.bent) > 0

    @property
    def has_given_normals(self) -> bool:
        """Whether any face refracts by normals other than its own."""
        return len(self.normal_terms) > 0

    def points_on(self, k: int) -> Floats:
        """Points (p, n, 3), m, of all faces at the points of grid(k)."""
        weights = grid(k)[0]
        terms = monomials(weights[:, 1], weights[:, 2])
        return np.matmul(weights, self.corners[self.triangle]) + np.matmul(terms, self.coefficients)

    @cached_property
    def coefficient_table(self) -> Floats:
        """Coefficients (42, p), term by term."""
        return table(self.coefficients)

    @cached_property
    def _normal_table(self) -> Floats:
        return table(self.normal_terms)

    def terms(self, k: Ints) -> Floats:
        """Coefficients (14, 3, n) of points relative to the first corner of triangles k."""
        c = np.take(self.coefficient_table, self.row[k], axis=1).reshape(N_TERMS, 3, -1)
        if self.degree != 4:
            c = combine(LOWER[self.degree], c.reshape(N_TERMS, -1)).reshape(c.shape)
        corners = np.take(self.corners, k, axis=0)
        c[:2] += (corners[:, 1:] - corners[:, :1]).transpose(1, 2, 0)
        return c

    def points(self, k: Ints, u: Floats, v: Floats) -> Floats:
        """Points (n, 3), m, of the curved faces of triangles k at u, v (n,)."""
        return self.corners[k, 0] + value(self.terms(k), u, v).T

    @cached_property
    def spheres(self) -> tuple[Floats, Floats]:
        """Centres (t, 3) and radii (t,) of spheres around the triangles and their curved faces."""
        centre, radius = spheres_of(self.corners)
        radius[self.triangle] += self._offsets
        return centre, radius

    @property
    def _offsets(self) -> Floats:
        """Largest offset (p,), m, of each face from its triangle."""
        parts = [
            np.linalg.norm(np.matmul(AT_NODES, some), axis=2).max(axis=1)
            for some in np.array_split(
                self.coefficients, len(self.coefficients) // FACES_AT_ONCE + 1
            )
        ]
        return HIGHER * np.concatenate(parts)

    @property
    def reach(self) -> float:
        """Largest offset, m, of any face from its triangle."""
        return float(self._offsets.max(initial=0.0))

    def slack(self, row: Ints) -> Floats | float:
        """Barycentric distance to which faces of rows (n,) are followed beyond their edges."""
        return EDGE

    def normals(self, k: Ints, u: Floats, v: Floats) -> Floats:
        """Unit normals (n, 3) for refraction on the curved faces of triangles k at u, v (n,)."""
        c = self.terms(k)
        return normalise(self.refracting(cross(*value_and_slopes(c, u, v)[1:]).T, k, u, v))

    def given_normals(self, facing: Floats, k: Ints, u: Floats, v: Floats) -> Floats | None:
        """Normals (n, 3) for refraction, not unit, of triangles k at u, v (n,), with own normals
        `facing` (n, 3); None if all faces use their own.
        """
        return self.refracting(facing, k, u, v) if self.has_given_normals else None

    def refracting(self, normal: Floats, k: Ints, u: Floats, v: Floats) -> Floats:
        """Normals (n, 3) for refraction: `normal`, replaced on faces with other than their own.

        Returns the same array if nothing is replaced.
        """
        if not self.has_given_normals:
            return normal

        row = self.row[k]
        given = np.flatnonzero(self.normal_row[row] >= 0)
        if not len(given):
            return normal

        row = row[given]
        c = np.take(self._normal_table, self.normal_row[row], axis=1).reshape(N_TERMS, 3, -1)
        at_corners = self.vertex_normal[self.vertex[row]]
        c[:2] += (at_corners[:, 1:] - at_corners[:, :1]).transpose(1, 2, 0)
        normal = normal.copy()
        normal[given] = at_corners[:, 0] + value(c, u[given], v[given]).T

        return normal
