"""One viewer of several, for whom alone the command line solves, and errors that name one of
several viewers or rigs.
"""

from collections.abc import Iterator
from contextlib import contextmanager

import bpy

from ..core.base.errors import KirikoError, RigError
from ..core.blender.viewer import camera_at
from .viewer_reports import asked_for


def choose_alone(scene: bpy.types.Scene, name: str) -> None:
    """Turn the scene's other viewers off; RigError where none of this name is on."""
    asked_for(scene, [name])
    listed = scene.kiriko.viewers
    for n, one in enumerate(listed):
        camera = camera_at(scene, n)
        one.is_on = one.is_on and camera is not None and camera.name == name
    for n, one in enumerate(listed):
        if one.is_on:
            scene.kiriko.viewer_shown = n


@contextmanager
def naming_rig(name: str | None) -> Iterator[None]:
    """Have errors begin with the name of a rig; with none as they are."""
    try:
        yield
    except KirikoError as error:
        if name is None:
            raise
        raise RigError("Rig '{rig}': {error}", rig=name, error=error.message) from None


@contextmanager
def naming_viewer(name: str | None) -> Iterator[None]:
    """The same with the name of a viewer."""
    try:
        yield
    except KirikoError as error:
        if name is None:
            raise
        raise RigError("Viewer '{viewer}': {error}", viewer=name, error=error.message) from None
