"""Lines of a part as drawings show them: its contour from one side, its rim, its creases."""

from dataclasses import dataclass

import numpy as np

from ...base.arrays import Floats
from ...base.vectors import cross_2d, dot, length_of, normalise
from ...glass.meshes import Edges, edge_corners, find_edges, geometric_normals
from ...rig.rig import Mesh

CREASE = np.cos(np.radians(30))  # of the angle between two facets: beyond, their edge is drawn


@dataclass(frozen=True, eq=False)
class Rectangle:
    """The smallest rectangle along the longest side of a flat part that holds it.

    corners : (4, 3) m, world: lower left, lower right, upper right, upper left of its image where
        it has one, else as seen from its front
    normal : (3,) unit, to its front
    """

    corners: Floats
    normal: Floats

    @property
    def centre(self) -> Floats:
        """Its middle (3,), m."""
        return self.corners.mean(axis=0)

    @property
    def size(self) -> tuple[float, float]:
        """Its width and height, m."""
        width, height = length_of(np.diff(self.corners[:3], axis=0))
        return float(width), float(height)


def contour(mesh: Mesh, direction: Floats) -> Floats:
    """Edges (e, 2, 3), m, that a drawing of a mesh shows.

    They are the rim, creases of more than 30 degrees that are no smooth surface, and the contour
    against a direction (3,), hidden or not, as glass is seen through.
    """
    edges = find_edges(mesh.triangles)
    corners = mesh.corners
    normals = geometric_normals(corners)

    # where the surface turns away
    is_facing = dot(normals, direction) > 0
    turns = (is_facing[edges.first] != is_facing[edges.second]) ^ edges.is_same_way
    is_smooth = np.zeros(len(corners), bool) if mesh.is_smooth is None else mesh.is_smooth
    is_bent = dot(normals[edges.first], normals[edges.second]) < CREASE
    is_crease = is_bent & ~(is_smooth[edges.first] & is_smooth[edges.second])
    inner, _ = edge_corners(corners, edges)

    return np.concatenate([inner[turns | is_crease], _rim(mesh, edges)])


def _rim(mesh: Mesh, edges: Edges) -> Floats:
    """Edges (e, 2, 3), m, with one triangle, or with more than two; `edges` are all others."""
    is_paired = np.zeros((len(mesh.triangles), 3), bool)
    is_paired[edges.first, edges.corner_first] = True
    is_paired[edges.second, edges.corner_second] = True
    triangle, corner = np.nonzero(~is_paired)
    corners = mesh.corners
    return np.stack([corners[triangle, corner], corners[triangle, (corner + 1) % 3]], axis=1)


def rectangle(mesh: Mesh) -> Rectangle | None:
    """The rectangle around a flat part; None where it is not flat, or has no rim."""
    edges = _rim(mesh, find_edges(mesh.triangles))
    if not (mesh.is_flat and len(edges)):
        return None

    # axes along its longest side
    normal = normalise(geometric_normals(mesh.corners).sum(axis=0))
    sides = edges[:, 1] - edges[:, 0]
    across = normalise(sides[length_of(sides).argmax()])
    axes = np.stack([across, np.cross(normal, across)])

    # its box along them
    points = edges.reshape(-1, 3)
    places = np.einsum("ni,ki->nk", points - points[0], axes)
    (left, low), (right, high) = places.min(axis=0), places.max(axis=0)
    box = np.array([[left, low], [right, low], [right, high], [left, high]])
    corners = points[0] + np.einsum("nk,ki->ni", box, axes)

    return Rectangle(_from_lower_left(corners, mesh), normal)


def _from_lower_left(corners: Floats, mesh: Mesh) -> Floats:
    """Corners (4, 3) that begin at the lower left one: of the
    image, by its UV map, else the lowest and leftmost one.
    """
    if mesh.uv is None:
        return corners

    points = mesh.corners.reshape(-1, 3)
    nearest = [length_of(points - corner).argmin() for corner in corners]
    uv = mesh.uv.reshape(-1, 2)[nearest]
    if cross_2d(uv[1] - uv[0], uv[2] - uv[1]) < 0:  # the map is a mirror image
        corners, uv = corners[::-1], uv[::-1]
    return np.roll(corners, -int(uv.sum(axis=1).argmin()), axis=0)
