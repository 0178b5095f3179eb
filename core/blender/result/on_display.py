"""Shows a source image on displays and screens, by materials of Kiriko's own."""

from collections.abc import Iterator

import bpy

from ...base.messages import Message
from ...rig.joined_display import sections_of, size_of
from ..data.image import PACKED_MARK
from ..data.rigs import keep
from ..materials import shaders
from ..materials.shaders import ImageLook
from ..read.role_display import look_of
from ..read.scene import Reading

MATERIAL_MARK = "kiriko_display"  # on materials made by Kiriko, which it may change
LOOK = "kiriko_look"  # on such a material: how its display shows the image


def displays_of(reading: Reading) -> Iterator[tuple[bpy.types.Object, ImageLook]]:
    """The objects of all displays and screens, with their looks."""
    rig = reading.rig
    sections = sections_of(rig.outputs)
    for key, section, part in zip(reading.display_objects, sections, rig.lit, strict=False):
        thing = bpy.data.objects.get(key)
        if thing is not None:
            is_screen = thing.kiriko.role == "SCREEN"
            yield thing, look_of(part, section.window(size_of(sections)), is_screen)


def plain_look(display: bpy.types.Object) -> ImageLook:
    """How a display or a screen shows all of an image."""
    ours = display.kiriko
    is_screen = ours.role == "SCREEN"
    return ImageLook(0.0 if is_screen else ours.display.black_level, is_two_sided=is_screen)


def window_of(display: bpy.types.Object) -> tuple[float, float, float]:
    """The window of the image that a display shows: width, height and lower edge in UV."""
    shown = (slot.material.get(LOOK) for slot in display.material_slots if slot.material)
    return next((tuple(look[1:4]) for look in shown if look), (1.0, 1.0, 0.0))


def are_on_displays(reading: Reading, image: bpy.types.Image | None) -> bool:
    """Whether all displays and screens show their sections of an image."""
    return all(is_on_display(display, image, look) for display, look in displays_of(reading))


def is_on_display(
    display: bpy.types.Object, image: bpy.types.Image, look: ImageLook | None = None
) -> bool:
    """Whether Kiriko's materials on all slots show an image with a look."""
    look = look or plain_look(display)
    materials = [slot.material for slot in display.material_slots]
    return bool(materials) and all(
        m is not None
        and m.get(MATERIAL_MARK)
        and list(m.get(LOOK, ())) == look.numbers
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


def put_on_displays(reading: Reading, image: bpy.types.Image, name: str | None = None) -> list[str]:
    """Make all displays and screens emit their sections of an image, unless they do."""
    return [
        note
        for display, look in displays_of(reading)
        if not is_on_display(display, image, look)
        for note in put_on_display(display, image, name, look)
    ]


def put_on_display(
    display: bpy.types.Object,
    image: bpy.types.Image,
    name: str | None = None,
    look: ImageLook | None = None,
) -> list[str]:
    """Make a display emit an image, by a material of its own in place of the user's.

    name : the image's future name; None for its present one
    look : None for all of the image

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
        look = look or plain_look(display)
        ours[LOOK] = look.numbers
        shaders.show_image(ours, image, look)
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
