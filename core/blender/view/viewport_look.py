"""How a rig looks in the viewport without a render: glass and plate let see through.

Solid draws with the colour of the material by default. So its alpha is the one setting that makes a
thing see-through in every new file: the object's own colour counts with Color: Object alone.
"""

import bpy
import numpy as np

from ..materials import shaders
from ..result.on_display import MATERIAL_MARK

GLASS = 0.3  # alpha of glass in Solid: its shape is seen as well as the picture in it
SEE_THROUGH = 0.5  # alpha of a material up to which it is left as it is
PLATE = (0.15, 0.5, 1.0, 0.5)
PLATE_OPACITY = 0.12  # where EEVEE draws it
SCREEN = (0.02, 0.02, 0.03, 1.0)


def see_through(thing: bpy.types.Object, glasses: tuple[bpy.types.Object, ...]) -> None:
    """Let see through a glass in Solid, and remember what was changed.

    A material that others than glasses have, too, is left, and so is one of another file: there the
    object is drawn by its edges. So is one without a material, which has no colour.
    """
    if not thing.is_editable or not hasattr(thing.data, "materials"):
        return  # such as the instance of a collection

    materials = {slot.material for slot in thing.material_slots} or {None}
    own = {*glasses, *(glass.data for glass in glasses)}
    if not all(material is not None and _is_of(material, own) for material in materials):
        if thing.display_type == "TEXTURED":
            thing.display_type, thing.kiriko.is_drawn_by_edges = "WIRE", True
        return

    for material in materials:
        if material.diffuse_color[3] > SEE_THROUGH:
            material.kiriko.alpha_before = material.diffuse_color[3]
            material.diffuse_color[3] = GLASS


def draw_as_solid(thing: bpy.types.Object) -> None:
    """Draw a glass by its faces again, if Add Rig had it drawn by its edges."""
    if thing.kiriko.is_drawn_by_edges and thing.display_type == "WIRE":
        thing.display_type = "TEXTURED"
    thing.kiriko.property_unset("is_drawn_by_edges")


def be_opaque(material: bpy.types.Material) -> None:
    """Draw a material as before Add Rig made it see-through, if nobody changed it since."""
    ours = material.kiriko
    if ours.alpha_before and material.diffuse_color[3] == np.float32(GLASS):
        material.diffuse_color[3] = ours.alpha_before
    ours.property_unset("alpha_before")


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
