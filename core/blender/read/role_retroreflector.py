"""Blender's side of a retroreflector."""

import bpy

from ...rig.rig import Retroreflector
from ..materials import shaders
from .part_roles import FoundPart, InBlender, Studio
from .scene_parts import WorldPart
from .shapes import ShapeCache


def read(part: WorldPart, cache: ShapeCache) -> FoundPart:
    """A retroreflector with its spread and its corner cubes."""
    ours = part.owner.kiriko.element
    sheet = Retroreflector(part.name, part.mesh, ours.spread, 1e-3 * ours.pitch)
    return FoundPart(sheet, [], [])


def shade(material: bpy.types.Material, look: None, studio: Studio) -> None:
    """Return light along its path."""
    shaders.be_retroreflector(material)


IN_BLENDER = InBlender(read, shade)
