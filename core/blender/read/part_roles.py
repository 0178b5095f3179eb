"""Blender's side of a role: how to read such a part, and its look in Cycles.

Each role has a file `role_<name>.py` with both, found by the role's name.
"""

from collections.abc import Callable
from functools import cache
from importlib import import_module
from typing import Any, NamedTuple

import bpy

from ...rig.rig import Rig
from .elements import MaterialReading
from .scene_parts import WorldPart
from .shapes import ShapeCache


class FoundPart(NamedTuple):
    """A part of the rig as read from its object, with notes for the artist."""

    part: Any
    notes: list[str]
    materials: list[MaterialReading]


class Studio(NamedTuple):
    """Settings common to all looks in a preview.

    source : image on the display; None for the display's own coordinates (u, v, 1)
    fresnel : glass splits light as real glass does
    metres : length of a Blender unit
    mark : marks temporary data of the preview, and returns it
    """

    source: bpy.types.Image | None
    fresnel: bool
    metres: float
    mark: Callable[[Any], Any]


def no_looks(rig: Rig) -> tuple[None, list[str]]:
    """The same look for all parts of a role."""
    return None, []


class InBlender(NamedTuple):
    """Blender's side of a role.

    read : the part of the rig of an object, with cached meshes and pixels; None for a camera
    shade : gives a material a part's look in Cycles; arguments are the material, the part's own
        look, and the studio. None if the role is not in previews
    looks : from a rig, its previewed parts by name, each with the values of its own look, and
        reasons why a preview is not comparable. None instead of names: all parts, all alike
    is_inside_out : whether a part with such a look is drawn inside out
    """

    read: Callable[[WorldPart, ShapeCache], FoundPart] | None
    shade: Callable[[bpy.types.Material, Any, Studio], None] | None
    looks: Callable[[Rig], tuple[dict[str, Any] | None, list[str]]] = no_looks
    is_inside_out: Callable[[Any], bool] = lambda look: False


@cache
def in_blender(role: str) -> InBlender:
    """The role of this name."""
    return import_module(f".role_{role.lower()}", __package__).IN_BLENDER
