"""Changes of a scene's list of viewers, whose first entry is the viewer that the scene has anyway.

The list is empty as long as there is no other: so a file of one viewer is as it always was.
"""

from collections.abc import Container, Iterator
from contextlib import contextmanager

import bpy

from ..data.camera_viewer import camera_at, number_shown


@contextmanager
def changing(scene: bpy.types.Scene) -> Iterator[bpy.types.bpy_prop_collection]:
    """The list, to be changed: with the first viewer as an entry like any other. One that is the
    scene's camera, as none was chosen, goes on following that while it is the first.
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
    """Have the first entry be the scene's viewer again, and no list be there for it alone.

    followed : the camera that needs no choice to be the viewer
    """
    ours = scene.kiriko
    if len(ours.viewers):
        there = (n for n, one in enumerate(ours.viewers) if one.camera)
        ours.viewers.move(next(there, 0), 0)  # an empty entry is no rig's viewer
        first = ours.viewers[0]
        have_viewer(ours, None if first.camera == followed else first.camera)
        first.camera = None
    if len(ours.viewers) == 1:
        ours.picture_image = ours.viewers[0].image or ours.picture_image
        ours.viewers.clear()
    ours.viewer_shown = number_shown(scene)


def have_viewer(ours: bpy.types.PropertyGroup, camera: bpy.types.Object | None) -> None:
    """Have a scene's settings have a viewer, whose entry is on or off as it was: one that a script
    or an artist sets is turned on.
    """
    before = ours.viewer_shown, [one.is_on for one in ours.viewers]
    ours.viewer = camera
    ours.viewer_shown = before[0]
    for one, is_on in zip(ours.viewers, before[1], strict=True):
        one.is_on = is_on


def add(scene: bpy.types.Scene, cameras: list[bpy.types.Object]) -> None:
    """Put cameras into the list; the first of them is the one that is shown."""
    with changing(scene) as listed:
        scene.kiriko.viewer_shown = len(listed)
        for camera in cameras:
            listed.add().camera = camera


def take_out(scene: bpy.types.Scene, cameras: Container[bpy.types.Object | None]) -> None:
    """Take the entries of cameras out of the list, but for the first, which is on again: some of
    them may have been in its place.
    """
    if not len(scene.kiriko.viewers):
        return
    with changing(scene) as listed:
        for n in reversed(range(1, len(listed))):
            if listed[n].camera in cameras:
                listed.remove(n)
                listed[0].is_on = True
