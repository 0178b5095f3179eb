"""Snapshot of all settings that can change a scene's result, read cheaply."""

from collections.abc import Callable
from dataclasses import dataclass
from time import monotonic, thread_time

import bpy

from ..core.blender.data.camera_viewer import frame_of, seats_of
from ..core.blender.data.moving import stamp_of
from ..core.blender.properties.object_settings import ELEMENT
from ..core.blender.read.elements import tone_of
from ..core.blender.read.role_display import primaries_of
from . import needed, work

POLLING = 50.0  # pause between reads, relative to the time of a read


@dataclass(eq=False)
class Polled:
    """Settings of a scene that are polled, because Blender does not report changes by script.

    due : time of the next read, s of `monotonic`
    """

    seen: tuple[object, ...] = ()
    due: float = 0.0

    def have_changed(self, read: Callable[[], tuple[object, ...]]) -> bool:
        """Whether they changed since the last read; not read while a slow read rests."""
        if monotonic() < self.due:
            return False
        started = thread_time()
        before, self.seen = self.seen, read()
        self.due = monotonic() + POLLING * (thread_time() - started)
        return self.seen != before


def chosen_settings(scene: bpy.types.Scene) -> tuple[object, ...]:
    """Values of all of Kiriko's settings."""
    ours = scene.kiriko
    seats = seats_of(scene)
    objects = [
        (
            thing.session_uid,
            o.role,
            o.use_ior,
            o.ior,
            o.dispersion,
            o.abbe,
            o.use_tint,
            tuple(o.tint),
            o.priority,
            o.surface,
            *(frame_of(thing, scene.render) if thing.type == "CAMERA" else o.resolution),
            file_now(o.image),
            tone_of(o.picture),
            o.display.black_level,
            primaries_of(o.display),
            mirrors_of(o),
            *(getattr(o.element, name) for name in ELEMENT),
            *views_of(o),
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
            (
                uid(camera),
                weight,
                file_now(image),
                camera and frame_of(camera, scene.render),
                camera and (camera.kiriko.pupil, camera.kiriko.use_dof),
            )
            for camera, weight, image in seats
        ),
        ours.picture_source,
        tone_of(ours.picture),
        ours.calibration.offset,
        tuple(sorted(objects)),
    )


def file_now(image: bpy.types.Image | None) -> tuple[object, ...]:
    """An image, and for a movie its file's present state."""
    is_movie = image is not None and image.source == "MOVIE"
    return uid(image), stamp_of(image, 1) if is_movie else None


def mirrors_of(ours: bpy.types.PropertyGroup) -> tuple[object, ...]:
    """Mirrors of a plate from its object's settings, if any."""
    if ours.role != "PLATE" or ours.plate.model == "IDEAL":
        return ()
    p = ours.plate
    return p.model, p.pitch, p.height, p.ior, p.reflectance, p.crossing_error, p.fresnel, *p.phase


def views_of(ours: bpy.types.PropertyGroup) -> tuple[object, ...]:
    """Views of a display from its object's settings, if any."""
    of = ours.views
    return (of.columns, of.rows, *of.cone, of.overlap, of.distance) if of.use else ()


def uid(block: bpy.types.ID | None) -> int:
    """Session uid of a datablock, which undo keeps though memory moves; 0 for none."""
    return 0 if block is None else block.session_uid
