"""Blender's side of glass."""

from typing import NamedTuple

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


class GlassLook(NamedTuple):
    """The interface of glass, whether its reflection carries the picture, and its absorption, 1/m,
    of red, green and blue.
    """

    interface: Interface
    reflects: bool
    absorption: tuple[float, float, float]


def looks(rig: Rig) -> tuple[dict[str, GlassLook], list[str]]:
    """The interfaces of all glass with an index of its own."""
    found, notes = interfaces(rig.glasses)
    of_each = zip(rig.glasses, found, strict=True)
    return {
        glass.name: GlassLook(face, glass.reflects, glass.absorption)
        for glass, face in of_each
        if face.index is not None
    }, notes


def shade(material: bpy.types.Material, look: GlassLook, studio: Studio) -> None:
    """Refract by the ratio of the two media."""
    shaders.be_glass(material, look.interface.index, studio.fresnel or look.reflects)
    if studio.fresnel and any(look.absorption):
        shaders.absorb(material, [one * studio.metres for one in look.absorption])


def is_inside_out(look: GlassLook) -> bool:
    """Whether all its normals point inward."""
    return look.interface.is_inside_out


IN_BLENDER = InBlender(read, shade, looks, is_inside_out)
