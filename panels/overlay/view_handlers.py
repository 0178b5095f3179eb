"""Shared by all that is drawn over 3D views: the handlers, and the shader of images."""

from collections.abc import Callable

import bpy
import numpy as np
from numpy.typing import NDArray

from ...core.blender.data.colour import from_rec709

# since 5.0 the shader puts linear colours into those of the screen; before that Blender did, with
# all that is drawn within a viewport, and there was no other shader
IMAGE_SHADER = "IMAGE_SCENE_LINEAR_TO_REC709_SRGB" if bpy.app.version >= (5, 0) else "IMAGE"
# the same times a colour
TINTED_SHADER = (
    "IMAGE_COLOR_SCENE_LINEAR_TO_REC709_SRGB" if bpy.app.version >= (5, 0) else "IMAGE_COLOR"
)


def for_shader(pixels: NDArray[np.float32]) -> NDArray[np.float32]:
    """Linear Rec.709 pixels as the shader takes them: since 5.0 in the working space."""
    return from_rec709(pixels) if bpy.app.version >= (5, 0) else pixels


class ViewHandlers:
    """Functions that Blender calls for each 3D view, each in the scene or over its pixels."""

    def __init__(self, **when: Callable[[], None]) -> None:
        self._when = when
        self._handles: list[object] = []

    def begin(self) -> None:
        """Draw from now on."""
        for when, function in self._when.items():
            handle = bpy.types.SpaceView3D.draw_handler_add(function, (), "WINDOW", when)
            self._handles.append(handle)

    def end(self) -> None:
        """Draw no more."""
        while self._handles:
            bpy.types.SpaceView3D.draw_handler_remove(self._handles.pop(), "WINDOW")
