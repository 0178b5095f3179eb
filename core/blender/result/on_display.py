"""Puts a source image on the display, by a material of Kiriko's own."""

import bpy

from ...base.messages import Message
from ..data.image import PACKED_MARK
from ..data.rigs import keep
from ..materials import shaders

MATERIAL_MARK = "kiriko_display"  # marks a material that Kiriko made and may write to
BLACK_LEVEL = "kiriko_black_level"  # of the display that a material of ours was made for


def is_on_display(display: bpy.types.Object, image: bpy.types.Image) -> bool:
    """Does a display show an image by materials of ours on all its slots, as dark as it can?"""
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
    """Why no material can be put on a display; '' where one can."""
    if display.data is None or not hasattr(display.data, "materials"):
        return Message(
            "'{display}' has no material of its own. Give the image '{image}' to the object it"
            " shows.",
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

    name : that the image is about to have; None: it has it

    The material is linked to the object, so that other users of the mesh keep theirs; the user's
    own material stays in the mesh and in the file. Returns one sentence for each material that gave
    way.
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

    # the new material takes the place of Kiriko's own from before
    own = {display, display.data} if display.data.users == 1 else {display}
    if old is not None and bpy.data.user_map(subset=[old])[old] <= own:  # else others show it, too
        name = old.name
        before = [node.image for node in old.node_tree.nodes if node.type == "TEX_IMAGE"]
        old.user_remap(ours)
        bpy.data.materials.remove(old)
        ours.name = name
        # of a result that is gone, as that of a rig whose duplicate this is
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
