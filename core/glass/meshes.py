"""Geometry and topology of triangles: edges, connected components, patches, boxes, planes."""

from dataclasses import dataclass

import numpy as np

from ..base.arrays import Bools, Floats, Ints, greatest, stable_argsort, take, transpose_rows
from ..base.vectors import dot, normalise
from ..rig.mesh import SAME_NORMAL


def components(n: int, a: Ints, b: Ints) -> Ints:
    """Smallest node label (n,) in each connected component of n nodes with edges a[i] - b[i]."""
    parent = np.arange(n)
    while len(a):
        low = np.minimum(a, b)
        high = np.maximum(a, b)
        parent[high] = low  # any one writer wins; the other edges come round again

        while True:
            jumped = parent[parent]
            if np.array_equal(jumped, parent):
                break
            parent = jumped

        a = parent[a]
        b = parent[b]
        differs = a != b
        a = a[differs]
        b = b[differs]

    return parent


@dataclass(frozen=True, eq=False)
class Edges:
    """Pairs of triangles with a common edge, and the number of other edges.

    first, second : (e,) triangle indices
    corner_first, corner_second : (e,) corner at which the edge starts in each
    is_same_way : (e,) both run along the edge in the same direction: one is wound the wrong way
    n_open : edges with one triangle or more than two
    """

    first: Ints
    second: Ints
    corner_first: Ints
    corner_second: Ints
    is_same_way: Bools
    n_open: int

    def at(self, which: Bools) -> "Edges":
        columns = self.first, self.second, self.corner_first, self.corner_second, self.is_same_way
        return Edges(*(column[which] for column in columns), self.n_open)


def find_edges(triangles: Ints) -> Edges:
    """Match the edges of triangles (t, 3) by vertex index. An edge of more than two triangles joins
    none.
    """
    start = triangles.astype(np.int64).ravel()
    end = np.roll(triangles, -1, axis=1).astype(np.int64).ravel()
    key = np.minimum(start, end) * (int(triangles.max()) + 1) + np.maximum(start, end)
    order = stable_argsort(key)
    ordered = key[order]
    begins = np.flatnonzero(np.r_[True, ordered[1:] != ordered[:-1]])
    counts = np.diff(np.r_[begins, len(ordered)])
    pairs = begins[counts == 2]
    i = order[pairs]
    j = order[pairs + 1]

    return Edges(i // 3, j // 3, i % 3, j % 3, start[i] == start[j], int((counts != 2).sum()))


def box_of(corners: Floats) -> Floats:
    """Lower and upper corner (2, 3) of the bounding box of triangles (t, 3, 3)."""
    x_y_z = np.ascontiguousarray(corners.reshape(-1, 3).T)  # five times as fast as along the rows
    return np.stack([x_y_z.min(axis=1), x_y_z.max(axis=1)])


def boxes_of(corners: Floats) -> Floats:
    """Lower and upper corners (t, 2, 3) of the bounding box of each triangle (t, 3, 3)."""
    by_corner = transpose_rows(corners)
    return np.stack([of.reduce(by_corner) for of in (np.minimum, np.maximum)]).transpose(2, 0, 1)


@dataclass(frozen=True, eq=False)
class Frames:
    """Planes of triangles with barycentric axes: u = (p - corner) . axis_u, v likewise, p a point
    of the plane.

    corner, normal, axis_u, axis_v : (t, 3); the normal is not unit; NaN axes for a triangle without
        area
    """

    corner: Floats
    normal: Floats
    axis_u: Floats
    axis_v: Floats

    @classmethod
    def of(cls, corners: Floats) -> "Frames":
        """Frames of triangles with corners (t, 3, 3)."""
        e1 = corners[:, 1] - corners[:, 0]
        e2 = corners[:, 2] - corners[:, 0]
        normal = np.cross(e1, e2)
        with np.errstate(invalid="ignore", divide="ignore"):
            area = 1.0 / dot(normal, normal)[:, None]
            return cls(
                corners[:, 0], normal, np.cross(e2, normal) * area, np.cross(normal, e1) * area
            )

    def distance(self, k: Ints | int, origins: Floats, directions: Floats) -> Floats:
        """Distance of rays (n, 3) to the *planes* of triangles k; not finite if parallel."""
        normal = self.normal[k]
        with np.errstate(invalid="ignore", divide="ignore"):
            return dot(self.corner[k] - origins, normal) / dot(directions, normal)

    def barycentric(self, k: Ints | int, points: Floats) -> tuple[Floats, Floats]:
        """Barycentric u, v of points (n, 3) in the planes of triangles k."""
        inside = points - self.corner[k]
        return dot(inside, self.axis_u[k]), dot(inside, self.axis_v[k])


def geometric_normals(corners: Floats) -> Floats:
    """Unit normals (t, 3) of triangles with corners (t, 3, 3); zero for a triangle without area."""
    return normalise(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]))


def areas_of(corners: Floats) -> Floats:
    """Areas (t,) of triangles with corners (t, 3, 3)."""
    return 0.5 * np.linalg.norm(
        np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1
    )


def spheres_of(corners: Floats) -> tuple[Floats, Floats]:
    """Centres (t, 3) and radii (t,) of spheres around triangles with corners (t, 3, 3)."""
    centre = corners.mean(axis=1)
    return centre, np.linalg.norm(corners - centre[:, None], axis=2).max(axis=1)


def volume_of(corners: Floats) -> float:
    """Signed volume, m^3, inside facets (t, 3, 3); positive if they face outward."""
    a, b, c = np.moveaxis(corners - corners[0, 0], 1, 0)
    return float(dot(a, np.cross(b, c)).sum() / 6)


def edge_corners(values: Floats, edges: Edges) -> tuple[Floats, Floats]:
    """Values (t, 3, c) of the corners at both ends of each edge, (e, 2, c), in its first and its
    second triangle.
    """
    i = edges.corner_first
    j = edges.corner_second
    next_i = (i + 1) % 3
    next_j = (j + 1) % 3

    # the second triangle runs along the edge the other way, if both are wound alike
    start = np.where(edges.is_same_way, j, next_j)
    end = np.where(edges.is_same_way, next_j, j)
    of_corner = values.reshape(-1, values.shape[2])
    first, second = 3 * edges.first[:, None], 3 * edges.second[:, None]
    return (
        take(of_corner, first + np.stack([i, next_i], axis=1)),
        take(of_corner, second + np.stack([start, end], axis=1)),
    )


def find_joined(normals: Floats, edges: Edges) -> Bools:
    """Mask (e,) of edges that join two faces into one patch: corner normals agree at both ends.

    normals : (t, 3, 3) unit normals at the corners (a flat triangle repeats its own three times).
    """
    first, second = edge_corners(normals, edges)
    return greatest(np.abs(first - second)) < SAME_NORMAL


def interpolate(values: Floats, u: Floats, v: Floats) -> Floats:
    """Corner values (n, 3, c) at barycentric u, v (n,)."""
    return (
        (1 - u - v)[:, None] * values[:, 0] + u[:, None] * values[:, 1] + v[:, None] * values[:, 2]
    )
