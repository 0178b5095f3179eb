"""A blocker in Blender."""

import bpy

from ...rig.rig import Blocker
from ..materials import shaders
from .part_roles import Found, InBlender, Studio
from .scene_parts import Part
from .shapes import Kept


def read(part: Part, kept: Kept) -> Found:
    """Its mesh is all there is."""
    return Found(Blocker(part.name, part.mesh), [], [])


def shade(material: bpy.types.Material, look: None, studio: Studio) -> None:
    """Black on both sides."""
    shaders.be_blocker(material)


IN_BLENDER = InBlender(read, shade)
