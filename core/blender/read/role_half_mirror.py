"""Blender's side of a half mirror."""

import bpy
import numpy as np

from ...rig.rig import HalfMirror, Rig
from ..materials import shaders
from .part_roles import FoundPart, InBlender, Studio
from .scene_parts import WorldPart
from .shapes import ShapeCache


def read(part: WorldPart, cache: ShapeCache) -> FoundPart:
    """A half mirror with its shares of light."""
    ours = part.owner.kiriko.element
    shares = ours.reflectance, ours.absorption
    settings = *shares, ours.prefers.lower(), ours.polarising
    return FoundPart(HalfMirror(part.name, part.mesh, *settings), [], [])


def looks(rig: Rig) -> tuple[dict[str, HalfMirror], list[str]]:
    """All half mirrors."""
    return {mirror.name: mirror for mirror in rig.half_mirrors}, []


def shade(material: bpy.types.Material, look: HalfMirror, studio: Studio) -> None:
    """Reflect and transmit its shares of unpolarised light."""
    shaders.be_half_mirror(material, *np.square(look.amplitudes).mean(axis=1))


IN_BLENDER = InBlender(read, shade, looks)
