"""Reads the evaluated scene into an incomplete Rig for the overlay: missing, hidden or faulty parts
are left out, and no pixels of the picture are read.
"""

from collections.abc import Iterator
from contextlib import suppress
from typing import Any

import bpy

from ...base.errors import KirikoError
from ...rig.rig import ROLES, Rig, Viewer
from ..data.camera_viewer import is_deleted, own_images, read_viewer, seats_of, shown_first
from ..data.moving import number_at
from ..data.units import length_of_unit
from ..data.visibility import is_placed
from .elements import place_of, shown_image
from .part_roles import in_blender
from .scene import calibrated_rig
from .scene_parts import WorldPart, parts_by_role, read_parts
from .shapes import ShapeCache


class PlaceCache(ShapeCache):
    """Caches meshes as `MeshCache` does, without pixels."""

    _are_compared = True


def read_places(depsgraph: bpy.types.Depsgraph, scene: bpy.types.Scene, cache: PlaceCache) -> Rig:
    """The existing parts of a scene's rig at this frame, with a calibration's offset; of the
    picture only its place.

    Raises RigError for an object with a role that cannot be a part.
    """
    metres = length_of_unit(scene)
    parts, _ = read_parts(depsgraph, scene, metres, cache)
    by_role = parts_by_role(parts)
    found: dict[str, tuple[Any, ...]] = {"viewers": tuple(_viewers(depsgraph, scene, metres))}

    for role in ROLES:
        if role.number is None:
            continue
        if role.name == "PICTURE" and scene.kiriko.picture_source == "IMAGE":
            image = next(iter(own_images(scene)), scene.kiriko.picture_image)
            found[role.field] = () if image is None else (place_of(image, image.name),)
            continue

        members = []
        for part in by_role[role.name]:
            with suppress(KirikoError):
                members.append(_read(part, cache))
        found[role.field] = tuple(members)

    rig, _ = calibrated_rig(Rig(**found), scene)
    return shown_first(rig, scene)


def _viewers(
    depsgraph: bpy.types.Depsgraph, scene: bpy.types.Scene, metres: float
) -> Iterator[Viewer]:
    """The valid viewers whose transforms are up to date."""
    for seat in seats_of(scene):
        camera = seat.camera
        if camera is not None and not is_deleted(camera) and is_placed(camera, depsgraph):
            with suppress(KirikoError):
                yield read_viewer(camera, depsgraph, scene.render, metres)


def _read(part: WorldPart, cache: PlaceCache) -> Any:
    """A part as its role reads it; of a picture only its place."""
    if part.role == "PICTURE":
        image, timing, _ = shown_image(part)
        return place_of(image, part.name, part.mesh, number_at(image, timing, part.frame))
    return in_blender(part.role).read(part, cache).part
