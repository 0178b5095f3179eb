"""Blender's side of a plate."""

from dataclasses import replace

import bpy

from ...rig.rig import MirrorArray, Rig
from ..materials import shaders
from ..materials.plate_material import be_mirror_array
from .elements import read_plate
from .part_roles import FoundPart, InBlender, Studio
from .scene_parts import WorldPart
from .shapes import ShapeCache


def read(part: WorldPart, cache: ShapeCache) -> FoundPart:
    """A plate with its mirrors."""
    return FoundPart(read_plate(part), [], [])


def looks(rig: Rig) -> tuple[dict[str, MirrorArray | None], list[str]]:
    """The mirrors of all plates; None for ideal ones."""
    return {plate.name: plate.array for plate in rig.plates}, []


def shade(material: bpy.types.Material, look: MirrorArray | None, studio: Studio) -> None:
    """Redirect light by the plate's mirrors, or by the ideal law."""
    if look is None:
        shaders.be_plate(material)
        return
    array = replace(look, has_fresnel=look.has_fresnel and studio.fresnel)
    studio.mark(be_mirror_array(material, array, studio.metres))


IN_BLENDER = InBlender(read, shade, looks)
