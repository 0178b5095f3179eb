"""Blender's side of a wave plate."""

import bpy

from ...rig.rig import WavePlate
from ..materials import shaders
from .part_roles import FoundPart, InBlender, Studio
from .scene_parts import WorldPart
from .shapes import ShapeCache


def read(part: WorldPart, cache: ShapeCache) -> FoundPart:
    """A wave plate with its retardance and axis."""
    ours = part.owner.kiriko.element
    return FoundPart(WavePlate(part.name, part.mesh, ours.angle, ours.retardance), [], [])


def shade(material: bpy.types.Material, look: None, studio: Studio) -> None:
    """Let all light through: Cycles has no polarisation."""
    shaders.be_half_mirror(material, 0.0, 1.0)


IN_BLENDER = InBlender(read, shade)
