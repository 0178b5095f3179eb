"""Reads the evaluated scene into a Rig, as Blender shows it at this frame, in metres and float64.

Modifiers, parents, constraints and instances have been applied by the depsgraph;
this file sorts objects by role, and notes those that it leaves out.
"""

from dataclasses import dataclass, replace
from typing import Any

import bpy
import numpy as np

from ..base.arrays import Floats
from ..base.errors import KirikoError, RigError
from ..base.messages import Message
from ..bench.offset import with_offset
from ..rig.rig import ROLES, Picture, Rig, Viewer
from .elements import MaterialReading
from .lost_data import find_lost, refuse_lost
from .parts import Part, parts_by_role, read_parts
from .rectangle import flat_size
from .remarks import modifier_notes, scene_notes
from .roles import in_blender
from .shapes import Kept
from .stored_records import Offset
from .units import length_of_unit
from .viewer import Seat, is_deleted, no_camera, read_viewer, seats_of, shown_first
from .viewer_image import read_in_own_pixels
from .visibility import is_placed


@dataclass(frozen=True)
class Reading:
    """A scene as read.

    rig : with a calibration's result, where that is kept as an offset
    drawn : as the scene shows it, without
    display_size : width and height in m of a flat display, over the whole UV square
    display_object : name of the object that is the display, or makes it as an instance, and the
        file that it is linked from, as `bpy.data.objects` takes both
    solved_for : the scene's fingerprint, as text, where it was read to be solved
    """

    rig: Rig
    drawn: Rig
    materials: tuple[MaterialReading, ...]
    notes: tuple[str, ...]
    display_size: tuple[float, float] | None
    display_object: tuple[str, str | None]
    solved_for: str = ""


def read(
    source: bpy.types.Context | bpy.types.Depsgraph,
    scene: bpy.types.Scene | None = None,
    kept: Kept | None = None,
) -> Reading:
    """Read the rig of a scene as it stands at this frame.

    Nothing is changed in the scene. Errors of the rig as a whole are left to `Rig.check`.

    Parameters
    ----------
    source : the context, or a depsgraph of the scene
    scene : whose settings count; the depsgraph's own when None
    kept : meshes and pixels that need not be read again; nothing when None

    Raises
    ------
    RigError : the viewer's camera or the picture plane cannot be
        used, or a part that the rig needs is hidden
    ImageError : the picture has no pixels
    """
    drawn = read_drawn(source, scene, kept)
    scene = source.scene if scene is None else scene
    rig, remarks = calibrated_rig(drawn.rig, scene)
    return replace(
        drawn,
        rig=shown_first(rig, scene),
        drawn=shown_first(drawn.rig, scene),
        notes=tuple(dict.fromkeys([*drawn.notes, *remarks])),
    )


def read_drawn(
    source: bpy.types.Context | bpy.types.Depsgraph,
    scene: bpy.types.Scene | None = None,
    kept: Kept | None = None,
) -> Reading:
    """The same, as the scene shows it: without a calibration's result, whose amounts are along the
    axes of the first viewer, and so with the viewers in their order.
    """
    depsgraph = (
        source.evaluated_depsgraph_get() if isinstance(source, bpy.types.Context) else source
    )
    scene = depsgraph.scene if scene is None else scene
    kept = kept or Kept()
    is_image = scene.kiriko.picture_source == "IMAGE"
    needed = tuple(
        role.name
        for role in ROLES
        if (role.remedy or role.is_missed)
        and role.number is not None
        and not (role.name == "PICTURE" and is_image)
    )
    metres = length_of_unit(scene)
    seats = seats_of(scene)
    images = [scene.kiriko.picture_image, *(seat.image for seat in seats)] if is_image else []
    refuse_lost(find_lost(), [*(seat.camera for seat in seats), *images])
    parts, notes = read_parts(depsgraph, scene, metres, kept, needed)
    viewers = read_viewers(depsgraph, scene)

    # each part as its role reads it
    by_role = parts_by_role(parts)
    found: dict[str, list[Any]] = {}
    materials = []

    for role in (role for role in ROLES if role.number is not None):
        found[role.field] = []
        if role.name == "PICTURE" and is_image:
            found[role.field], remarks = _read_image(scene, viewers, by_role[role.name], kept)
            notes += remarks
            continue

        for part in by_role[role.name]:
            as_read = in_blender(role.name).read(part, kept)
            found[role.field].append(as_read.part)
            notes += as_read.notes
            materials += as_read.materials

    cameras = [seat.camera for seat in seats]
    notes += modifier_notes(parts) + scene_notes(depsgraph, scene, parts, cameras)
    rig = Rig(
        viewers=viewers,
        **{field: tuple(members) for field, members in found.items()},
    )
    displays = by_role["DISPLAY"]
    return Reading(
        rig=rig,
        drawn=rig,
        materials=tuple(dict.fromkeys(materials)),
        notes=tuple(dict.fromkeys(notes)),
        display_size=flat_size(displays[0].mesh) if len(displays) == 1 else None,
        display_object=next((_place_in_file(part.owner) for part in displays), ("", None)),
    )


def _place_in_file(thing: bpy.types.Object) -> tuple[str, str | None]:
    return thing.name, None if thing.library is None else thing.library.filepath


def read_viewers(depsgraph: bpy.types.Depsgraph, scene: bpy.types.Scene) -> tuple[Viewer, ...]:
    """The viewers that are on, in their order; RigError where one of them is none, or all are off.

    Blender keeps the place of a camera up to date that is enabled in the view layer.
    """
    seats = seats_of(scene)
    if not seats and len(scene.kiriko.viewers):
        raise RigError("All viewers in the list are off: turn one on.")
    return tuple(read_seat(seat, depsgraph, scene) for seat in seats)


def read_seat(seat: Seat, depsgraph: bpy.types.Depsgraph, scene: bpy.types.Scene) -> Viewer:
    """A viewer; RigError where its place is unknown."""
    camera = seat.camera
    if camera is None:
        raise no_camera()

    if is_deleted(camera) or not is_placed(camera, depsgraph):
        if not camera.users_scene:
            raise RigError(
                "The viewer '{viewer}' is in no scene any more, as after deleting it: take it out"
                " of the list of viewers, or choose another camera.",
                viewer=camera.name,
            )
        raise RigError(
            "The viewer '{viewer}' is disabled or left out of the view layer, so that its"
            " place is unknown: enable it, or make it the scene's camera.",
            viewer=camera.name,
        )

    viewer = read_viewer(camera, depsgraph, scene.render, length_of_unit(scene))
    return viewer if seat.weight == 1 else replace(viewer, weight=seat.weight)


def _read_image(
    scene: bpy.types.Scene, viewers: tuple[Viewer, ...], planes: list[Part], kept: Kept
) -> tuple[list[Picture], list[str]]:
    """The picture in the viewers' own pixels, with notes, also on planes that are not used."""
    pictures, notes = read_in_own_pixels(scene, seats_of(scene), viewers, kept)
    unused = [
        Message("The picture plane '{name}' is not used: the picture is an image.", name=part.name)
        for part in planes
    ]
    return pictures, notes + unused


def calibrated_rig(rig: Rig, scene: bpy.types.Scene) -> tuple[Rig, list[str]]:
    """The rig with the offset that the scene keeps from
    calibrations, and notes on amounts that have no place.
    """
    kept = Offset.read(scene.kiriko.calibration.offset).sets
    if not kept:
        return rig, []

    try:
        rig.check()
    except KirikoError:
        return rig, []  # its errors are told before it is solved

    rig, unknown = with_offset(rig, kept)
    notes = [
        Message(
            "The calibration's offset names '{name}', which this rig does not have:"
            " calibrate again, or remove the offset.",
            name=name,
        )
        for name in unknown
    ]
    return rig, [Message("The calibration's offset is in this rig."), *notes]


def object_matrix(linear: Floats, shift: Floats, metres: float) -> Floats:
    """Matrix (4, 4) for objects, in units of so many metres:
    points p, in m, go to linear (3, 3) @ p + shift (3,).
    """
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = linear, shift / metres
    return matrix
