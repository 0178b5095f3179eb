"""A role in Blender: how such a part is read, and its look in Cycles.

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
    """All that looks in a preview share.

    source : image that the display shows; None: its own coordinates (u, v, 1)
    fresnel : glass splits light as real glass does
    metres : length of a Blender unit
    mark : notes data that must not outlive the preview, and returns it
    """

    source: bpy.types.Image | None
    fresnel: bool
    metres: float
    mark: Callable[[Any], Any]


def no_looks(rig: Rig) -> tuple[None, list[str]]:
    """All parts of the role look alike."""
    return None, []


class InBlender(NamedTuple):
    """A role in Blender.

    read : the part of the rig of an object, with the meshes and pixels kept from before
    shade : gives a material the look of a part in Cycles; takes the material, the part's own look,
        and the studio. None: it is not in a preview
    looks : by name, the parts of a rig in a preview, each with all that its own look depends on;
        and reasons why a preview cannot be compared. None for the names: all, and all alike
    is_inside_out : whether a part with such a look is drawn with its inside out
    """

    read: Callable[[WorldPart, ShapeCache], FoundPart]
    shade: Callable[[bpy.types.Material, Any, Studio], None] | None
    looks: Callable[[Rig], tuple[dict[str, Any] | None, list[str]]] = no_looks
    is_inside_out: Callable[[Any], bool] = lambda look: False


@cache
def in_blender(role: str) -> InBlender:
    """The role of this name."""
    return import_module(f".role_{role.lower()}", __package__).IN_BLENDER
