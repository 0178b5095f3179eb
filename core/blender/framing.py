"""Where a 3D view has to stand so that points fill it, as Blender projects them."""

from typing import NamedTuple

import numpy as np

from ..arrays import Floats

FILLED = 0.8  # of the view's half width and height, by the points: names stand beside them
SENSOR = 36.0  # mm, half of a 3D view's at its lens, along the longer side
ROUNDS = 4  # the middle of what is seen moves with the distance
LEAST_LEVEL = 1e-3  # a front that is steeper has no side
LEAST_FREE = 0.2  # of the width, however wide the sidebars are
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
    the left and right that sidebars cover; mm of its lens.
    """

    width: int
    height: int
    left: int
    right: int
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
    free = max(1 - (window.left + window.right) / window.width, LEAST_FREE)
    half = FILLED * np.array([free, 1.0])
    seen = points @ axes.T
    middle = (seen.min(axis=0) + seen.max(axis=0)) / 2

    for _ in range(ROUNDS):
        off = seen - middle
        nearer = off[:, 2] if window.is_perspective else np.zeros(len(off))
        distance = float((np.abs(off[:, :2]) * scale / half + nearer[:, None]).max())
        shown = off[:, :2] / np.maximum(distance - nearer, 1e-12 * distance)[:, None]
        middle[:2] += (shown.min(axis=0) + shown.max(axis=0)) / 2 * distance

    middle[0] -= (window.left - window.right) / window.width * distance / scale[0]
    return Framed(middle @ axes, distance, NEAR * distance, FAR * distance)
