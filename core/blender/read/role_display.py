"""Blender's side of the display."""

import bpy

from ...rig.rig import Display, Rig
from ..materials import shaders
from .part_roles import FoundPart, InBlender, Studio
from .scene_parts import WorldPart
from .shapes import ShapeCache


def read(part: WorldPart, cache: ShapeCache) -> FoundPart:
    """A display with its resolution and black level."""
    ours = part.owner.kiriko
    width, height = ours.resolution
    return FoundPart(Display(part.name, part.mesh, width, height, ours.display.black_level), [], [])


def looks(rig: Rig) -> tuple[dict[str, float], list[str]]:
    """The black levels of all displays."""
    return {display.name: display.black_level for display in rig.displays}, []


def shade(material: bpy.types.Material, look: float, studio: Studio) -> None:
    """Show the source image over the black level, or the display's own coordinates."""
    if studio.source is None:
        shaders.show_coordinates(material)
    else:
        shaders.show_image(material, studio.source, look)


IN_BLENDER = InBlender(read, shade, looks)
