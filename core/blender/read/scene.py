"""Reads the evaluated scene into a Rig, as Blender shows it at this frame, in metres and float64.

The depsgraph has already applied modifiers, parents, constraints and instances. This file sorts
objects by role, reads images in the viewers' own pixels, and notes ignored objects.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import bpy
import numpy as np
from numpy.typing import NDArray

from ...base.arrays import Floats
from ...base.errors import KirikoError, RigError
from ...base.messages import Message
from ...bench.offset import with_offset
from ...rig.parts import OwnImage
from ...rig.rig import ROLES, Picture, PicturePlace, Projector, Rig, Viewer
from ..data.camera_viewer import Seat, is_deleted, no_camera, read_viewer, seats_of, shown_first
from ..data.lost_data import find_lost, refuse_lost
from ..data.moving import ended, number_at
from ..data.rectangle import flat_size
from ..data.stored_records import Offset
from ..data.units import length_of_unit
from ..data.visibility import is_placed
from .elements import MaterialReading, about, tone_of
from .part_roles import in_blender
from .scene_parts import WorldPart, parts_by_role, read_parts
from .shapes import CURVED, ShapeCache


def read_viewer_image(
    scene: bpy.types.Scene, seats: Sequence[Seat], viewers: Sequence[Viewer], cache: ShapeCache
) -> tuple[list[Picture], list[str]]:
    """The picture, none without an image, with notes on images of another size or shape.

    If one viewer has its own image all need one, which the rig's check enforces.

    viewers : of these seats
    """
    own = [
        (seat.image, viewer)
        for seat, viewer in zip(seats, viewers, strict=True)
        if seat.image is not None
    ]
    if own:
        return _read_each(scene, own, cache)

    image = scene.kiriko.picture_image
    if image is None:
        return [], []

    pixels, notes = _read(scene, image, Message("the scene's picture"), cache)
    place = PicturePlace(image.name, *pixels.shape[1::-1])
    for viewer in viewers[:1]:
        off = abs(place.width * viewer.height - place.height * viewer.width)
        if off > max(viewer.width, viewer.height):
            notes.append(_on_stretched(image, pixels, viewer))
    return [place.showing(pixels)], notes


def _on_stretched(image: bpy.types.Image, pixels: NDArray[np.float32], viewer: Viewer) -> Message:
    """The note on an image of another size than its viewer's."""
    return Message(
        "The image '{image}' ({width} x {height} pixels) is stretched to fit the viewer '{viewer}'"
        " ({viewer_width} x {viewer_height}).",
        image=image.name,
        width=pixels.shape[1],
        height=pixels.shape[0],
        viewer=viewer.name,
        viewer_width=viewer.width,
        viewer_height=viewer.height,
    )


def _read_each(
    scene: bpy.types.Scene, own: list[tuple[bpy.types.Image, Viewer]], cache: ShapeCache
) -> tuple[list[Picture], list[str]]:
    """An image for each viewer."""
    found: list[OwnImage] = []
    notes: list[str] = []
    for image, viewer in own:
        owner = Message("the viewer '{viewer}'", viewer=viewer.name)
        pixels, remarks = _read(scene, image, owner, cache)
        found.append(OwnImage(viewer.name, pixels))
        notes += remarks
        if pixels.shape[1::-1] != (viewer.width, viewer.height):
            notes.append(_on_stretched(image, pixels, viewer))
    return [Picture(own[0][0].name, found[0].image, own=tuple(found))], notes


def _read(
    scene: bpy.types.Scene, image: bpy.types.Image, owner: str, cache: ShapeCache
) -> tuple[NDArray[np.float32], list[str]]:
    """The pixels of an image at the scene's frame, and notes on it."""
    frame = scene.frame_current
    tone = tone_of(scene.kiriko.picture)
    pixels = cache.pixels(image, owner, tone, number_at(image, None, frame))
    return pixels, about(image) + ended(image, None, frame) + cache.notes_on(image)


def renders_differ(owner: bpy.types.Object, scene: bpy.types.Scene) -> bool:
    """Whether modifiers make another shape in renders than in the viewport, which is read."""
    return any(
        m.show_viewport != m.show_render
        or (m.show_viewport and m.type in {"SUBSURF", "MULTIRES"} and m.levels != m.render_levels)
        for m in owner.modifiers
    ) or (
        scene.render.use_simplify
        and any(m.type in {"SUBSURF", "MULTIRES"} for m in owner.modifiers)
    )


def modifier_notes(parts: list[WorldPart]) -> list[str]:
    """Notes on modifiers that move the vertices of curved parts off their surface."""
    drawn = dict.fromkeys(
        (part.drawn, part.mesh.surface)
        for part in parts
        if part.role in CURVED
        and part.mesh.surface != "facets"
        and part.mesh.is_smooth is not None
        and part.drawn is not None
    )
    return [
        Message(
            "The modifier '{modifier}' of '{name}' moves vertices off the curved surface:"
            " {remedy}.",
            modifier=m.name,
            name=o.name,
            remedy=remedy,
        )
        for o, surface in drawn
        for m in o.modifiers
        if m.show_viewport and (remedy := remedy_of(m, surface))
    ]


def remedy_of(modifier: bpy.types.Modifier, surface: str) -> str:
    """The remedy for a modifier that moves vertices off the surface; '' for others."""
    if (
        modifier.type == "SUBSURF"
        and modifier.subdivision_type == "CATMULL_CLARK"
        and not modifier.use_limit_surface
    ):
        return Message("turn on Use Limit Surface")

    is_collapsed = (
        modifier.type == "DECIMATE" and modifier.decimate_type == "COLLAPSE" and modifier.ratio < 1
    )
    if (modifier.type == "REMESH" or is_collapsed) and surface == "smooth":
        return Message("turn it off, or set the object's Surface to Automatic")

    return ""


def scene_notes(
    depsgraph: bpy.types.Depsgraph,
    scene: bpy.types.Scene,
    parts: list[WorldPart],
    cameras: Iterable[bpy.types.Object],
) -> list[str]:
    """Notes on settings of the whole scene that Kiriko ignores."""
    notes = []
    if depsgraph.mode == "VIEWPORT":
        notes += [
            Message(
                "'{name}' has different modifiers in viewport and renders; Kiriko uses the"
                " viewport's shape.",
                name=o.name,
            )
            for o in dict.fromkeys(part.owner for part in parts)
            if renders_differ(o, scene)
        ]

    notes += [
        Message("Kiriko ignores the depth of field of '{viewer}'.", viewer=camera.name)
        for camera in cameras
        if camera.type == "CAMERA" and camera.data.dof.use_dof
        if not camera.original.kiriko.use_dof
    ]

    return notes


@dataclass(frozen=True)
class Reading:
    """A scene as read.

    rig : with a calibration's offset, if there is one
    drawn : as the scene shows it, without the offset
    display_size : width and height in m of a flat display, over the whole UV square
    display_objects : for each display and screen the name of its object, or of the object that
        instances it, and its library file, as keys of `bpy.data.objects`
    solved_for : the scene's fingerprint, as text, if it was read to be solved
    """

    rig: Rig
    drawn: Rig
    materials: tuple[MaterialReading, ...]
    notes: tuple[str, ...]
    display_size: tuple[float, float] | None
    display_objects: tuple[tuple[str, str | None], ...]
    solved_for: str = ""


def read(
    source: bpy.types.Context | bpy.types.Depsgraph,
    scene: bpy.types.Scene | None = None,
    cache: ShapeCache | None = None,
) -> Reading:
    """Read the rig of a scene at this frame.

    Nothing is changed in the scene. Errors of the rig as a whole are left to `Rig.check`.

    Parameters
    ----------
    source : the context, or a depsgraph of the scene
    scene : the scene with the settings; None for the depsgraph's own
    cache : cached meshes and pixels; None for an empty cache

    Raises
    ------
    RigError : the viewer's camera or the picture plane is unusable, or a needed part is hidden
    ImageError : the picture has no pixels
    """
    drawn = read_drawn(source, scene, cache)
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
    cache: ShapeCache | None = None,
) -> Reading:
    """The rig without a calibration's offset. The viewers keep their order, since an offset's
    amounts are along the axes of the first one.
    """
    depsgraph = (
        source.evaluated_depsgraph_get() if isinstance(source, bpy.types.Context) else source
    )
    scene = depsgraph.scene if scene is None else scene
    cache = cache or ShapeCache()
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
    parts, notes = read_parts(depsgraph, scene, metres, cache, needed)
    viewers = read_viewers(depsgraph, scene)

    by_role = parts_by_role(parts)
    objects = {**by_role, "PICTURE": []} if is_image else by_role
    found, materials = _read_objects(objects, cache, notes)
    projectors = (part.owner for part in by_role["PROJECTOR"])
    found["projectors"] = [read_projector(camera, depsgraph, scene) for camera in projectors]
    if is_image:
        found["pictures"], remarks = _read_image(scene, viewers, by_role["PICTURE"], cache)
        notes += remarks

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
        display_objects=tuple(
            _place_in_file(part.owner) for part in (*displays, *by_role["SCREEN"])
        ),
    )


def _read_objects(
    by_role: dict[str, list[WorldPart]], cache: ShapeCache, notes: list[str]
) -> tuple[dict[str, list[Any]], list[MaterialReading]]:
    """Parts of all roles by the rig's fields, without projectors and without a picture that is an
    image, and the materials of glass; adds notes.
    """
    found: dict[str, list[Any]] = {}
    materials = []
    for role in ROLES:
        if role.number is None or role.name == "PROJECTOR":
            continue
        found[role.field] = []
        for part in by_role[role.name]:
            as_read = in_blender(role.name).read(part, cache)
            found[role.field].append(as_read.part)
            notes += as_read.notes
            materials += as_read.materials
    return found, materials


def _place_in_file(thing: bpy.types.Object) -> tuple[str, str | None]:
    return thing.name, None if thing.library is None else thing.library.filepath


def read_viewers(depsgraph: bpy.types.Depsgraph, scene: bpy.types.Scene) -> tuple[Viewer, ...]:
    """The viewers that are on, in their order; RigError if one is invalid, or all are off."""
    seats = seats_of(scene)
    if not seats and len(scene.kiriko.viewers):
        raise RigError("All viewers are off. Turn one on.")
    return tuple(read_seat(seat, depsgraph, scene) for seat in seats)


def read_seat(seat: Seat, depsgraph: bpy.types.Depsgraph, scene: bpy.types.Scene) -> Viewer:
    """A viewer; RigError if its place is unknown."""
    camera = seat.camera
    if camera is None:
        raise no_camera()

    if is_deleted(camera) or not is_placed(camera, depsgraph):
        if not camera.users_scene:
            raise RigError(
                "The viewer '{viewer}' is not in any scene. Remove it from the viewer list, or"
                " choose another camera.",
                viewer=camera.name,
            )
        raise RigError(
            "The viewer '{viewer}' is disabled or not in the view layer. Enable it, or make it"
            " the scene's camera.",
            viewer=camera.name,
        )

    viewer = read_viewer(camera, depsgraph, scene.render, length_of_unit(scene))
    return viewer if seat.weight == 1 else replace(viewer, weight=seat.weight)


def read_projector(
    camera: bpy.types.Object, depsgraph: bpy.types.Depsgraph, scene: bpy.types.Scene
) -> Projector:
    """The projector of a camera object."""
    viewer = read_viewer(camera, depsgraph, scene.render, length_of_unit(scene))
    return Projector(**vars(viewer.pinhole))


def _read_image(
    scene: bpy.types.Scene, viewers: tuple[Viewer, ...], planes: list[WorldPart], cache: ShapeCache
) -> tuple[list[Picture], list[str]]:
    """The picture in the viewers' own pixels, with notes, also on ignored planes."""
    pictures, notes = read_viewer_image(scene, seats_of(scene), viewers, cache)
    unused = [
        Message(
            "The picture plane '{name}' is ignored, because the viewers have their own images.",
            name=part.name,
        )
        for part in planes
    ]
    return pictures, notes + unused


def calibrated_rig(rig: Rig, scene: bpy.types.Scene) -> tuple[Rig, list[str]]:
    """The rig with the offset from calibrations, and notes on parts it does not have."""
    sets = Offset.read(scene.kiriko.calibration.offset).sets
    if not sets:
        return rig, []

    try:
        rig.check()
    except KirikoError:
        return rig, []  # solving reports its errors first

    rig, unknown = with_offset(rig, sets)
    notes = [
        Message(
            "The calibration's offset names '{name}', which is not in this rig. Calibrate again,"
            " or remove the offset.",
            name=name,
        )
        for name in unknown
    ]
    return rig, [Message("This rig includes the calibration's offset."), *notes]


def object_matrix(linear: Floats, shift: Floats, metres: float) -> Floats:
    """Matrix (4, 4) for objects, in units of so many metres: maps points p, in m, to linear (3, 3)
    @ p + shift (3,).
    """
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = linear, shift / metres
    return matrix
