"""Blender's side of a thin lens."""

from typing import NamedTuple

import bpy
import numpy as np

from ...light.interaction_lens import lens_frame
from ...rig.rig import Lens, Rig
from ..materials import shaders
from .part_roles import FoundPart, InBlender, Studio
from .scene_parts import WorldPart
from .shapes import ShapeCache


def read(part: WorldPart, cache: ShapeCache) -> FoundPart:
    """A lens with its focal length."""
    focal_length = 1e-3 * part.owner.kiriko.element.focal_length
    return FoundPart(Lens(part.name, part.mesh, focal_length), [], [])


class LensLook(NamedTuple):
    """Centre and focal length of a lens, m."""

    centre: tuple[float, ...]
    focal_length: float


def looks(rig: Rig) -> tuple[dict[str, LensLook], list[str]]:
    """The centres and focal lengths of all lenses."""
    frames = {lens.name: lens_frame(lens) for lens in rig.lenses}
    return {name: LensLook(tuple(f.centre), f.focal_length) for name, f in frames.items()}, []


def shade(material: bpy.types.Material, look: LensLook, studio: Studio) -> None:
    """Bend light by the paraxial law."""
    centre = np.array(look.centre) / studio.metres
    shaders.be_lens(material, centre, look.focal_length / studio.metres)


IN_BLENDER = InBlender(read, shade, looks)
