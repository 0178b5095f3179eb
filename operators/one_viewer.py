"""One viewer of several, for whom alone the command line solves."""

import bpy

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
