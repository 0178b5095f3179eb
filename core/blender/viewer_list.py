"""Changes of a scene's list of viewers, whose first entry is the viewer that the scene has anyway.

The list is empty as long as there is no other: so a file of one viewer is as it always was.
"""

from collections.abc import Container, Iterator
from contextlib import contextmanager

import bpy

from .active_rig import copy_settings
from .viewer import camera_at, number_shown


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


def take_out(
    scene: bpy.types.Scene,
    cameras: Container[bpy.types.Object | None],
    is_first_gone: bool = False,
) -> None:
    """Take the entries of cameras out of the list, but for the first, which is on again: some of
    them may have been in its place.

    is_first_gone : that has lost its camera, and goes, too, where no viewer takes its place, or one
        that is further down in the list as well
    """
    ours = scene.kiriko
    if not len(ours.viewers):
        return
    with changing(scene) as listed:
        for n in reversed(range(1, len(listed))):
            if listed[n].camera in cameras:
                listed.remove(n)
                listed[0].is_on = True
        if is_first_gone and listed[0].camera in (None, *(one.camera for one in listed[1:])):
            listed.remove(0)
            ours.viewer_shown = max(ours.viewer_shown - 1, 0)


def set_aside(scene: bpy.types.Scene) -> None:
    """Have a scene's settings keep its viewers for the time without the rig, and have none."""
    ours = scene.kiriko
    ours.viewer_before = ours.viewer
    ours.viewers_before.clear()
    for one in ours.viewers:
        copy_settings(one, ours.viewers_before.add())
    ours.viewers.clear()
    ours.viewer = None


def bring_back(scene: bpy.types.Scene) -> None:
    """Have the list be as it was set aside, for the viewer that the scene has, and after it whoever
    came into the list since. Cameras that were deleted meanwhile have no entry.
    """
    ours = scene.kiriko
    if len(ours.viewers_before):
        with changing(scene) as listed:
            first, *before = ours.viewers_before
            known = [one.camera for one in listed]
            for name in ("weight", "is_on", "image"):
                setattr(listed[0], name, getattr(first, name))
            others = [one for one in before if is_there(one.camera) and one.camera not in known]
            for n, one in enumerate(others):
                copy_settings(one, listed.add())
                listed.move(len(listed) - 1, n + 1)
            if listed[0].camera is None and len(listed) > 1:
                listed.remove(0)
                ours.viewer_shown = max(ours.viewer_shown - 1, 0)
    ours.viewers_before.clear()
    ours.property_unset("viewer_before")


def is_there(camera: bpy.types.Object | None) -> bool:
    """Is it in a scene, and not only in lists that hold it, as after deleting it?"""
    return camera is not None and bool(camera.users_scene)


def bring_back_by_itself(scene: bpy.types.Scene) -> None:
    """The same once the rig is gone by hand, its collection and its viewer."""
    ours = scene.kiriko
    is_aside = ours.viewer_before is not None or len(ours.viewers_before) > 0
    if not is_aside or (ours.rig and any(c.kiriko.key == ours.rig for c in bpy.data.collections)):
        return

    there = set(scene.objects)
    if ours.viewer in there:
        return
    before = ours.viewer_before
    have_viewer(ours, before if before in there else None)
    cameras = [one.camera for one in ours.viewers]
    take_out(scene, [one for one in cameras if one not in there], camera_at(scene, 0) is None)
    bring_back(scene)
