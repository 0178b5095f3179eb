"""Blender's side of glass."""

from typing import Any

import bpy

from ...rig.rig import Rig
from ..materials import shaders
from .elements import read_glass
from .nested_glass import Interface, interfaces
from .part_roles import FoundPart, InBlender, Studio
from .scene_parts import WorldPart
from .shapes import ShapeCache


def read(part: WorldPart, cache: ShapeCache) -> FoundPart:
    """A glass with the index of its material."""
    glass, materials, notes = read_glass(part)
    return FoundPart(glass, notes, materials)


def looks(rig: Rig) -> tuple[dict[str, Any], list[str]]:
    """The interfaces of all glass with an index of its own."""
    found, notes = interfaces(rig.glasses)
    by_name = {glass.name: face for glass, face in zip(rig.glasses, found, strict=True)}
    return {name: face for name, face in by_name.items() if face.index is not None}, notes


def shade(material: bpy.types.Material, look: Interface, studio: Studio) -> None:
    """Refract by the ratio of the two media."""
    shaders.be_glass(material, look.index, studio.fresnel)


def is_inside_out(look: Interface) -> bool:
    """Whether all its normals point inward."""
    return look.is_inside_out


IN_BLENDER = InBlender(read, shade, looks, is_inside_out)
