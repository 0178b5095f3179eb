"""Faces of a mesh that lie on others of it, as Shift D leaves them where nothing is moved."""

import bpy
import numpy as np

from ..base.arrays import Bools
from ..glass.meshes import components
from ..glass.weld import coincident
from .read_mesh import COPIED, column, has_area


def doubled_polygons(mesh: bpy.types.Mesh) -> Bools:
    """Which polygons (p,) of a Blender mesh lie on others before them, and are there for nothing.

    They look the same way: where two bodies touch, faces look opposite ways, and are no doubles.
    Unless each of a body's is there twice, as of one and its inside. Those without area are none.
    """
    points = column(mesh.vertices, "co", 3, np.float32).astype(float).reshape(-1, 3)
    mesh.calc_loop_triangles()
    drawn = column(mesh.loop_triangles, "vertices", 3, np.int32).reshape(-1, 3)
    is_face = np.zeros(len(mesh.polygons), bool)
    polygons = column(mesh.loop_triangles, "polygon_index", 1, np.int32)
    is_face[polygons[has_area(points, drawn)]] = True
    if not is_face.any() or not np.isfinite(points).all():
        return np.zeros_like(is_face)

    # a copy that is turned or mirrored onto the mesh is rounded otherwise
    places = coincident(points, COPIED * float(np.abs(points).max()))
    corners = places[column(mesh.loops, "vertex_index", 1, np.int32)]
    starts = column(mesh.polygons, "loop_start", 1, np.int32)
    following = np.roll(corners, -1)
    lasts = starts + column(mesh.polygons, "loop_total", 1, np.int32) - 1
    following[lasts] = corners[starts]
    # where both ends of an edge are one place, the faces beside it would be doubles of each other
    is_face &= ~np.logical_or.reduceat(corners == following, starts)

    # edges by random numbers: sums over them are the same for the same edges, wherever they begin
    words = np.random.default_rng(0).integers(0, 2**64, (2, len(places)), np.uint64)
    ways = [words[0][a] * words[1][b] for a, b in ((corners, following), (following, corners))]
    forth, back = (np.add.reduceat(way, starts) for way in ways)
    groups = np.unique(forth + back, return_inverse=True)[1]

    # only of a body that is there twice as a whole does it not matter which way faces look
    body = components(len(places), corners, following)[corners[starts]]
    is_single = np.bincount(groups, is_face)[groups] < 2
    has_single = np.bincount(body, is_face & is_single)[body] > 0
    groups = np.where(has_single, forth, forth + back)
    is_double = is_face.copy()
    is_double[np.unique(groups, return_index=True)[1]] = False
    return is_double
