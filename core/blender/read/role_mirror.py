"""Blender's side of a mirror."""

import bpy

from ...rig.rig import Mirror
from ..materials import shaders
from .part_roles import FoundPart, InBlender, Studio
from .scene_parts import WorldPart
from .shapes import ShapeCache


def read(part: WorldPart, cache: ShapeCache) -> FoundPart:
    """A mirror, which is its mesh."""
    return FoundPart(Mirror(part.name, part.mesh), [], [])


def shade(material: bpy.types.Material, look: None, studio: Studio) -> None:
    """Reflect without loss."""
    shaders.be_mirror(material)


IN_BLENDER = InBlender(read, shade)
