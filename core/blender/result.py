"""Writes a solution to Blender: the image, the display's
material, the numbers. All of it, or nothing.
"""

from dataclasses import asdict, replace
from typing import Any

import bpy
import numpy as np

from ..bench.helps import Helps
from ..errors import one_line
from ..messages import Message
from ..solve.solution import Solution
from ..words import NO_PLATE, summary
from . import shaders
from .image import image_from_pixels, or_none, pack, set_pixels
from .kept import Numbers, Sentences
from .result_numbers import numbers_of
from .rig_record import keep
from .scene import Reading

SOURCE = "Kiriko Source"
MATERIAL_MARK = "kiriko_display"  # marks a material that Kiriko made and may write to
BLACK_LEVEL = "kiriko_black_level"  # of the display that a material of ours was made for


def replace_image(old: bpy.types.Image | None, name: str, pixels: np.ndarray) -> bpy.types.Image:
    """A packed float image with these pixels (linear, row 0 at
    the top) that takes the place and name of an old one.
    """
    return _take_place(_packed(name, pixels), old, name)


def _packed(name: str, pixels: np.ndarray) -> bpy.types.Image:
    """A packed float image with these pixels that does not have its name yet."""
    image = image_from_pixels(f"{name} (new)", pixels)
    with or_none(image):
        pack(image, name)
    return image


def _take_place(image: bpy.types.Image, old: bpy.types.Image | None, name: str) -> bpy.types.Image:
    """Give an image the place and name of an old one, which goes."""
    if old is not None:
        old.user_remap(image)
        bpy.data.images.remove(old)
    image.name = name
    return image


def update_source(scene: bpy.types.Scene, pixels: np.ndarray) -> bpy.types.Image:
    """Show other pixels (h, w, 3; linear, row 0 at the top) as
    the scene's source image, without packing it.

    For pictures that follow each other fast: where the image has their size it stays the same
    datablock, so that no material is built again. The packed image is out of date from then on;
    `pack_source` puts that right.
    """
    image = scene.kiriko.result.source
    scene.kiriko.result.seen_summary = ""  # the simulation is of another one

    if _has_size_of(image, pixels):
        set_pixels(image, pixels)
    else:
        image = _take_place(image_from_pixels(f"{SOURCE} (new)", pixels), image, SOURCE)
        scene.kiriko.result.source = image

    scene.kiriko.result.shown = image
    image.update_tag()  # for renderers in the viewport, which keep a copy
    return image


def _has_size_of(image: bpy.types.Image | None, pixels: np.ndarray) -> bool:
    """Can an image take these pixels as it is?"""
    return image is not None and image.is_float and tuple(image.size) == pixels.shape[1::-1]


def pack_source(scene: bpy.types.Scene) -> None:
    """Save the source image within the file after `update_source`."""
    image = scene.kiriko.result.source
    if image is not None:
        pack(image, SOURCE)
        # read from the packed file when next asked for, it does not count as unsaved
        image.buffers_free()


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


def _has_no_place(display: bpy.types.Object) -> str:
    """Why no material can be put on a display; '' where one can."""
    if display.data is None or not hasattr(display.data, "materials"):
        return Message(
            "The display '{display}' has no material: give the image '{image}' to the"
            " object that it shows.",
            display=display.name,
            image=SOURCE,
        )

    if not display.is_editable:
        return Message(
            "The display '{display}' is linked from another file: give it the image"
            " '{image}' there.",
            display=display.name,
            image=SOURCE,
        )

    return ""


def put_on_display(display: bpy.types.Object, image: bpy.types.Image) -> list[str]:
    """Make a display emit an image, by a material of its own in place of the user's.

    The material is linked to the object, so that other users of the mesh keep theirs; the user's
    own material stays in the mesh and in the file. Returns one sentence for each material that gave
    way.
    """
    if why_not := _has_no_place(display):
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
        old.user_remap(ours)
        bpy.data.materials.remove(old)
        ours.name = name

    notes = []
    for slot in display.material_slots:
        theirs = slot.material
        if theirs is not None and not theirs.get(MATERIAL_MARK):
            keep(theirs)
            notes.append(
                Message(
                    "The material '{theirs}' of the display '{display}' gave way to '{ours}'.",
                    theirs=theirs.name,
                    display=display.name,
                    ours=ours.name,
                )
            )

        slot.link = "OBJECT"
        slot.material = ours

    return notes


def write_solution(scene: bpy.types.Scene, reading: Reading, solution: Solution) -> str:
    """Write a solution to the scene's result, image and display, and return it in one sentence.

    Parameters
    ----------
    reading : the scene by `scene.read`: materials, notes, display size
    solution : core.solve.solution.Solution
    """
    numbers = numbers_of(scene, reading, solution)
    remarks = _put_in_place(scene, reading, _packed(SOURCE, solution.source))
    return _write_numbers(scene, reading, solution, numbers, remarks)


def update_solution(scene: bpy.types.Scene, reading: Reading, solution: Solution) -> str:
    """The same, fast, for one of many solutions: see `update_source`.

    The display's material stays if it is right.
    """
    numbers = numbers_of(scene, reading, solution)
    image = scene.kiriko.result.source
    if _has_size_of(image, solution.source):
        display = bpy.data.objects.get(reading.display_object)
        is_shown = display is None or is_on_display(display, image)
        remarks = [] if is_shown else put_on_display(display, image)
        update_source(scene, solution.source)
    else:
        remarks = _put_in_place(
            scene, reading, image_from_pixels(f"{SOURCE} (new)", solution.source)
        )

    return _write_numbers(scene, reading, solution, numbers, remarks)


def write_coarse(scene: bpy.types.Scene, reading: Reading, pixels: np.ndarray) -> Reading:
    """Show pixels (h, w, 3; linear, row 0 at the top) as a
    coarse source image, whole as a result without numbers.

    Returns the reading from which the final result is to be
    written: it knows which materials have given way.
    """
    remarks = _put_in_place(scene, reading, _packed(SOURCE, pixels))
    notes = tuple(dict.fromkeys((*reading.notes, *remarks)))
    reading = replace(reading, notes=notes)
    result = scene.kiriko.result
    result.is_coarse, result.coverage = True, 0.0
    result.summary = result.details = result.seen_summary = ""  # the old ones are of another one
    result.notes = "\n".join(map(one_line, reading.notes))
    result.sentences = Sentences.of(reading.notes).text()
    result.solved_for = reading.solved_for

    return reading


def _put_in_place(scene: bpy.types.Scene, reading: Reading, image: bpy.types.Image) -> list[str]:
    """Give a new image the place of the scene's source image, on the display, too.

    It goes again where that fails.
    """
    old = scene.kiriko.result.source
    display = bpy.data.objects.get(reading.display_object)

    try:
        remarks = [] if display is None else put_on_display(display, image)
    except BaseException:
        if old is not None:
            image.user_remap(old)
        bpy.data.images.remove(image)
        raise

    result = scene.kiriko.result
    result.source = result.shown = _take_place(image, old, SOURCE)
    return remarks


def _write_numbers(
    scene: bpy.types.Scene,
    reading: Reading,
    solution: Solution,
    numbers: tuple[dict[str, Any], list[str]],
    remarks: list[str],
) -> str:
    """Write the panel's numbers of a solution, and return it in one sentence."""
    result = scene.kiriko.result
    details, notes = numbers
    result.coverage = details["picture_coverage"]
    result.details = Numbers(details).text()
    display = Message("The display") if reading.rig.plates else NO_PLATE
    text = summary(details["picture_coverage"], solution.misses, display)
    result.summary = text
    result.notes = "\n".join(map(one_line, dict.fromkeys([*notes, *remarks])))
    result.sentences = Sentences.of(text, notes, remarks, details).text()
    result.is_coarse = False
    result.seen_summary = ""  # the simulation is of another one
    result.solved_for = reading.solved_for

    return text


def write_helps(scene: bpy.types.Scene, helps: Helps | None) -> None:
    """Keep the remedies that were found for the light a result lacks, None where none were sought.

    They are told as long as the result is that of the scene.
    """
    if helps is None or not (helps.helps or helps.is_whole):
        return
    result = scene.kiriko.result
    details = Numbers.read(result.details).by_name
    details["helps"] = [asdict(help) for help in helps.helps]
    result.details = Numbers(details).text()
