"""Blender's side of a polariser."""

import bpy

from ...rig.rig import Polariser, Rig
from ..materials import shaders
from .part_roles import FoundPart, InBlender, Studio
from .scene_parts import WorldPart
from .shapes import ShapeCache


def read(part: WorldPart, cache: ShapeCache) -> FoundPart:
    """A polariser with its axis."""
    ours = part.owner.kiriko.element
    return FoundPart(Polariser(part.name, part.mesh, ours.angle, ours.extinction), [], [])


def looks(rig: Rig) -> tuple[dict[str, Polariser], list[str]]:
    """All polarisers."""
    return {sheet.name: sheet for sheet in rig.polarisers}, []


def shade(material: bpy.types.Material, look: Polariser, studio: Studio) -> None:
    """Transmit its share of unpolarised light."""
    shaders.be_half_mirror(material, 0.0, (1 + look.extinction) / 2)


IN_BLENDER = InBlender(read, shade, looks)
