"""The display in Blender."""

import bpy

from ..rig import Display
from . import shaders
from .parts import Part
from .roles import Found, InBlender, Studio
from .shapes import Kept


def read(part: Part, kept: Kept) -> Found:
    """A display with its pixels."""
    return Found(Display(part.name, part.mesh, *part.owner.kiriko.resolution), [], [])


def shade(material: bpy.types.Material, look: None, studio: Studio) -> None:
    """Show the source image, or the display's own coordinates."""
    if studio.source is None:
        shaders.show_coordinates(material)
    else:
        shaders.show_image(material, studio.source)


IN_BLENDER = InBlender(read, shade)
