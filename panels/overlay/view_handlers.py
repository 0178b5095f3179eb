"""Draw handlers of 3D views, and the shader for images."""

from collections.abc import Callable

import bpy
import numpy as np
from numpy.typing import NDArray

from ...core.blender.data.colour import from_rec709

# from 5.0 on this shader converts linear colours for the screen; before 5.0 Blender converted
# everything drawn in a viewport
IMAGE_SHADER = "IMAGE_SCENE_LINEAR_TO_REC709_SRGB" if bpy.app.version >= (5, 0) else "IMAGE"
# the same with a tint
TINTED_SHADER = (
    "IMAGE_COLOR_SCENE_LINEAR_TO_REC709_SRGB" if bpy.app.version >= (5, 0) else "IMAGE_COLOR"
)


def for_shader(pixels: NDArray[np.float32]) -> NDArray[np.float32]:
    """Linear Rec.709 pixels in the colour space of the shader: from 5.0 on the working space."""
    return from_rec709(pixels) if bpy.app.version >= (5, 0) else pixels


class ViewHandlers:
    """Functions Blender calls for each 3D view, within the scene or over its pixels."""

    def __init__(self, **when: Callable[[], None]) -> None:
        self._when = when
        self._handles: list[object] = []

    def begin(self) -> None:
        """Start drawing."""
        for when, function in self._when.items():
            handle = bpy.types.SpaceView3D.draw_handler_add(function, (), "WINDOW", when)
            self._handles.append(handle)

    def end(self) -> None:
        """Stop drawing."""
        while self._handles:
            bpy.types.SpaceView3D.draw_handler_remove(self._handles.pop(), "WINDOW")
