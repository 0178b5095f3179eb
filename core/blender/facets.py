"""Faces of a mesh that look flat where a curve seems meant."""

from typing import NamedTuple

import bpy
import numpy as np

from ..base.arrays import Bools, Floats, Ints
from ..glass.meshes import components
from .read_mesh import column

LEAST, MOST = np.radians([0.05, 12.0])  # between facets; faces of one flat facet have less
ALIKE = 4.0  # times as large may a neighbour on the same curve be: a bevel's facet is larger
MANY = 400  # hand-cut glass has fewer facets; a sphere as Blender adds it has 512
WORTH = 0.25  # of the whole area


class _Sides(NamedTuple):
    """Edges between two polygons: both polygons (n,) and (n,), the angle (n,) between their planes,
    rad, whichever way each is wound, and whether the shading breaks (n,) there.
    """

    a: Ints
    b: Ints
    angle: Floats
    is_broken: Bools


def n_facets(mesh: bpy.types.Mesh, one: Ints) -> int:
    """How many polygons that look flat stand for a curve; 0 if they are few, or a small part of the
    whole, as on cut crystal.

    Coplanar neighbours are one facet, as the two triangles of a quad. A facet of a curve has two
    neighbours of about its size, at small angles, across edges where the shading breaks. The
    shading of imported faces breaks by custom normals, too, and by vertices that are not merged.

    one : (v,) the vertex that each counts as: faces may lie edge to edge, each with its own
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


def _sides(mesh: bpy.types.Mesh, one: Ints) -> _Sides:
    """The edges of a mesh that have two polygons."""
    edge = column(mesh.loops, "edge_index", 1, np.int32)
    if (one != np.arange(len(one))).any():
        ends = np.sort(one[column(mesh.edges, "vertices", 2, np.int32)], axis=1)
        _, same = np.unique(ends @ [len(one), 1], return_inverse=True)
        edge = same.ravel()[edge]
    order = np.argsort(edge, kind="stable")
    counts = np.bincount(edge, minlength=edge.max() + 1)
    first = (np.cumsum(counts) - counts)[counts == 2]
    a, b = order[first], order[first + 1]  # loops

    # the normals at both ends of an edge, as each of its polygons is shaded
    start = column(mesh.polygons, "loop_start", 1, np.int32)
    total = column(mesh.polygons, "loop_total", 1, np.int32)
    after = np.arange(1, len(edge) + 1)
    after[start + total - 1] = start
    corner = column(mesh.corner_normals, "vector", 3, np.float32)
    polygon = np.repeat(np.arange(len(total)), total)
    normal = column(mesh.polygons, "normal", 3, np.float32)
    angle = _angle(normal[polygon[a]], normal[polygon[b]])
    shaded = _angle(corner[a] + corner[after[a]], corner[b] + corner[after[b]])
    return _Sides(polygon[a], polygon[b], angle, shaded > angle / 2)


def _angle(one: Floats, other: Floats) -> Floats:
    """Between the lines along vectors (n, 3), rad, 0 to 90 degrees."""
    with np.errstate(invalid="ignore"):
        one, other = (v / np.linalg.norm(v, axis=1, keepdims=True) for v in (one, other))
    apart = np.minimum(np.linalg.norm(one - other, axis=1), np.linalg.norm(one + other, axis=1))
    # half the angle, whose sine is precise where its cosine is not
    return 2 * np.arcsin(np.minimum(apart / 2, 1.0))
