"""The settings of a scene by which its result may be another, read cheaply."""

from collections.abc import Callable
from dataclasses import dataclass
from time import monotonic, thread_time

import bpy

from ..core.blender.data.camera_viewer import frame_of, seats_of
from ..core.blender.data.moving import stamp_of
from ..core.blender.read.elements import tone_of
from . import needed, work

POLLING = 50.0  # times as long as it took to look at all settings they are not looked at again


@dataclass(eq=False)
class Polled:
    """Settings of a scene that are looked at again and again, for Blender does not tell of them.

    due : when the next look is, s of `monotonic`
    """

    seen: tuple[object, ...] = ()
    due: float = 0.0

    def have_changed(self, read: Callable[[], tuple[object, ...]]) -> bool:
        """Are they others than at the last look? Where that took long they are not read yet."""
        if monotonic() < self.due:
            return False
        started = thread_time()
        before, self.seen = self.seen, read()
        self.due = monotonic() + POLLING * (thread_time() - started)
        return self.seen != before


def chosen_settings(scene: bpy.types.Scene) -> tuple[object, ...]:
    """All that Kiriko's own settings say, cheaply: Blender
    does not tell when a script changes them.
    """
    ours = scene.kiriko
    seats = seats_of(scene)
    objects = [
        (
            thing.session_uid,
            o.role,
            o.use_ior,
            o.ior,
            o.priority,
            o.surface,
            *o.resolution,
            file_now(o.image),
            tone_of(o.picture),
            o.display.black_level,
            mirrors_of(o),
        )
        for things in needed.parts(scene).values()
        for thing in things
        for o in (thing.kiriko,)
    ]
    return (
        work.settings_of(scene),
        *(uid(block) for block in (ours.viewer, scene.camera)),
        file_now(ours.picture_image),
        ours.viewer_shown,
        *(
            (uid(camera), weight, file_now(image), camera and frame_of(camera, scene.render))
            for camera, weight, image in seats
        ),
        ours.picture_source,
        tone_of(ours.picture),
        ours.calibration.offset,
        tuple(sorted(objects)),
    )


def file_now(image: bpy.types.Image | None) -> tuple[object, ...]:
    """An image, and of a movie its file as it is now."""
    is_movie = image is not None and image.source == "MOVIE"
    return uid(image), stamp_of(image, 1) if is_movie else None


def mirrors_of(ours: bpy.types.PropertyGroup) -> tuple[object, ...]:
    """The mirrors of a plate by its object's settings, where it has any."""
    if ours.role != "PLATE" or ours.plate.model == "IDEAL":
        return ()
    p = ours.plate
    return p.model, p.pitch, p.height, p.ior, p.reflectance, p.crossing_error, p.fresnel, *p.phase


def uid(block: bpy.types.ID | None) -> int:
    """The number that a datablock keeps through undo, when its place in memory changes;
    0 for none.
    """
    return 0 if block is None else block.session_uid
