"""Blender's side of the display."""

import bpy

from ...rig.joined_display import sections_of, size_of
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


def looks(rig: Rig) -> tuple[dict[str, shaders.ImageLook], list[str]]:
    """The looks of all displays and screens."""
    sections = sections_of(rig.outputs)
    size = size_of(sections) if sections else (1, 1)
    return {
        part.name: shaders.ImageLook(part.black_level, *section.window(size))
        for part, section in zip(rig.lit, sections, strict=False)
    }, []


def shade(material: bpy.types.Material, look: shaders.ImageLook, studio: Studio) -> None:
    """Show the source image over the black level, or its coordinates."""
    shaders.show(material, studio.source, look)


IN_BLENDER = InBlender(read, shade, looks)
