"""Placement of a 3D view so that points fill it, with Blender's projection."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...base.arrays import Floats

FILLED = 0.8  # part of the half width and height for the points; names need the rest
SENSOR = 36.0  # mm: half the longer side of Blender's viewport sensor
ROUNDS = 4  # the centre of the visible part moves with the distance
LEAST_LEVEL = 1e-3  # a steeper front has no side
LEAST_FREE = 0.2  # of width and height, even if more is covered
IMAGE_FILLED = 0.9  # part of the free area for a camera's image
ZOOMS = (-30.0, 600.0)  # Blender's limits of a camera view's zoom
SQRT2 = np.sqrt(2.0)
NEAR = 1e-2  # of the distance: clip planes far enough for framed points and for zooming
FAR = 1e2


SIDEWAYS, ABOVE = (
    np.radians(30.0),
    np.radians(20.0),
)  # of a turned view, from the direction of the viewer
FACING = 0.7  # cosine to the picture's front; from here on the picture is visible enough


class Framed(NamedTuple):
    """Pivot, distance from it, and clip distances of a view."""

    centre: Floats
    distance: float
    clip_start: float
    clip_end: float


def turned(axes: Floats, front: Floats) -> Floats:
    """Axes (3, 3), rows right, up, back, of a view of a picture with this front (3,). They stay the
    same if the picture is visible already. Otherwise the view is from the side of the viewer and
    from above, so that no part hides another.
    """
    if axes[2] @ front >= FACING:
        return axes

    level = np.array([front[0], front[1], 0.0])
    length = np.linalg.norm(level)
    x, y = level[:2] / length if length > LEAST_LEVEL else (0.0, -1.0)
    c, s = np.cos(SIDEWAYS), np.sin(SIDEWAYS)
    back = np.array([c * x - s * y, s * x + c * y, 0.0]) * np.cos(ABOVE)
    back[2] = np.sin(ABOVE)
    right = np.cross([0.0, 0.0, 1.0], back)
    right /= np.linalg.norm(right)

    return np.stack([right, np.cross(back, right), back])


class Window(NamedTuple):
    """Window of a 3D view: its size, the margins under sidebars and headers, px; focal length,
    mm.
    """

    width: int
    height: int
    left: int
    right: int
    bottom: int
    top: int
    lens: float
    is_perspective: bool


def framed(points: Floats, axes: Floats, window: Window) -> Framed:
    """Frame points in the free part of a view; its direction stays.

    Parameters
    ----------
    points : (n, 3) Blender units
    axes : (3, 3) rows right, up, back of the view
    """
    size = np.array([window.width, window.height], float)
    scale = window.lens / SENSOR * size.max() / size
    half = FILLED * _free(window)
    seen = points @ axes.T
    middle = (seen.min(axis=0) + seen.max(axis=0)) / 2

    for _ in range(ROUNDS):
        off = seen - middle
        nearer = off[:, 2] if window.is_perspective else np.zeros(len(off))
        distance = float((np.abs(off[:, :2]) * scale / half + nearer[:, None]).max())
        shown = off[:, :2] / np.maximum(distance - nearer, 1e-12 * distance)[:, None]
        middle[:2] += (shown.min(axis=0) + shown.max(axis=0)) / 2 * distance

    middle[:2] += _off_middle(window) * distance / scale
    return Framed(middle @ axes, distance, NEAR * distance, FAR * distance)


def in_sight(points: Floats, axes: Floats, stands: Framed, window: Window) -> NDArray[np.bool_]:
    """Mask (n,) of the points (n, 3) in the free part of a view, whether or not objects hide them.

    axes : (3, 3) rows right, up, back of the view
    stands : placement of the view, including its clip distances
    """
    size = np.array([window.width, window.height], float)
    scale = window.lens / SENSOR * size.max() / size
    x, y, nearer = ((points - stands.centre) @ axes.T).T
    away = stands.distance - nearer
    shown = np.stack([x, y]) * scale[:, None] / (away if window.is_perspective else stands.distance)
    covered = (
        2 * np.array([[window.left, window.right], [window.bottom, window.top]]) / size[:, None]
    )
    is_within = (shown > covered[:, :1] - 1) & (shown < 1 - covered[:, 1:])
    is_before = (away > stands.clip_start) & (away < stands.clip_end)
    return is_within.all(axis=0) & (is_before if window.is_perspective else True)


def image_framed(image: tuple[int, int], window: Window) -> tuple[float, list[float]]:
    """Zoom and offset of a camera view with the camera's image (width, height) in the free part.

    Blender maps the longer side of the image to the longer side of the window, times a zoom factor.
    """
    size = np.array([window.width, window.height], float)
    shown = size.max() * np.array(image) / max(image)  # px at a factor of 1
    factor = IMAGE_FILLED * (_free(window) * size / shown).min()
    zoom = float(np.clip(50 * (2 * np.sqrt(factor) - SQRT2), *ZOOMS))
    factor = ((zoom / 50 + SQRT2) / 2) ** 2
    return zoom, (_off_middle(window) / (4 * factor)).tolist()


def _free(window: Window) -> Floats:
    """Free fractions (2,) of a window's width and height."""
    width = 1 - (window.left + window.right) / window.width
    height = 1 - (window.bottom + window.top) / window.height
    return np.maximum([width, height], LEAST_FREE)


def _off_middle(window: Window) -> Floats:
    """Twice the offset (2,) from the centre of the free part to the window's centre, in window
    sizes.
    """
    x = (window.right - window.left) / window.width
    return np.array([x, (window.top - window.bottom) / window.height])
