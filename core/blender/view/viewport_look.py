"""Viewport appearance of a rig without a render: glass and plate are see-through.

By default Solid mode draws the material's colour, so its alpha makes an object see-through in every
new file. The object's own colour counts only with Color: Object.
"""

import bpy
import numpy as np

from ..materials import shaders
from ..result.on_display import MATERIAL_MARK

GLASS = 0.3  # alpha of glass in Solid mode: both its shape and the picture inside are visible
SEE_THROUGH = 0.5  # materials with a lower alpha are left alone
PLATE = (0.15, 0.5, 1.0, 0.5)
PLATE_OPACITY = 0.12  # in EEVEE
SCREEN = (0.02, 0.02, 0.03, 1.0)
# colour of other parts in Solid mode; alpha below 1 is see-through
COLOURS = {
    "MIRROR": (0.55, 0.6, 0.65, 1.0),
    "HALF_MIRROR": (0.5, 0.7, 0.8, 0.35),
    "RETROREFLECTOR": (0.35, 0.35, 0.4, 1.0),
    "LENS": (0.7, 0.85, 1.0, 0.35),
    "POLARISER": (0.3, 0.3, 0.35, 0.5),
    "WAVE_PLATE": (0.9, 0.85, 0.7, 0.3),
    "BLOCKER": (0.05, 0.05, 0.05, 1.0),
}
IN_PORTALS = {"RETROREFLECTOR", "LENS"}  # drawn black by EEVEE


def see_through(thing: bpy.types.Object, glasses: tuple[bpy.types.Object, ...]) -> None:
    """Make a glass see-through in Solid mode, and store the change.

    An object is drawn as wireframe instead if it has no material, or if one of its materials is
    linked or used by objects other than glasses.
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
    """Draw a glass solid again if Add Rig set it to wireframe."""
    if thing.kiriko.is_drawn_by_edges and thing.display_type == "WIRE":
        thing.display_type = "TEXTURED"
    thing.kiriko.property_unset("is_drawn_by_edges")


def be_opaque(material: bpy.types.Material) -> None:
    """Restore a material's opacity from before Add Rig, unless somebody changed it since."""
    ours = material.kiriko
    if ours.alpha_before and material.diffuse_color[3] == np.float32(GLASS):
        material.diffuse_color[3] = ours.alpha_before
    ours.property_unset("alpha_before")


def _is_of(material: bpy.types.Material, own: set[bpy.types.ID]) -> bool:
    """Whether a material can be changed without changing other objects."""
    users = {user for user in bpy.data.user_map(subset=[material])[material]}
    return material.is_editable and users <= own


def be_seen_as_glass(material: bpy.types.Material, ior: float) -> None:
    """Turn a material into clear glass, see-through in Solid mode."""
    shaders.be_glass(material, ior, True)
    material.diffuse_color = (0.8, 0.9, 1.0, GLASS)


def be_seen_as_plate(material: bpy.types.Material) -> None:
    """Turn a material into an ideal plate, tinted and see-through outside Cycles. EEVEE would draw
    its portal black.
    """
    shaders.be_plate(material)
    material.diffuse_color = PLATE
    material.surface_render_method = "BLENDED"
    shaders.tint_in_eevee(material, PLATE[:3], PLATE_OPACITY)


def be_seen_as(material: bpy.types.Material, role: str) -> None:
    """Colour the material of a part outside Cycles."""
    material.diffuse_color = colour = COLOURS[role]
    if role in IN_PORTALS:
        material.surface_render_method = "BLENDED"
        shaders.tint_in_eevee(material, colour[:3], colour[3])


def be_seen_as_screen(material: bpy.types.Material) -> None:
    """Turn a material into an empty display, black. A result replaces it silently."""
    shaders.be_blocker(material)
    material[MATERIAL_MARK] = True
    material.diffuse_color = SCREEN
