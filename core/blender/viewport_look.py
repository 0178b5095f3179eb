"""How a rig looks in the viewport without a render: glass and plate let see through.

Solid draws with the colour of the material by default. So its alpha is the one setting that makes a
thing see-through in every new file: the object's own colour counts with Color: Object alone.
"""

from typing import Any

import bpy

from . import shaders
from .changes import put_back
from .on_display import MATERIAL_MARK
from .stored_records import Changed

GLASS = 0.3  # alpha of glass in Solid: its shape is seen as well as the picture in it
SEE_THROUGH = 0.5  # alpha of a material up to which it is left as it is
PLATE = (0.15, 0.5, 1.0, 0.5)
PLATE_OPACITY = 0.12  # where EEVEE draws it
SCREEN = (0.02, 0.02, 0.03, 1.0)


def see_through(
    thing: bpy.types.Object, glasses: tuple[bpy.types.Object, ...]
) -> list[tuple[bpy.types.ID, dict[str, Any]]]:
    """Settings, by their owners, that let see through a glass in Solid.

    A material that others than glasses have, too, is left, and so is one of another file: there the
    object is drawn by its edges. So is one without a material, which has no colour.
    """
    if not thing.is_editable or not hasattr(thing.data, "materials"):
        return []  # such as the instance of a collection

    materials = {slot.material for slot in thing.material_slots} or {None}
    own = {*glasses, *(glass.data for glass in glasses)}
    if not all(material is not None and _is_of(material, own) for material in materials):
        return [(thing, {"display_type": "WIRE"})] if thing.display_type == "TEXTURED" else []

    return [
        (material, {"diffuse_color": (*material.diffuse_color[:3], GLASS)})
        for material in sorted(materials, key=lambda m: m.name)
        if material.diffuse_color[3] > SEE_THROUGH
    ]


def draw_as_solid(thing: bpy.types.Object) -> None:
    """Draw a glass by its faces again, for it has got a material that lets see through."""
    kept = Changed.read(thing.kiriko.changed)
    edges = [one for one in kept.changes if one[0] == "display_type"]
    put_back(thing, edges)
    rest = [one for one in kept.changes if one not in edges]
    thing.kiriko.changed = Changed(kept.rig, rest).text() if rest else ""


def _is_of(material: bpy.types.Material, own: set[bpy.types.ID]) -> bool:
    """May a material be changed without a change of others' looks?"""
    users = {user for user in bpy.data.user_map(subset=[material])[material]}
    return material.is_editable and users <= own


def be_seen_as_glass(material: bpy.types.Material, ior: float) -> None:
    """Make clear glass of a material, which lets see through in Solid."""
    shaders.be_glass(material, ior, True)
    material.diffuse_color = (0.8, 0.9, 1.0, GLASS)


def be_seen_as_plate(material: bpy.types.Material) -> None:
    """Make an ideal plate of a material, tinted and see-through where Cycles does not draw it.

    EEVEE knows no portals, and would draw a black sheet.
    """
    shaders.be_plate(material)
    material.diffuse_color = PLATE
    material.surface_render_method = "BLENDED"
    shaders.tint_in_eevee(material, PLATE[:3], PLATE_OPACITY)


def be_seen_as_screen(material: bpy.types.Material) -> None:
    """A display that shows no image yet: black. A result takes its place without a word."""
    shaders.be_blocker(material)
    material[MATERIAL_MARK] = True
    material.diffuse_color = SCREEN
