"""A mirror in Blender."""

import bpy

from ..rig.rig import Mirror
from . import shaders
from .parts import Part
from .roles import Found, InBlender, Studio
from .shapes import Kept


def read(part: Part, kept: Kept) -> Found:
    """Its mesh is all there is."""
    return Found(Mirror(part.name, part.mesh), [], [])


def shade(material: bpy.types.Material, look: None, studio: Studio) -> None:
    """Reflect without loss."""
    shaders.be_mirror(material)


IN_BLENDER = InBlender(read, shade)
