"""Faults of a mesh that cost light: open edges, flipped and interior faces, and flat faces of a
curved surface.
"""

from typing import NamedTuple

import bpy
import numpy as np

from ...base.arrays import Bools, Floats, Ints
from ...glass.inner_faces import find_bodies
from ...glass.meshes import components, volume_of
from ...glass.solids import find_turned
from ..read.read_mesh import column, read_local
from .to_do import FaultCounts

BENT = 0.01  # distance between unit normals; files round them to 1e-3 or less
LEAST, MOST = np.radians([0.05, 12.0])  # between facets; the faces of one flat facet differ by less
ALIKE = 4.0  # largest area ratio of neighbours on one curve: a bevel's facet is larger
MANY = 400  # hand-cut glass has fewer facets; Blender's default sphere has 512
WORTH = 0.25  # of the whole area


def counts_of(mesh: bpy.types.Mesh) -> FaultCounts:
    """Faults of a Blender mesh, evaluated or as it is drawn. Coincident vertices count as one."""
    local = read_local(mesh)
    n = len(mesh.polygons)
    if not len(local.triangles) or not np.isfinite(local.vertices).all():
        return FaultCounts(n_faces=n)

    # one vertex for each group of welded ones
    mesh.calc_loop_triangles()
    drawn = column(mesh.loop_triangles, "vertices", 3, np.int32)
    one = np.arange(len(mesh.vertices))
    one[column(mesh.loops, "vertex_index", 1, np.int32)[local.loops]] = local.triangles

    # interior faces are not part of a body's surface
    polygons = column(mesh.loop_triangles, "polygon_index", 1, np.int32)
    triangles = one[drawn]
    is_whole = (triangles != np.roll(triangles, 1, axis=1)).all(axis=1)
    triangles, polygons = triangles[is_whole], polygons[is_whole]
    body = find_bodies(local.vertices, triangles)
    is_outer = body >= 0

    polygon = np.repeat(np.arange(n), column(mesh.polygons, "loop_total", 1, np.int32))
    is_turned = np.zeros(n, bool)
    is_turned[polygon[local.loops[find_turned(local.triangles), 0]]] = True
    edges = one[column(mesh.edges, "vertices", 2, np.int32).astype(np.int64)]
    return FaultCounts(
        n_faces=n,
        n_open=int(open_edges(edges, triangles[is_outer], body[is_outer]).sum()),
        n_turned=int(is_turned.sum()),
        is_turned_smooth=bool((is_turned[polygon] & _is_bent(mesh, polygon)).any()),
        is_inside_out=volume_of(local.vertices[triangles[is_outer]]) < 0,
        n_inner=len(np.unique(polygons[~is_outer])),
        n_facets=n_facets(mesh, one),
        n_loose=int((one != np.arange(len(one))).sum()),
    )


def _is_bent(mesh: bpy.types.Mesh, polygon: Ints) -> Bools:
    """Mask (l,) of the corners whose normal differs from the plane of their polygon (l,)."""
    plane = column(mesh.polygons, "normal", 3, np.float32)[polygon]
    apart = column(mesh.corner_normals, "vector", 3, np.float32) - plane
    return np.linalg.norm(apart, axis=1) > BENT


def open_edges(edges: Ints, triangles: Ints, body: Ints) -> Bools:
    """Mask (e,) of edges (e, 2) with one triangle, or more than two of one body (t,), among
    triangles (t, 3).

    An edge without triangles is a wire, which no light meets. An edge from a vertex to itself is a
    point.
    """
    n = int(max(triangles.max(initial=0), edges.max(initial=0))) + 1
    n_bodies = int(body.max(initial=0)) + 1
    sides = np.stack([triangles, np.roll(triangles, -1, axis=1)], axis=2).reshape(-1, 2)
    keys, edge = np.unique(_keys(sides, n), return_inverse=True)
    of_body, counts = np.unique(edge * n_bodies + np.repeat(body, 3), return_counts=True)
    own = _keys(edges, n)
    is_odd = np.isin(own, keys[of_body[counts != 2] // n_bodies])
    is_open = (edges[:, 0] != edges[:, 1]) & is_odd

    # coincident edges count once
    is_first = np.zeros(len(own), bool)
    is_first[np.unique(own, return_index=True)[1]] = True
    return is_open & is_first


def _keys(edges: Ints, n: int) -> Ints:
    return edges.min(axis=1) * n + edges.max(axis=1)


class _EdgeSides(NamedTuple):
    """Edges between two polygons: both polygons (n,) and (n,), the angle (n,) between their planes,
    rad, independent of winding, and whether the shading breaks (n,) there.
    """

    a: Ints
    b: Ints
    angle: Floats
    is_broken: Bools


def n_facets(mesh: bpy.types.Mesh, one: Ints) -> int:
    """Number of flat polygons that approximate a curve; 0 if they are few or a small part of the
    area, as on cut crystal.

    Coplanar neighbours, such as the two triangles of a quad, are one facet. A facet of a curve has
    two neighbours of similar size, at small angles, across edges where the shading breaks. The
    shading of imported faces also breaks at custom normals and unmerged vertices.

    one : (v,) representative of each group of coincident vertices
    """
    if len(mesh.polygons) < MANY:
        return 0
    sides = _sides(mesh, one)
    is_coplanar = sides.angle <= LEAST
    facets = components(len(mesh.polygons), sides.a[is_coplanar], sides.b[is_coplanar])
    area = np.bincount(facets, column(mesh.polygons, "area", 1, np.float32), len(facets))

    a, b = facets[sides.a], facets[sides.b]
    is_alike = np.maximum(area[a], area[b]) < ALIKE * np.minimum(area[a], area[b])
    is_near = sides.is_broken & is_alike & (sides.angle > LEAST) & (sides.angle < MOST)
    pairs = np.unique(np.sort(np.stack([a, b], axis=1)[is_near], axis=1), axis=0)
    is_of_curve = np.bincount(pairs.ravel(), minlength=len(facets)) >= 2
    if is_of_curve.sum() < MANY or area[is_of_curve].sum() <= WORTH * area.sum():
        return 0
    return int(is_of_curve[facets].sum())


def _sides(mesh: bpy.types.Mesh, one: Ints) -> _EdgeSides:
    """The edges of a mesh with two polygons."""
    edge = column(mesh.loops, "edge_index", 1, np.int32)
    if (one != np.arange(len(one))).any():
        ends = np.sort(one[column(mesh.edges, "vertices", 2, np.int32)], axis=1)
        _, same = np.unique(ends @ [len(one), 1], return_inverse=True)
        edge = same.ravel()[edge]
    order = np.argsort(edge, kind="stable")
    counts = np.bincount(edge, minlength=edge.max() + 1)
    first = (np.cumsum(counts) - counts)[counts == 2]
    a, b = order[first], order[first + 1]  # loops

    # the shading normals of both polygons at both ends of an edge
    start = column(mesh.polygons, "loop_start", 1, np.int32)
    total = column(mesh.polygons, "loop_total", 1, np.int32)
    after = np.arange(1, len(edge) + 1)
    after[start + total - 1] = start
    corner = column(mesh.corner_normals, "vector", 3, np.float32)
    polygon = np.repeat(np.arange(len(total)), total)
    normal = column(mesh.polygons, "normal", 3, np.float32)
    angle = _angle(normal[polygon[a]], normal[polygon[b]])
    shaded = _angle(corner[a] + corner[after[a]], corner[b] + corner[after[b]])
    return _EdgeSides(polygon[a], polygon[b], angle, shaded > angle / 2)


def _angle(one: Floats, other: Floats) -> Floats:
    """Angle between the lines along vectors (n, 3), rad, 0 to 90 degrees."""
    with np.errstate(invalid="ignore"):
        one, other = (v / np.linalg.norm(v, axis=1, keepdims=True) for v in (one, other))
    apart = np.minimum(np.linalg.norm(one - other, axis=1), np.linalg.norm(one + other, axis=1))
    # the sine of half the angle is precise where the cosine of the whole is not
    return 2 * np.arcsin(np.minimum(apart / 2, 1.0))
