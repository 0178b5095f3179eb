"""Reads the evaluated scene into a Rig, as Blender shows it at this frame, in metres and float64.

Modifiers, parents, constraints and instances have been applied by the depsgraph;
this file sorts objects by role, and notes those that it leaves out.
"""

import json
from dataclasses import dataclass, replace

import bpy
import numpy as np

from ..arrays import Floats
from ..bench.offset import with_offset
from ..errors import KirikoError, RigError
from ..messages import Message
from ..rig import Blocker, Display, Mirror, Rig
from .elements import MaterialReading, read_glass, read_picture, read_picture_image, read_plate
from .mesh import flat_size
from .parts import Part, is_placed, read_parts
from .remarks import modifier_notes, scene_notes
from .shapes import Kept
from .units import length_of_unit
from .viewer import read_viewer


@dataclass(frozen=True)
class Reading:
    """A scene as read.

    rig : with a calibration's result, where that is kept as an offset
    drawn : as the scene shows it, without
    display_size : width and height in m of a flat display, over the whole UV square
    display_object : name of the object that is the display, or makes it as an instance
    solved_for : the scene's fingerprint, as text, where it was read to be solved
    """

    rig: Rig
    drawn: Rig
    materials: tuple[MaterialReading, ...]
    notes: tuple[str, ...]
    display_size: tuple[float, float] | None
    display_object: str
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
    rig, remarks = calibrated_rig(drawn.rig, source.scene if scene is None else scene)
    return replace(drawn, rig=rig, notes=tuple(dict.fromkeys([*drawn.notes, *remarks])))


def read_drawn(
    source: bpy.types.Context | bpy.types.Depsgraph,
    scene: bpy.types.Scene | None = None,
    kept: Kept | None = None,
) -> Reading:
    """The same, as the scene shows it: without a calibration's result."""
    depsgraph = (
        source.evaluated_depsgraph_get() if isinstance(source, bpy.types.Context) else source
    )
    scene = depsgraph.scene if scene is None else scene
    metres = length_of_unit(scene)
    kept = kept or Kept()
    needed = ("GLASS", "PLATE", "DISPLAY") + (
        () if scene.kiriko.picture_source == "IMAGE" else ("PICTURE",)
    )
    parts, notes = read_parts(depsgraph, scene, metres, kept, needed)
    camera = scene.kiriko.viewer or scene.camera
    if camera is not None and not is_placed(camera, depsgraph):
        raise RigError(
            "The viewer '{viewer}' is disabled or left out of the view layer, so that its"
            " place is unknown: enable it, or make it the scene's camera.",
            viewer=camera.name,
        )
    viewer = None if camera is None else read_viewer(camera, depsgraph, scene.render, metres)
    by_role: dict[str, list[Part]] = {}
    for part in parts:
        by_role.setdefault(part.role, []).append(part)

    glasses = []
    materials = []
    for part in by_role.get("GLASS", []):
        glass, readings, remarks = read_glass(part)
        glasses.append(glass)
        materials += readings
        notes += remarks
    if scene.kiriko.picture_source == "IMAGE":
        pictures, remarks = read_picture_image(scene.kiriko.picture_image, viewer, kept)
        notes += remarks
        unused = by_role.get("PICTURE", [])
        notes += [
            Message(
                "The picture plane '{name}' is not used: the picture is an image.", name=part.name
            )
            for part in unused
        ]
    else:
        pictures = []
        for part in by_role.get("PICTURE", []):
            picture, remarks = read_picture(part, kept)
            pictures.append(picture)
            notes += remarks
    displays = [
        Display(p.name, p.mesh, *p.owner.kiriko.resolution) for p in by_role.get("DISPLAY", [])
    ]
    notes += modifier_notes(parts) + scene_notes(depsgraph, scene, parts, camera)
    rig = Rig(
        viewers=() if viewer is None else (viewer,),
        glasses=tuple(glasses),
        plates=tuple(read_plate(p) for p in by_role.get("PLATE", [])),
        displays=tuple(displays),
        pictures=tuple(pictures),
        mirrors=tuple(Mirror(p.name, p.mesh) for p in by_role.get("MIRROR", [])),
        blockers=tuple(Blocker(p.name, p.mesh) for p in by_role.get("BLOCKER", [])),
    )
    size = flat_size(displays[0].mesh) if len(displays) == 1 else None
    shown_by = next((part.owner.name for part in by_role.get("DISPLAY", [])), "")
    return Reading(
        rig, rig, tuple(dict.fromkeys(materials)), tuple(dict.fromkeys(notes)), size, shown_by
    )


def calibrated_rig(rig: Rig, scene: bpy.types.Scene) -> tuple[Rig, list[str]]:
    """The rig with the offset that the scene keeps from
    calibrations, and notes on amounts that have no place.
    """
    kept = json.loads(scene.kiriko.calibration.offset or "[]")
    if not kept:
        return rig, []
    try:
        rig.check()
    except KirikoError:
        return rig, []  # its errors are told before it is solved
    rig, unknown = with_offset(rig, kept)
    notes = [
        Message(
            "The calibration's offset has '{name}', of which this rig has none: calibrate again"
            " or remove the offset.",
            name=name,
        )
        for name in unknown
    ]
    return rig, ["The calibration's offset is in this rig.", *notes]


def object_matrix(linear: Floats, shift: Floats, metres: float) -> Floats:
    """Matrix (4, 4) for objects, in units of so many metres:
    points p, in m, go to linear (3, 3) @ p + shift (3,).
    """
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = linear, shift / metres
    return matrix
