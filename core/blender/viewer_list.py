"""Changes of a scene's list of viewers, whose first entry is the viewer that the scene has anyway.

The list is empty as long as there is no other: so a file of one viewer is as it always was.
"""

from collections.abc import Container, Iterator
from contextlib import contextmanager

import bpy

from .viewer import camera_at, number_shown


@contextmanager
def changing(scene: bpy.types.Scene) -> Iterator[bpy.types.bpy_prop_collection]:
    """The list, to be changed: with the first viewer as an entry like any other."""
    ours = scene.kiriko
    first = camera_at(scene, 0)
    if not len(ours.viewers):
        ours.viewers.add()
    ours.viewers[0].camera = first
    try:
        yield ours.viewers
    finally:
        _settle(scene)


def _settle(scene: bpy.types.Scene) -> None:
    """Have the first entry be the scene's viewer again, and no list be there for it alone."""
    ours = scene.kiriko
    if len(ours.viewers):
        there = (n for n, one in enumerate(ours.viewers) if one.camera)
        ours.viewers.move(next(there, 0), 0)  # an empty entry is no rig's viewer
        first = ours.viewers[0]
        ours.viewer, first.camera = first.camera, None
    if len(ours.viewers) == 1:
        ours.picture_image = ours.viewers[0].image or ours.picture_image
        ours.viewers.clear()
    ours.viewer_shown = number_shown(scene)


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
