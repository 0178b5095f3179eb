"""Shows a source image on the display, by a material of Kiriko's own."""

import bpy

from ...base.messages import Message
from ..data.image import PACKED_MARK
from ..data.rigs import keep
from ..materials import shaders

MATERIAL_MARK = "kiriko_display"  # on materials made by Kiriko, which it may change
BLACK_LEVEL = "kiriko_black_level"  # on such a material: the black level of its display


def is_on_display(display: bpy.types.Object, image: bpy.types.Image) -> bool:
    """Whether Kiriko's materials on all slots show an image at the display's black level."""
    black_level = display.kiriko.display.black_level
    materials = [slot.material for slot in display.material_slots]
    return bool(materials) and all(
        m is not None
        and m.get(MATERIAL_MARK)
        and m.get(BLACK_LEVEL, 0.0) == black_level
        and any(node.type == "TEX_IMAGE" and node.image == image for node in m.node_tree.nodes)
        for m in materials
    )


def _has_no_place(display: bpy.types.Object, name: str) -> str:
    """Why a display cannot have a material; '' if it can."""
    if display.data is None or not hasattr(display.data, "materials"):
        return Message(
            "'{display}' has no material of its own. Assign the image '{image}' to the object it"
            " instances.",
            display=display.name,
            image=name,
        )

    if not display.is_editable:
        return Message(
            "'{display}' is linked from another file. Give it the image '{image}' there.",
            display=display.name,
            image=name,
        )

    return ""


def put_on_display(
    display: bpy.types.Object, image: bpy.types.Image, name: str | None = None
) -> list[str]:
    """Make a display emit an image, by a material of its own in place of the user's.

    name : the image's future name; None for its present one

    The material is linked to the object, so other users of the mesh keep theirs. The user's own
    material stays in the mesh and in the file. Returns a sentence for each replaced material.
    """
    if why_not := _has_no_place(display, name or image.name):
        return [why_not]

    old = next(
        (
            s.material
            for s in display.material_slots
            if s.material and s.material.get(MATERIAL_MARK)
        ),
        None,
    )
    ours = bpy.data.materials.new(f"{display.name} Source")

    try:
        ours[MATERIAL_MARK] = True
        ours[BLACK_LEVEL] = display.kiriko.display.black_level
        shaders.show_image(ours, image, display.kiriko.display.black_level)
    except BaseException:
        bpy.data.materials.remove(ours)
        raise

    if not display.material_slots:
        display.data.materials.append(None)

    # the new material replaces Kiriko's earlier one
    own = {display, display.data} if display.data.users == 1 else {display}
    if old is not None and bpy.data.user_map(subset=[old])[old] <= own:  # no other object's
        name = old.name
        before = [node.image for node in old.node_tree.nodes if node.type == "TEX_IMAGE"]
        old.user_remap(ours)
        bpy.data.materials.remove(old)
        ours.name = name
        # left from a removed result, such as that of the rig this display was copied from
        gone = [one for one in before if one and PACKED_MARK in one and not one.users]
        bpy.data.batch_remove(gone)

    notes = []
    for slot in display.material_slots:
        theirs = slot.material
        if theirs is not None and not theirs.get(MATERIAL_MARK):
            keep(theirs)
            notes.append(
                Message(
                    "The material '{theirs}' of '{display}' was replaced by '{ours}'.",
                    theirs=theirs.name,
                    display=display.name,
                    ours=ours.name,
                )
            )

        slot.link = "OBJECT"
        slot.material = ours

    return notes
