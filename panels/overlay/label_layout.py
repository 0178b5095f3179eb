"""Label placement: labels avoid each other, Blender's controls and, if possible, the picture."""

from collections.abc import Iterator
from typing import NamedTuple

import bpy
import numpy as np

from ...core.base.arrays import Floats
from ...operators.framing import window_of

GAP_PX = 8  # between a place and its label
LINE = 1.35  # line spacing, in heights of letters
N_LINES = 4  # lines a label may move up or down
# navigation gizmo with its buttons below at the upper right; viewport text at the upper left
BUTTONS_PX = 50, 160
TEXT_INFO_PX = 250, 60
GIZMO_MARGIN_PX = 20


class Obstacles(NamedTuple):
    """Boxes to avoid, boxes of pictures to avoid if possible, and the free part of the region; each
    (2, 2) px.
    """

    fixed: tuple[Floats, ...]
    pictures: tuple[Floats, ...]
    free: Floats


class Sized(NamedTuple):
    """A label with its anchor (2,) and its extent (2,), px."""

    text: str
    place: Floats
    extent: Floats


def controls_of(context: bpy.types.Context) -> Obstacles:
    """The free part of a viewport's region and Blender's controls in it."""
    window = window_of(context.area)
    free = np.array(
        [
            [window.left, window.bottom],
            [window.width - window.right, window.height - window.top],
        ],
        float,
    )
    view, space = context.preferences.view, context.space_data
    scale = context.preferences.system.ui_scale
    (left, _), (right, top) = free
    fixed = []
    if space.show_gizmo and space.show_gizmo_navigate:
        side = (view.gizmo_size_navigate_v3d + GIZMO_MARGIN_PX) * scale
        width, height = np.multiply(BUTTONS_PX, scale)
        fixed.append(np.array([[right - side, top - side], [right, top]]))
        fixed.append(np.array([[right - width, top - side - height], [right, top - side]]))
    if space.overlay.show_text:
        width, height = np.multiply(TEXT_INFO_PX, scale)
        fixed.append(np.array([[left, top - height], [left + width, top]]))
    return Obstacles(tuple(fixed), (), free)


def box_for(
    label: Sized, taken: list[tuple[str, Floats]], obstacles: Obstacles, scale: float
) -> Floats | None:
    """A free box (2, 2) px for a label near its anchor; None if there is no room, or the same text
    is already there.
    """
    for avoided in (obstacles.pictures, ()):
        for box in _tries(label, avoided, scale):
            if not (box[0] >= obstacles.free[0]).all() or not (box[1] <= obstacles.free[1]).all():
                continue
            over = [words for words, other in taken if _overlap(box, other)]
            if label.text in over:
                return None
            if not over and not any(_overlap(box, other) for other in (*obstacles.fixed, *avoided)):
                return box
    return None


def _tries(label: Sized, avoided: tuple[Floats, ...], scale: float) -> Iterator[Floats]:
    """Boxes near the anchor, the nearest first, then boxes above and below the pictures."""
    gap = GAP_PX * scale
    width, height = label.extent
    for n in range(N_LINES + 1):
        for up in {n, -n}:
            y = label.place[1] + gap / 2 + up * LINE * height
            for x in (label.place[0] + gap, label.place[0] - gap - width):
                yield _box(x, y, label.extent)
    for box in avoided:
        for y in (box[1, 1] + gap, box[0, 1] - gap - height):
            yield _box(label.place[0] - width / 2, y, label.extent)


def _box(x: float, y: float, extent: Floats) -> Floats:
    return np.array([[x, y], [x + extent[0], y + extent[1]]])


def _overlap(a: Floats, b: Floats) -> bool:
    return bool((a[0] < b[1]).all() and (b[0] < a[1]).all())
