"""Blender's side of a blocker."""

import bpy

from ...rig.rig import Blocker
from ..materials import shaders
from .part_roles import FoundPart, InBlender, Studio
from .scene_parts import WorldPart
from .shapes import ShapeCache


def read(part: WorldPart, cache: ShapeCache) -> FoundPart:
    """A blocker, which is its mesh."""
    return FoundPart(Blocker(part.name, part.mesh), [], [])


def shade(material: bpy.types.Material, look: None, studio: Studio) -> None:
    """Black on both sides."""
    shaders.be_blocker(material)


IN_BLENDER = InBlender(read, shade)
