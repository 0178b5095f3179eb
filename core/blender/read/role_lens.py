"""Blender's side of a thin lens."""

import bpy

from ...light.interaction_lens import LensFrame, lens_frame
from ...rig.rig import Lens, Rig
from ..materials import shaders
from .part_roles import FoundPart, InBlender, Studio
from .scene_parts import WorldPart
from .shapes import ShapeCache


def read(part: WorldPart, cache: ShapeCache) -> FoundPart:
    """A lens with its focal length."""
    focal_length = 1e-3 * part.owner.kiriko.element.focal_length
    return FoundPart(Lens(part.name, part.mesh, focal_length), [], [])


def looks(rig: Rig) -> tuple[dict[str, LensFrame], list[str]]:
    """The frames of all lenses."""
    return {lens.name: lens_frame(lens) for lens in rig.lenses}, []


def shade(material: bpy.types.Material, look: LensFrame, studio: Studio) -> None:
    """Bend light by the paraxial law."""
    shaders.be_lens(material, look.centre / studio.metres, look.focal_length / studio.metres)


IN_BLENDER = InBlender(read, shade, looks)
