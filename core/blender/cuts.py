"""Faces of glass that cut each other within one shell, or where one of them is open.

A closed shell that cuts itself counts as one body (core/light/layer_hits.py), which Cycles shows
otherwise; nothing tells the inside of an open one that cuts another. Closed shells may overlap:
each is a solid of its own.
"""

from dataclasses import dataclass

import bpy
import numpy as np
from mathutils.bvhtree import BVHTree

from ..base.arrays import Bools, Floats, Ints
from ..base.vectors import dot
from ..glass.meshes import geometric_normals
from ..glass.solids import split_shells
from ..rig.mesh import Mesh
from .read_mesh import column, read_local


@dataclass(frozen=True)
class Search:
    """How cuts are sought; tried on balls, displaced ones and 20 000 random triangles, all in a
    second.

    deep : of the mesh's size: cuts that are less deep are rounding
    most_triangles : of a mesh that is looked at
    most_pairs : of triangles whose boxes meet: where there are more those of some are asked
    asked : how many are asked at first, and then, to tell how many pairs there are
    """

    deep: float = 1e-6
    most_triangles: int = 300_000
    most_pairs: int = 300_000
    asked: tuple[int, ...] = (32, 1024)


SEARCH = Search()


def cut_polygons(mesh: bpy.types.Mesh) -> Bools:
    """Which polygons (p,) of a Blender mesh are cut by others.

    Of a mesh that is a tangle as a whole only some are found; one too large to be looked at
    in a second has none.
    """
    is_cut = np.zeros(len(mesh.polygons), bool)
    local = read_local(mesh)
    n = len(local.triangles)
    if not 1 < n <= SEARCH.most_triangles or not np.isfinite(local.vertices).all():
        return is_cut

    pairs = cutting(local)
    mesh.calc_loop_triangles()
    polygons = column(mesh.loop_triangles, "polygon_index", 1, np.int32)
    is_cut[polygons[pairs.ravel()]] = True
    return is_cut


def cutting(mesh: Mesh) -> Ints:
    """Pairs (k, 2) of triangles that cut each other within one shell, or one of them open."""
    vertices = mesh.vertices - mesh.vertices.mean(axis=0)
    size = float(np.abs(vertices).max())
    pairs = _near(vertices, mesh.triangles)
    corners = vertices[mesh.triangles]
    pairs = pairs[cuts(corners[pairs[:, 0]], corners[pairs[:, 1]], SEARCH.deep * size)]
    if not len(pairs):
        return pairs

    shells = [chosen for chosen, _ in split_shells(mesh)]
    drawn = np.concatenate(shells)
    number = np.repeat(np.arange(len(shells)), [len(chosen) for chosen in shells])
    shell = np.zeros(len(corners), np.int64)
    shell[drawn] = number
    of = shell[pairs]
    is_open = open_shells(mesh.triangles[drawn], number)
    return pairs[(of[:, 0] == of[:, 1]) | is_open[of].any(axis=1)]


def open_shells(triangles: Ints, shell: Ints) -> Bools:
    """Which shells (s,) have edges of one triangle or of more than two? Triangles (t, 3) of shells
    numbered (t,) from 0.

    All at once: a tangle may have as many shells as triangles.
    """
    start, end = triangles.ravel(), np.roll(triangles, -1, axis=1).ravel()
    edges = np.stack([np.maximum(start, end), np.minimum(start, end), np.repeat(shell, 3)])
    edges = edges[:, np.lexsort(edges)]
    begins = np.flatnonzero(np.r_[True, (edges[:, 1:] != edges[:, :-1]).any(axis=0)])
    counts = np.diff(np.r_[begins, edges.shape[1]])
    is_open = np.zeros(shell.max() + 1, bool)
    is_open[edges[2, begins[counts != 2]]] = True
    return is_open


def _near(vertices: Floats, triangles: Ints) -> Ints:
    """Pairs (k, 2) of triangles that meet without a common edge, of which each counts once.

    A search cannot be stopped, so that the number is told by some first.
    """
    tree = _tree(vertices, triangles)
    order = np.random.default_rng(0).permutation(len(triangles))
    for n in SEARCH.asked:
        some = order[:n]
        found = _tree(vertices, triangles[some]).overlap(tree)
        if len(found) * len(order) > SEARCH.most_pairs * len(some) * _NEIGHBOURS:
            pairs = np.array(found)
            return np.stack([some[pairs[:, 0]], pairs[:, 1]], axis=1)

    pairs = np.array(tree.overlap(tree), np.int64).reshape(-1, 2)
    return np.unique(np.sort(pairs, axis=1), axis=0)


_NEIGHBOURS = 13  # triangles that meet one at its corners and edges, on a usual mesh, and itself


def _tree(vertices: Floats, triangles: Ints) -> BVHTree:
    return BVHTree.FromPolygons(vertices.tolist(), triangles.tolist(), all_triangles=True)


def cuts(a: Floats, b: Floats, deep: float) -> Bools:
    """Do triangles a and b (k, 3, 3) cut each other, along more than a length (Moller 1997)?

    Both have to pass through the other's plane by as much: those that touch do not cut.
    """
    normals = geometric_normals(a), geometric_normals(b)
    off_b = dot(a - b[:, :1], normals[1][:, None])
    off_a = dot(b - a[:, :1], normals[0][:, None])
    passes = [(off.max(axis=1) > deep) & (off.min(axis=1) < -deep) for off in (off_a, off_b)]

    # along the line that is in both planes
    line = np.cross(*normals)
    length = np.linalg.norm(line, axis=1, keepdims=True)
    line = line / np.maximum(length, np.finfo(float).tiny)
    low_a, high_a = _crossed(dot(a, line[:, None]), off_b)
    low_b, high_b = _crossed(dot(b, line[:, None]), off_a)
    along = np.minimum(high_a, high_b) - np.maximum(low_a, low_b)
    return passes[0] & passes[1] & (along > deep)


def _crossed(along: Floats, off: Floats) -> tuple[Floats, Floats]:
    """Where triangles cross a plane: from and to (k,), by places
    along a line in it and distances from it (k, 3) of their corners.
    """
    next_along, next_off = np.roll(along, -1, axis=1), np.roll(off, -1, axis=1)
    crosses = (off * next_off <= 0) & (off != next_off)
    share = off / np.where(crosses, off - next_off, 1.0)
    at = along + share * (next_along - along)
    return (
        np.where(crosses, at, np.inf).min(axis=1),
        np.where(crosses, at, -np.inf).max(axis=1),
    )
