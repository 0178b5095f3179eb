"""Where a 3D view has to stand so that points fill it, as Blender projects them."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...base.arrays import Floats

FILLED = 0.8  # of the view's half width and height, by the points: names stand beside them
SENSOR = 36.0  # mm, half of a 3D view's at its lens, along the longer side
ROUNDS = 4  # the middle of what is seen moves with the distance
LEAST_LEVEL = 1e-3  # a front that is steeper has no side
LEAST_FREE = 0.2  # of width and height, however much is covered
IMAGE_FILLED = 0.9  # of what is free, by a camera's image
ZOOMS = (-30.0, 600.0)  # that a camera view of Blender's may have
SQRT2 = np.sqrt(2.0)
NEAR = 1e-2  # of the distance: nothing that is framed is cut off, nor what is zoomed to
FAR = 1e2


SIDEWAYS, ABOVE = np.radians(30.0), np.radians(20.0)  # of the way to the viewer, for a turned view
FACING = 0.7  # cosine to the picture's front from which on the picture is well seen


class Framed(NamedTuple):
    """The place that a view turns about, its distance
    from there, and how near and far it has to see.
    """

    centre: Floats
    distance: float
    clip_start: float
    clip_end: float


def turned(axes: Floats, front: Floats) -> Floats:
    """Axes (3, 3) of a view that sees a picture with this front (3,); its own where they do.

    Rows right, up, back. Else it stands beside the viewer, who sees
    the picture straight, and above: there no part hides another.
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
    """The window of a 3D view: pixels of it, and of those at
    its sides that sidebars and headers cover; mm of its lens.
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
    """Frame points in the part of a view that nothing covers; its direction stays.

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
    """Which points (n, 3) lie within what a view shows and nothing covers, wherever things hide
    them.

    axes : (3, 3) rows right, up, back of the view
    stands : where it is; how near and far it sees counts
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
    """Zoom and offset of a camera view in which nothing covers the camera's image (width, height).

    Blender shows as much along the window's longer side as the camera sees along its image's, times
    a factor that it keeps as a zoom.
    """
    size = np.array([window.width, window.height], float)
    shown = size.max() * np.array(image) / max(image)  # at a factor of 1, px
    factor = IMAGE_FILLED * (_free(window) * size / shown).min()
    zoom = float(np.clip(50 * (2 * np.sqrt(factor) - SQRT2), *ZOOMS))
    factor = ((zoom / 50 + SQRT2) / 2) ** 2
    return zoom, (_off_middle(window) / (4 * factor)).tolist()


def _free(window: Window) -> Floats:
    """Shares (2,) of a window's width and height that nothing covers."""
    width = 1 - (window.left + window.right) / window.width
    height = 1 - (window.bottom + window.top) / window.height
    return np.maximum([width, height], LEAST_FREE)


def _off_middle(window: Window) -> Floats:
    """Twice the way from the middle of what is free to the window's, in shares (2,) of its size."""
    x = (window.right - window.left) / window.width
    return np.array([x, (window.top - window.bottom) / window.height])
