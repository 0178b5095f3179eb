"""Outline and creases of glass as a viewer sees them, for glass with the colour of its
background.
"""

from typing import NamedTuple

import numpy as np

from ...base.arrays import Bools, Floats, Ints
from ...rig.mesh import Mesh
from ...rig.viewer import Viewer

CREASE = np.cos(np.radians(30.0))  # neighbouring facets of a curve differ by less
MOST = 500_000  # triangles: larger meshes have no outline, since their edges would block the window


class MeshEdges(NamedTuple):
    """Edges of a mesh: vertices (e, 2) and triangles (e, 2); -1 for the missing one at an open
    edge.
    """

    vertices: Ints
    triangles: Ints


def edges_of(mesh: Mesh) -> MeshEdges:
    """The edges of a mesh; none if it is too large."""
    n = len(mesh.triangles)
    if not 0 < n <= MOST:
        return MeshEdges(np.empty((0, 2), int), np.empty((0, 2), int))
    sides = np.stack([mesh.triangles, np.roll(mesh.triangles, -1, axis=1)], axis=2)
    low, high = np.sort(sides.reshape(-1, 2).astype(np.int64), axis=1).T
    key = low * len(mesh.vertices) + high
    order = np.argsort(key, kind="stable")
    first = np.flatnonzero(np.diff(key[order], prepend=-1))
    is_shared = np.diff(first, append=len(key)) > 1
    other = order[np.minimum(first + 1, len(key) - 1)] // 3
    return MeshEdges(
        np.stack([low, high], axis=1)[order[first]],
        np.stack([order[first] // 3, np.where(is_shared, other, -1)], axis=1),
    )


def contours(mesh: Mesh, edges: MeshEdges, viewer: Viewer) -> Floats:
    """Ends (n, 2, 3) m of open edges, of edges where a body turns away from a viewer, and of
    creases on its front.
    """
    normals, is_front = _facing(mesh, viewer)
    a, b = edges.triangles.T
    is_open = b < 0
    is_turning = is_front[a] != is_front[b]
    is_crease = np.einsum("ni,ni->n", normals[a], normals[b]) < CREASE
    is_drawn = is_open | is_turning | (is_crease & is_front[a])
    return mesh.vertices[edges.vertices[is_drawn]]


def _facing(mesh: Mesh, viewer: Viewer) -> tuple[Floats, Bools]:
    """Unit normals (t, 3) of triangles, and whether each faces the viewer (t,)."""
    corners = mesh.corners
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    if viewer.projection == "orthographic":
        to_viewer = np.broadcast_to(-viewer.axes[2], normals.shape)
    else:
        to_viewer = viewer.position - corners[:, 0]
    length = np.linalg.norm(normals, axis=1, keepdims=True)
    normals = np.divide(normals, length, out=np.zeros_like(normals), where=length > 0)
    return normals, np.einsum("ni,ni->n", normals, to_viewer) > 0
