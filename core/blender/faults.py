"""Faults of a mesh that cost light: edges at which it is not closed, triangles without area."""

from dataclasses import dataclass

import bpy
import numpy as np

from ..base.arrays import Bools, Floats, Ints
from ..glass.inner_faces import find_bodies
from ..glass.meshes import components, volume_of
from ..glass.solids import is_one_sided, turned_beside
from .read_mesh import column, has_area, read_local

MOUTH = 1 / 3  # of a mesh's width: a hole that is wider was meant, as the mouth of a vessel is
BENT = 0.01  # between unit normals; those of files are rounded to 1e-3 or less


@dataclass(frozen=True, eq=False)
class Faults:
    """Faults of a mesh as the rig is read: open edges that lie in one place are one.

    n_triangles : in all
    is_flat : (p,) which polygons have triangles without area
    n_flat : how many triangles have none
    is_open : (e,) which edges have one face, or more than two of one body
    is_inner : (p,) which polygons lie within the body that the others make
    one : (v,) the vertex that each counts as
    is_inside_out : do its faces look into it?
    is_vessel : is one of its holes as wide as a mouth?
    is_turned : (p,) which polygons look the other way than most of those that they share vertices
        with, so that normals between them are those of neither
    is_turned_smooth : has one of these normals other than its plane's?
    is_one_sided : has a closed part of it one side only?
    """

    n_triangles: int
    is_flat: Bools
    n_flat: int
    is_open: Bools
    is_inner: Bools
    one: Ints
    is_inside_out: bool
    is_vessel: bool
    is_turned: Bools
    is_turned_smooth: bool
    is_one_sided: bool = False

    @property
    def n_loose(self) -> int:
        """Vertices that another one in the same place stands for."""
        return int((self.one != np.arange(len(self.one))).sum())

    @property
    def n_open(self) -> int:
        return int(self.is_open.sum())


def faults_of(mesh: bpy.types.Mesh) -> Faults:
    """Of a Blender mesh, evaluated or as it is drawn."""
    local = read_local(mesh)
    n = len(local.triangles)
    edges = column(mesh.edges, "vertices", 2, np.int32).astype(np.int64).reshape(-1, 2)
    one = np.arange(len(mesh.vertices))
    if not n or not np.isfinite(local.vertices).all():
        empty = np.zeros(len(mesh.polygons), bool)
        no_edge = np.zeros(len(edges), bool)
        return Faults(n, empty, 0, no_edge, empty, one, False, False, empty, False)

    # one vertex for those that are welded
    mesh.calc_loop_triangles()
    drawn = column(mesh.loop_triangles, "vertices", 3, np.int32).reshape(-1, 3)
    by_loop = column(mesh.loops, "vertex_index", 1, np.int32)
    one[by_loop[local.loops]] = local.triangles

    has_no_area = ~has_area(local.vertices, drawn)
    is_flat = np.zeros(len(mesh.polygons), bool)
    polygons = column(mesh.loop_triangles, "polygon_index", 1, np.int32)
    is_flat[polygons[has_no_area]] = True

    # faces within a body are no part of its surface
    triangles = one[drawn]
    body = np.zeros(len(drawn), np.int64)
    is_whole = (triangles != np.roll(triangles, 1, axis=1)).all(axis=1)
    body[is_whole] = find_bodies(local.vertices, triangles[is_whole])
    is_inner = np.zeros(len(mesh.polygons), bool)
    is_inner[polygons[body < 0]] = True
    drawn, polygons = drawn[body >= 0], polygons[body >= 0]
    is_whole &= body >= 0
    triangles, body = triangles[is_whole], body[is_whole]

    is_turned = np.zeros(len(mesh.polygons), bool)
    polygon = np.repeat(np.arange(len(is_flat)), column(mesh.polygons, "loop_total", 1, np.int32))
    is_turned[polygon[local.loops[turned_beside(local.triangles), 0]]] = True

    is_open = open_edges(one[edges], triangles, body)
    volume = volume_of(local.vertices[triangles])
    one_sided = is_one_sided(triangles)
    is_vessel = _widest_hole(local.vertices, one[edges[is_open]]) > MOUTH
    return Faults(
        n_triangles=n,
        is_flat=is_flat,
        n_flat=int(has_no_area.sum()),
        is_open=is_open,
        is_inner=is_inner,
        one=one,
        is_inside_out=volume < 0,
        is_vessel=is_vessel,
        is_turned=is_turned,
        is_turned_smooth=bool((is_turned[polygon] & _is_bent(mesh, polygon)).any()),
        is_one_sided=one_sided,
    )


def _is_bent(mesh: bpy.types.Mesh, polygon: Ints) -> Bools:
    """Which corners (l,) have another normal than the plane of their polygon (l,)?"""
    plane = column(mesh.polygons, "normal", 3, np.float32)[polygon]
    apart = column(mesh.corner_normals, "vector", 3, np.float32) - plane
    return np.linalg.norm(apart, axis=1) > BENT


def _widest_hole(vertices: Floats, edges: Ints) -> float:
    """The width of the widest hole over that of all vertices (v, 3), the middle side of their box;
    0 where no edge (e, 2) is open. A crack is long and not wide: the mean of its sides counts.
    """
    if not len(edges):
        return 0.0
    ends = edges.ravel()
    hole = components(len(vertices), *edges.T)[ends]
    low, high = np.full(vertices.shape, np.inf), np.full(vertices.shape, -np.inf)
    np.minimum.at(low, hole, vertices[ends])
    np.maximum.at(high, hole, vertices[ends])
    _, middle, longest = np.sort((high - low)[np.unique(hole)], axis=1).T
    across = np.median(np.ptp(vertices, axis=0))
    return float(np.sqrt(middle * longest).max() / across) if across else 0.0


def open_edges(edges: Ints, triangles: Ints, body: Ints) -> Bools:
    """Which edges (e, 2) are those of one triangle, or of more than two of one body (t,), of
    triangles (t, 3).

    An edge of no triangle at all is a wire, which no light meets; one between twice the same
    vertex is a point.
    """
    n = int(max(triangles.max(), edges.max(initial=0))) + 1
    sides = np.stack([triangles, np.roll(triangles, -1, axis=1)], axis=2).reshape(-1, 2)
    keys, edge = np.unique(_keys(sides, n), return_inverse=True)
    of_body, counts = np.unique(
        edge * (int(body.max()) + 1) + np.repeat(body, 3), return_counts=True
    )
    odd = of_body[counts != 2] // (int(body.max()) + 1)
    own = _keys(edges, n)
    is_open = (edges[:, 0] != edges[:, 1]) & np.isin(own, keys[odd])

    # of two edges in one place only the first counts
    _, first = np.unique(own, return_index=True)
    is_first = np.zeros(len(own), bool)
    is_first[first] = True
    return is_open & is_first


def _keys(edges: Ints, n: int) -> Ints:
    return edges.min(axis=1) * n + edges.max(axis=1)
