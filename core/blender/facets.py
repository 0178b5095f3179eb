"""Faces of a mesh that is shaded flat where a curve seems meant."""

import bpy
import numpy as np

from ..arrays import Bools, Ints
from .mesh import column

LEAST, MOST = np.radians([0.05, 12.0])  # between neighbours; parts of one flat facet have less
ALIKE = 4.0  # times as large may a neighbour on the same curve be: a bevel's facet is larger
MANY = 400  # hand-cut glass has fewer; a sphere as Blender adds it has 512
WORTH = 0.25  # of the whole area


def n_facets(mesh: bpy.types.Mesh, one: Ints) -> int:
    """How many flat-shaded faces stand for a curve: those with two neighbours of about their size,
    at small angles. 0 where they are few, or a small part of the whole, as on cut crystal.

    one : (v,) the vertex that each counts as: faces may lie edge to edge, each with its own
    """
    if len(mesh.polygons) < MANY or mesh.has_custom_normals:
        return 0
    is_flat = ~column(mesh.polygons, "use_smooth", 1, bool) | _stands_alone(mesh)
    normal = column(mesh.polygons, "normal", 3, np.float32).reshape(-1, 3)
    area = column(mesh.polygons, "area", 1, np.float32)

    a, b = _neighbours(mesh, one)
    # half the angle, whose sine is precise where its cosine is not
    angle = 2 * np.arcsin(np.minimum(np.linalg.norm(normal[a] - normal[b], axis=1) / 2, 1.0))
    is_alike = np.maximum(area[a], area[b]) < ALIKE * np.minimum(area[a], area[b])
    is_near = is_flat[a] & is_flat[b] & is_alike & (angle > LEAST) & (angle < MOST)
    n_near = np.bincount(np.concatenate([a[is_near], b[is_near]]), minlength=len(area))
    is_of_curve = n_near >= 2
    n = int(is_of_curve.sum())
    return n if n >= MANY and area[is_of_curve].sum() > WORTH * area.sum() else 0


def _stands_alone(mesh: bpy.types.Mesh) -> Bools:
    """Which polygons (p,) share no vertex with another: these look flat, shaded smooth, too."""
    vertex = column(mesh.loops, "vertex_index", 1, np.int32)
    is_shared = np.bincount(vertex)[vertex] > 1
    return ~np.logical_or.reduceat(is_shared, column(mesh.polygons, "loop_start", 1, np.int32))


def _neighbours(mesh: bpy.types.Mesh, one: Ints) -> tuple[Ints, Ints]:
    """Polygons (n,) and (n,) on both sides of each edge that has two."""
    edge = column(mesh.loops, "edge_index", 1, np.int32)
    if (one != np.arange(len(one))).any():
        ends = np.sort(one[column(mesh.edges, "vertices", 2, np.int32)], axis=1)
        _, same = np.unique(ends @ [len(one), 1], return_inverse=True)
        edge = same.ravel()[edge]
    polygon = np.repeat(
        np.arange(len(mesh.polygons)), column(mesh.polygons, "loop_total", 1, np.int32)
    )
    order = np.argsort(edge, kind="stable")
    counts = np.bincount(edge, minlength=edge.max() + 1)
    first = (np.cumsum(counts) - counts)[counts == 2]
    return polygon[order[first]], polygon[order[first + 1]]
