"""Blender's side of the display."""

import bpy

from ...base.messages import Message
from ...rig.dispersion import P3_PRIMARIES, SRGB_PRIMARIES, Primaries
from ...rig.joined_display import sections_of, size_of
from ...rig.rig import Display, Rig
from ..materials import shaders
from .part_roles import FoundPart, InBlender, Studio
from .scene_parts import WorldPart
from .shapes import ShapeCache

NO_POLARISATION = Message(
    "The preview differs from Kiriko's result: {why}.",
    why=Message("Cycles has no polarisation, so its brightness is another"),
)


def read(part: WorldPart, cache: ShapeCache) -> FoundPart:
    """A display with its resolution, black level and primaries."""
    ours = part.owner.kiriko
    polarised = ours.element.angle if ours.element.is_polarised else None
    light = ours.display.black_level, polarised, primaries_of(ours.display)
    return FoundPart(Display(part.name, part.mesh, *ours.resolution, *light), [], [])


def primaries_of(ours: bpy.types.PropertyGroup) -> Primaries:
    """Wavelengths, m, of a display's settings."""
    own = tuple(1e-9 * nm for nm in ours.wavelengths)
    return {"SRGB": SRGB_PRIMARIES, "P3": P3_PRIMARIES}.get(ours.primaries, own)


def looks(rig: Rig) -> tuple[dict[str, shaders.ImageLook], list[str]]:
    """The looks of all displays and screens."""
    sections = sections_of(rig.outputs)
    size = size_of(sections) if sections else (1, 1)
    return {
        part.name: shaders.ImageLook(part.black_level, *section.window(size))
        for part, section in zip(rig.lit, sections, strict=False)
    }, [NO_POLARISATION] if rig.is_polarised else []


def shade(material: bpy.types.Material, look: shaders.ImageLook, studio: Studio) -> None:
    """Show the source image over the black level, or its coordinates."""
    shaders.show(material, studio.source, look)


IN_BLENDER = InBlender(read, shade, looks)
