"""Projective maps from the viewer's pixels to a flat picture, as 3 x 3 matrices.

Lines of sight meet a plane by a projective map, and the UV of a rectangle is an affine map of the
plane. Flat rectangular pictures therefore need no rays.
"""

from dataclasses import dataclass
from typing import NamedTuple
from weakref import WeakKeyDictionary

import numpy as np

from ..base.arrays import Floats
from ..base.errors import RigError
from ..light.display import affine_fit, uv_area
from ..rig.rig import Mesh, PicturePlace, Viewer

# largest deviation from flatness, an affine UV and a rectangle, relative
IS_AFFINE = 1e-6
EDGE_ON = 1e5  # condition of the mapping above which the viewer sees a line
LEAST = 1e-100  # picture px: a narrower footprint is a point


@dataclass(frozen=True, eq=False)
class FlatMapping:
    """Mapping from the viewer's pixels to the UV of a flat picture.

    Parameters
    ----------
    matrix : (3, 3) from (x, y, 1) in viewer px to (u w, v w, w), with w > 0 in front of the viewer
    low, high : (2,) bounds of the picture in UV
    """

    matrix: Floats
    low: Floats
    high: Floats


def flat_mapping(place: PicturePlace, viewer: Viewer) -> FlatMapping | None:
    """Mapping from viewer pixels to the UV of a flat picture, or of the viewer's own image, which
    is unbounded; None for other shapes.
    """
    if place.mesh is None:
        own = np.array([[1 / viewer.width, 0, 0], [0, -1 / viewer.height, 1], [0, 0, 1]])
        return FlatMapping(own, np.full(2, -np.inf), np.full(2, np.inf))
    return mesh_mapping(place.mesh, viewer)


def view_of_picture(place: PicturePlace, viewer: Viewer, uv: Floats) -> Floats:
    """Viewer px (n, 2) of places uv (n, 2; v upward) of the picture, seen without glass.

    Raises
    ------
    RigError : the picture is not a flat rectangle, or is seen edge-on
    """
    mapping = flat_mapping(place, viewer)
    if mapping is None:
        raise not_flat(place)
    if np.linalg.cond(mapping.matrix / np.abs(mapping.matrix).max(axis=0)) > EDGE_ON:
        raise RigError(
            "The picture '{picture}' is seen edge-on: turn it towards the viewer.",
            picture=place.name,
        )
    xyw = np.column_stack([uv, np.ones(len(uv))]) @ np.linalg.inv(mapping.matrix).T
    return xyw[:, :2] / xyw[:, 2:]


def not_flat(place: PicturePlace) -> RigError:
    """Error for a picture that has to be a flat rectangle."""
    return RigError(
        "The picture '{picture}' is not a flat rectangle: choose a flat plane for it.",
        picture=place.name,
    )


def outline_in_view(place: PicturePlace, viewer: Viewer) -> Floats | None:
    """Borders of a flat picture in the viewer's image, without glass.

    Returns
    -------
    (4, 3) a, b, c of lines a x + b y + c = 0 in viewer px, normalised to distances, positive inside
    the picture. None if the picture is not a rectangle, or fills the viewer's image.
    """
    mapping = None if place.mesh is None else mesh_mapping(place.mesh, viewer)
    if mapping is None:
        return None

    u, v, w = mapping.matrix
    low_u, low_v = mapping.low
    high_u, high_v = mapping.high
    lines = np.stack([u - low_u * w, high_u * w - u, v - low_v * w, high_v * w - v])
    return lines / np.maximum(np.linalg.norm(lines[:, :2], axis=1, keepdims=True), LEAST)


def mesh_mapping(mesh: Mesh, viewer: Viewer) -> FlatMapping | None:
    """Mapping from viewer pixels to the UV of a flat rectangle.

    None if the mesh is not flat, its UV is not one affine map, or it is not a rectangle along the
    UV axes.
    """
    if mesh not in _rectangles:
        _rectangles[mesh] = _rectangle_of(mesh)
    rectangle = _rectangles[mesh]
    if rectangle is None:
        return None

    middle, axes, fit, low, high = rectangle
    seen = _points_seen(viewer, middle, axes[2])
    if seen is None:
        return None
    point, w, sign = seen
    matrix = np.vstack([fit[:2].T @ (axes[:2] @ point) + np.outer(fit[2], w), w])
    return FlatMapping((sign or 1.0) * matrix, low, high)


class _Rectangle(NamedTuple):
    """A flat rectangle under its whole UV.

    middle : (3,) m
    axes : (3, 3) two in its plane, and its normal
    fit : (3, 2) UV derivatives along both axes, and UV at the middle
    low, high : (2,) bounds in UV
    """

    middle: Floats
    axes: Floats
    fit: Floats
    low: Floats
    high: Floats


# by mesh, shared by all viewers
_rectangles: WeakKeyDictionary[Mesh, _Rectangle | None] = WeakKeyDictionary()


def _rectangle_of(mesh: Mesh) -> _Rectangle | None:
    """The rectangle of a mesh, or None."""
    corners = mesh.corners.reshape(-1, 3)
    uv = mesh.uv.reshape(-1, 2)
    middle = corners.mean(axis=0)
    _, spread, axes = np.linalg.svd(corners - middle, full_matrices=False)
    if spread[1] == 0 or spread[2] > IS_AFFINE * spread[0]:
        return None

    across = (corners - middle) @ axes[:2].T
    fit, missed = affine_fit(across, uv)
    low = uv.min(axis=0)
    high = uv.max(axis=0)
    if missed > IS_AFFINE * np.ptp(uv, axis=0).max():
        return None

    # a rectangle covers all of its bounds
    covered = uv_area(mesh.uv)
    if abs(covered - np.prod(high - low)) > IS_AFFINE * covered:
        return None

    return _Rectangle(middle, axes, fit, low, high)


def _points_seen(
    viewer: Viewer, middle: Floats, normal: Floats
) -> tuple[Floats, Floats, float] | None:
    """Intersections of rays with a plane, in homogeneous form.

    Returns a matrix (3, 3) from (x, y, 1) to the point relative to the plane's middle, times w; the
    row w (3,); and the sign of w in front of the viewer. None if all rays are parallel to the
    plane.
    """
    left, right, bottom, top = viewer.window
    x, y, forward = viewer.axes

    # the ray through pixel (x, y): from `start @ (x, y, 1)` along `along @ (x, y, 1)`
    plane = np.array(
        [[(right - left) / viewer.width, 0, left], [0, (bottom - top) / viewer.height, top]]
    )
    sideways = np.outer(x, plane[0]) + np.outer(y, plane[1])
    ahead = np.outer(forward, [0, 0, 1.0])
    still = np.outer(viewer.position - middle, [0, 0, 1.0])

    # the intersection, times (along . normal); one of the two factors is constant in (x, y)
    if viewer.projection == "perspective":
        along = sideways + ahead
        depth = -(still[:, 2] @ normal)
        w = normal @ along
        return np.outer(still[:, 2], w) + depth * along, w, np.sign(depth)

    speed = forward @ normal
    if speed == 0:
        return None
    start = still + sideways
    point = speed * start - np.outer(forward, normal @ start)
    return point, np.array([0, 0, speed]), np.sign(speed)
