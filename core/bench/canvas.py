"""The picture as a surface in space, with a place for each part of it: where the viewer is to see
which part of the image.

A picture on a plane is there where it stands. One in the viewer's own pixels stands nowhere: it is
taken to stand across the view, as far away as the glass.
"""

from dataclasses import dataclass

import numpy as np

from ..base.arrays import Bools, Floats
from ..base.vectors import length_of
from ..light.display import affine_fit, uv_area
from ..rig.rig import Mesh, PicturePlace, Viewer

CORNERS = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
MIDDLE = np.array([[0.5, 0.5]])
SPLIT = np.array([[0, 1, 2], [0, 2, 3]])
RECTANGLE = 1e-6  # of its size: how flat, affine and whole a picture is that counts as a rectangle
OFF_TRIANGLE = 1e-9  # barycentric: a place so far beyond all triangles is still on the picture


@dataclass(frozen=True, eq=False)
class Canvas:
    """A picture's triangles in space, with the place of each of their corners on the image.

    corners : (t, 3, 3) m, world
    uv : (t, 3, 2) on the picture, 0..1 over all of it, v upward
    """

    corners: Floats
    uv: Floats

    def points(self, places: Floats) -> tuple[Floats, Bools]:
        """Points (n, 3) m of places (n, 2) on the image, and are they on the picture (n,)?

        Beyond the picture's triangles the point is the nearest one's at that place.
        """
        best = np.full(len(places), -np.inf)
        points = np.full((len(places), 3), np.nan)
        with np.errstate(divide="ignore", invalid="ignore"):
            for corners, uv in zip(self.corners, self.uv, strict=True):
                weights = _weights(places, uv)
                inside = weights.min(axis=1)
                is_better = inside > best
                best[is_better] = inside[is_better]
                points[is_better] = weights[is_better] @ corners
        return points, best >= -OFF_TRIANGLE

    @property
    def size(self) -> tuple[float, float]:
        """Width and height, m, along its lower and its left edge."""
        points, _ = self.points(CORNERS)
        return float(length_of(points[1] - points[0])), float(length_of(points[3] - points[0]))


def _weights(places: Floats, uv: Floats) -> Floats:
    """Barycentric weights (n, 3) of places (n, 2) in a triangle (3, 2); not finite without area."""
    a, b = uv[1] - uv[0], uv[2] - uv[0]
    p = places - uv[0]
    area = a[0] * b[1] - a[1] * b[0]
    u = (p[:, 0] * b[1] - p[:, 1] * b[0]) / area
    v = (a[0] * p[:, 1] - a[1] * p[:, 0]) / area
    return np.stack([1 - u - v, u, v], axis=1)


def canvas_of(picture: PicturePlace, viewer: Viewer | None, towards: Floats) -> Canvas | None:
    """The canvas of a picture; None where it stands nowhere.

    Parameters
    ----------
    towards : (3,) m, the middle of the glass, by which a picture in the viewer's pixels stands
    """
    if picture.mesh is not None:
        return _of_mesh(picture.mesh)
    if viewer is None:
        return None

    forward = viewer.axes[2]
    size = np.array([viewer.width, viewer.height])
    origins, directions = viewer.rays(np.abs(CORNERS - [0, 1]) * size)
    depth = float((towards - viewer.position) @ forward)
    if not depth > 0:
        return None

    corners = origins + (depth / (directions @ forward))[:, None] * directions
    return Canvas(corners[SPLIT], CORNERS[SPLIT])


def _of_mesh(mesh: Mesh) -> Canvas | None:
    """A mesh whose UV map is stretched over the whole image's square."""
    if mesh.uv is None or not len(mesh.triangles):
        return None
    flat = mesh.uv.reshape(-1, 2)
    low = flat.min(axis=0)
    extent = flat.max(axis=0) - low
    if not (np.isfinite(mesh.corners).all() and np.isfinite(extent).all() and extent.all()):
        return None

    canvas = Canvas(mesh.corners, (mesh.uv - low) / extent)
    return _as_rectangle(canvas) if len(mesh.triangles) > 2 else canvas


def _as_rectangle(canvas: Canvas) -> Canvas:
    """A flat rectangle of many triangles as one of two, in which places
    are found quickly; any other canvas as it is.
    """
    corners = canvas.corners.reshape(-1, 3)
    fit, missed = affine_fit(canvas.uv.reshape(-1, 2), corners)
    is_flat = missed <= RECTANGLE * np.ptp(corners, axis=0).max()
    if not (is_flat and abs(uv_area(canvas.uv) - 1) <= RECTANGLE):
        return canvas
    ends = np.column_stack([CORNERS, np.ones(4)]) @ fit
    return Canvas(ends[SPLIT], CORNERS[SPLIT])


def sight_lines(viewer: Viewer, points: Floats) -> tuple[Floats, Floats, Floats, Bools]:
    """Rays from a viewer to points (n, 3) m: origins, directions, distances (n,), and are
    the points within its image (n,)?

    Those of points behind it run along its axis.
    """
    xy = viewer.project(points)
    size = np.array([viewer.width, viewer.height])
    slack = OFF_TRIANGLE * size
    with np.errstate(invalid="ignore"):
        is_seen = ((xy >= -slack) & (xy <= size + slack)).all(axis=1)

    origins, directions = viewer.rays(np.where(np.isfinite(xy), xy, size / 2))
    distances = np.einsum("ni,ni->n", points - origins, directions)
    return origins, directions, np.where(np.isfinite(xy).all(axis=1), distances, np.nan), is_seen


def outline_of(corners: Floats) -> Floats:
    """The edges (e, 2, 3) of triangles (t, 3, 3) that no other of them shares."""
    edges = np.stack([corners, np.roll(corners, -1, axis=1)], axis=2).reshape(-1, 2, 3)
    # the same number for the same place, whichever triangle has it
    _, place = np.unique(edges.reshape(-1, 3), axis=0, return_inverse=True)
    ends = np.sort(place.reshape(-1, 2), axis=1)
    _, number, count = np.unique(ends, axis=0, return_inverse=True, return_counts=True)
    return edges[count[number.ravel()] == 1]
