"""Tessellation of curved faces into small flat facets."""

import numpy as np

from ..base.arrays import Ints
from ..base.vectors import normalise
from ..rig.rig import Mesh
from .bounding_shell import edge_turns
from .curved import CurvedFaces
from .quartics import grid
from .surfaces import make_surface

USUAL = 0.999  # quantile of the faces' turn: the few with more are ignored


def count_parts(faces: CurvedFaces, angle: float, most: int) -> int:
    """Number of parts an edge needs for a turn of less than `angle`, rad, each; `most` at most."""
    turns = edge_turns(faces).max(axis=1)
    return int(np.clip(np.ceil(np.quantile(turns, USUAL) / angle), 1, most))


def tessellate(mesh: Mesh, angle: float = np.radians(1), most: int = 1_000_000) -> Mesh:
    """The traced surface in triangles with less turn than `angle`, rad.

    Corner normals are those of the curved faces. Flat triangles are split, too, so that no edge
    meets the middle of another, and stay as drawn. Returns the same mesh if nothing is curved.

    Parameters
    ----------
    most : largest number of triangles
    """
    surface = make_surface(mesh)
    curved = surface.curved
    if curved is None:
        return mesh

    k = count_parts(curved, angle, max(1, int(np.sqrt(most / len(mesh.triangles)))))

    weights, parts = grid(k)
    points = np.matmul(weights, surface.corners)
    normals = np.empty((len(mesh.triangles), len(weights), 3))
    normals[:] = surface.normals[:, None]

    if surface.corner_normals is not None:
        bent = surface.is_bent
        normals[bent] = normalise(np.matmul(weights, surface.corner_normals[bent]))

    triangle = curved.triangle
    points[triangle] = curved.points_on(k)

    for i, weight in enumerate(weights):
        u, v = (np.full(len(triangle), w) for w in weight[1:])
        normals[triangle, i] = curved.normals(triangle, u, v)

    index, n_points = _shared_points(mesh.triangles, k)
    vertices = np.empty((max(n_points, len(mesh.vertices)), 3))
    vertices[: len(mesh.vertices)] = mesh.vertices
    vertices[index] = points

    return Mesh(
        vertices,
        index[:, parts].reshape(-1, 3),
        normals[:, parts].reshape(-1, 3, 3),
        np.repeat(surface.is_bent | (curved.row >= 0), k * k),
        surface="facets",
    )


def _shared_points(triangles: Ints, k: int) -> tuple[Ints, int]:
    """Indices (t, n) of the points of grid(k) on triangles (t, 3), shared by neighbours on their
    edge; and the number of points.
    """
    steps = np.round(k * grid(k)[0]).astype(int)
    index = np.empty((len(triangles), len(steps)), np.int64)
    n = int(triangles.max()) + 1
    start = triangles
    end = np.roll(triangles, -1, axis=1)
    key, edge = np.unique(np.minimum(start, end) * n + np.maximum(start, end), return_inverse=True)
    edge = edge.reshape(triangles.shape)
    n_inside = 0

    for i, step in enumerate(steps):
        corner = np.flatnonzero(step == k)
        on_edge = np.flatnonzero(step == 0)

        if len(corner):
            index[:, i] = triangles[:, corner[0]]
        elif len(on_edge):
            e = (on_edge[0] + 1) % 3  # the edge opposite the corner of weight 0
            along = np.where(start[:, e] < end[:, e], step[(e + 1) % 3], step[e])
            index[:, i] = n + edge[:, e] * (k - 1) + along - 1
        else:
            index[:, i] = (
                n + len(key) * (k - 1) + n_inside * len(triangles) + np.arange(len(triangles))
            )
            n_inside += 1

    return index, n + len(key) * (k - 1) + n_inside * len(triangles)
