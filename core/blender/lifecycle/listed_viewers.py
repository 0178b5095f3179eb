"""Changes of a scene's list of viewers; the first entry is the scene's own viewer.

The list is empty while there is only one viewer.
"""

from collections.abc import Container, Iterator
from contextlib import contextmanager

import bpy

from ..data.camera_viewer import camera_at, number_shown


@contextmanager
def changing(scene: bpy.types.Scene) -> Iterator[bpy.types.bpy_prop_collection]:
    """The list to change, with the first viewer as an ordinary entry. If none was chosen, the first
    entry keeps following the scene's camera.
    """
    ours = scene.kiriko
    first = camera_at(scene, 0)
    if not len(ours.viewers):
        ours.viewers.add()
    follows = ours.viewer is None and ours.viewers[0].camera is None
    ours.viewers[0].camera = first
    try:
        yield ours.viewers
    finally:
        _settle(scene, scene.camera if follows else None)


def _settle(scene: bpy.types.Scene, followed: bpy.types.Object | None) -> None:
    """Make the first entry the scene's viewer again, and clear the list if it is alone.

    followed : the camera that is the viewer without a choice
    """
    ours = scene.kiriko
    if len(ours.viewers):
        there = (n for n, one in enumerate(ours.viewers) if one.camera)
        ours.viewers.move(next(there, 0), 0)  # an empty entry cannot be the rig's viewer
        first = ours.viewers[0]
        have_viewer(ours, None if first.camera == followed else first.camera)
        first.camera = None
    if len(ours.viewers) == 1:
        ours.picture_image = ours.viewers[0].image or ours.picture_image
        ours.viewers.clear()
    ours.viewer_shown = number_shown(scene)


def have_viewer(ours: bpy.types.PropertyGroup, camera: bpy.types.Object | None) -> None:
    """Set the viewer without turning its entry on, as setting it by hand does."""
    before = ours.viewer_shown, [one.is_on for one in ours.viewers]
    ours.viewer = camera
    ours.viewer_shown = before[0]
    for one, is_on in zip(ours.viewers, before[1], strict=True):
        one.is_on = is_on


def add(scene: bpy.types.Scene, cameras: list[bpy.types.Object]) -> None:
    """Add cameras to the list, and show the first of them."""
    with changing(scene) as listed:
        scene.kiriko.viewer_shown = len(listed)
        for camera in cameras:
            listed.add().camera = camera


def take_out(scene: bpy.types.Scene, cameras: Container[bpy.types.Object | None]) -> None:
    """Remove the entries of cameras from the list, except the first, which is on again: they may
    have replaced it.
    """
    if not len(scene.kiriko.viewers):
        return
    with changing(scene) as listed:
        for n in reversed(range(1, len(listed))):
            if listed[n].camera in cameras:
                listed.remove(n)
                listed[0].is_on = True
