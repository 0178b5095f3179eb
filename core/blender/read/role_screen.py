"""Blender's side of a screen: the image wanted on it, as if it shone by itself."""

import bpy

from ...rig.rig import Screen
from ..materials import shaders
from .part_roles import FoundPart, InBlender, Studio
from .role_display import looks
from .scene_parts import WorldPart
from .shapes import ShapeCache


def read(part: WorldPart, cache: ShapeCache) -> FoundPart:
    """A screen with the resolution of its image."""
    return FoundPart(Screen(part.name, part.mesh, *part.owner.kiriko.resolution), [], [])


def shade(material: bpy.types.Material, look: shaders.ImageLook, studio: Studio) -> None:
    """Show the wanted image on both sides, or the coordinates of the source image."""
    shaders.show(material, studio.source, look._replace(is_two_sided=True))


IN_BLENDER = InBlender(read, shade, looks)
