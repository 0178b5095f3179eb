"""Writes a solution to Blender: the image, the display's
material, the numbers. All of it, or nothing.
"""

from dataclasses import asdict, replace
from typing import Any

import bpy
import numpy as np

from ...base.errors import one_line
from ...base.messages import Message
from ...base.words import NO_PLATE, summary
from ...bench.measured_remedies import Help, Remedies
from ...solve.solution import Solution
from ..data.image import holds, image_from_pixels, is_in_working_space, or_none, pack, set_pixels
from ..data.rigs import all_settings, name_for
from ..data.stored_records import Sentences, StoredNumbers
from ..read.scene import Reading
from .on_display import is_on_display, put_on_display
from .result_images import images_of
from .result_numbers import numbers_of

SOURCE = "Kiriko Source"


def replace_image(old: bpy.types.Image | None, name: str, pixels: np.ndarray) -> bpy.types.Image:
    """A packed float image with these pixels (linear, row 0 at the top) that takes the place and
    name of an old one, but of one that another result has, too.
    """
    return _take_place(_packed(name, pixels), old, name)


def unpacked_image(old: bpy.types.Image | None, name: str, pixels: np.ndarray) -> bpy.types.Image:
    """The same, but not packed, for images that follow each other fast."""
    return _take_place(image_from_pixels(f"{name} (new)", pixels), old, name)


def let_go(result: bpy.types.PropertyGroup, image: bpy.types.Image) -> None:
    """Remove an image that a result had, unless anything but windows uses it."""
    if result.shown == image:
        result.shown = result.source
    shown = bpy.types.Screen | bpy.types.WorkSpace | bpy.types.WindowManager
    users = bpy.data.user_map(subset=[image])[image]
    if not image.use_fake_user and all(isinstance(user, shown) for user in users):
        bpy.data.images.remove(image)


def _packed(name: str, pixels: np.ndarray) -> bpy.types.Image:
    """A packed float image with these pixels that does not have its name yet."""
    image = image_from_pixels(f"{name} (new)", pixels)
    with or_none(image):
        pack(image, name)
    return image


def _take_place(image: bpy.types.Image, old: bpy.types.Image | None, name: str) -> bpy.types.Image:
    """Give an image the place and name of an old one, which goes; where another result has the old
    one, too, as in a full copy of a scene, it stays there.
    """
    if old is not None and not _is_shared(old):
        old.user_remap(image)
        bpy.data.images.remove(old)
    image.name = name
    return image


def _is_shared(image: bpy.types.Image) -> bool:
    """Do several results, of other scenes or rigs, have an image?"""
    return sum(image in images_of(ours.result) for ours in all_settings()) > 1


def update_source(scene: bpy.types.Scene, pixels: np.ndarray) -> bpy.types.Image:
    """Show other pixels (h, w, 3; linear, row 0 at the top) as
    the scene's source image, without packing it.

    For pictures that follow each other fast: where the image has their size it stays the same
    datablock, so that no material is built again. The packed image is out of date from then on;
    `pack_source` puts that right.
    """
    image = scene.kiriko.result.source
    if has_size_of(image, pixels):
        set_pixels(image, pixels)
    else:
        name = name_for(scene, SOURCE)
        scene.kiriko.result.source = image = unpacked_image(image, name, pixels)

    image.update_tag()  # for renderers in the viewport, which keep a copy
    _show_source(scene)
    return image


def _show_source(scene: bpy.types.Scene) -> None:
    """Show the source image in the result; the simulation is of another one."""
    scene.kiriko.result.seen_summary = ""
    scene.kiriko.result.shown = scene.kiriko.result.source


def has_size_of(image: bpy.types.Image | None, pixels: np.ndarray) -> bool:
    """Can an image, of one result alone, take these pixels as it is?"""
    fits = image is not None and image.is_float and tuple(image.size) == pixels.shape[1::-1]
    return fits and is_in_working_space(image) and not _is_shared(image)


def pack_source(scene: bpy.types.Scene) -> None:
    """Save the source image within the file after `update_source`."""
    image = scene.kiriko.result.source
    if image is not None:
        pack(image, image.name)
        # read from the packed file when next asked for, it does not count as unsaved
        image.buffers_free()


def write_solution(scene: bpy.types.Scene, reading: Reading, solution: Solution) -> str:
    """Write a solution to the scene's result, image and display, and return it in one sentence.

    Parameters
    ----------
    reading : the scene by `scene.read`: materials, notes, display size
    solution : core.solve.solution.Solution
    """
    numbers = numbers_of(scene, reading, solution)
    image = _packed(name_for(scene, SOURCE), solution.source)
    remarks = _put_in_place(scene, reading, image)
    return _write_numbers(scene, reading, solution, numbers, remarks)


def update_solution(scene: bpy.types.Scene, reading: Reading, solution: Solution) -> str:
    """The same, fast, for one of many solutions: see `update_source`.

    The display's material stays if it is right, and so do pixels that were written already.
    """
    numbers = numbers_of(scene, reading, solution)
    image = scene.kiriko.result.source
    if has_size_of(image, solution.source):
        display = bpy.data.objects.get(reading.display_object)
        is_shown = display is None or is_on_display(display, image)
        remarks = [] if is_shown else put_on_display(display, image)
        if holds(image, solution.source):
            _show_source(scene)
        else:
            update_source(scene, solution.source)
    else:
        name = f"{name_for(scene, SOURCE)} (new)"
        remarks = _put_in_place(scene, reading, image_from_pixels(name, solution.source))

    return _write_numbers(scene, reading, solution, numbers, remarks)


def update_coarse(scene: bpy.types.Scene, reading: Reading, pixels: np.ndarray) -> Reading:
    """Show pixels as `update_source` does, as a coarse source image: on the display, too, so that
    it is seen through the glass while the final one takes its time.

    Returns the reading from which the final result is to be
    written: it knows which materials have given way.
    """
    image = update_source(scene, pixels)
    scene.kiriko.result.is_coarse = True
    display = bpy.data.objects.get(reading.display_object)
    if display is None or is_on_display(display, image):
        return reading
    return _with_notes(reading, put_on_display(display, image))


def update_final(scene: bpy.types.Scene, reading: Reading, pixels: np.ndarray) -> Reading:
    """The same with the final source image, whose numbers follow: those of before go."""
    reading = update_coarse(scene, reading, pixels)
    _take_numbers(scene, reading, is_coarse=False)
    return reading


def leave_coarse(scene: bpy.types.Scene, reading: Reading) -> None:
    """A coarse source image that `update_coarse` showed stays: numbers of the one before go."""
    if scene.kiriko.result.is_coarse:
        _take_numbers(scene, reading, is_coarse=True)


def _with_notes(reading: Reading, notes: list[str]) -> Reading:
    """A reading with further notes, each once."""
    return replace(reading, notes=tuple(dict.fromkeys((*reading.notes, *notes))))


def write_coarse(scene: bpy.types.Scene, reading: Reading, pixels: np.ndarray) -> Reading:
    """Show pixels (h, w, 3; linear, row 0 at the top) as a
    coarse source image, whole as a result without numbers.

    Returns the reading from which the final result is to be
    written: it knows which materials have given way.
    """
    remarks = _put_in_place(scene, reading, _packed(name_for(scene, SOURCE), pixels))
    reading = _with_notes(reading, remarks)
    _take_numbers(scene, reading, is_coarse=True)
    return reading


def _take_numbers(scene: bpy.types.Scene, reading: Reading, is_coarse: bool) -> None:
    """Take away numbers of another source image than the one of this reading that is shown now."""
    result = scene.kiriko.result
    result.is_coarse, result.coverage = is_coarse, 0.0
    result.summary = result.details = result.seen_summary = ""
    result.notes = "\n".join(map(one_line, reading.notes))
    result.sentences = Sentences.of(reading.notes).text()
    result.solved_for = reading.solved_for


def _put_in_place(scene: bpy.types.Scene, reading: Reading, image: bpy.types.Image) -> list[str]:
    """Give a new image the place of the scene's source image, on the display, too.

    It goes again where that fails.
    """
    old, name = scene.kiriko.result.source, name_for(scene, SOURCE)
    display = bpy.data.objects.get(reading.display_object)

    try:
        remarks = [] if display is None else put_on_display(display, image, name)
    except BaseException:
        if old is not None:
            image.user_remap(old)
        bpy.data.images.remove(image)
        raise

    result = scene.kiriko.result
    result.source = result.shown = _take_place(image, old, name)
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
    result.details = StoredNumbers(details).text()
    display = Message("The display") if reading.rig.plates else NO_PLATE
    text = summary(details["picture_coverage"], solution.misses, display)
    if len(solution.channels) > 1:
        text = Message("'{viewer}': {summary}", viewer=solution.first.viewer.name, summary=text)
    result.summary = text
    result.notes = "\n".join(map(one_line, dict.fromkeys([*notes, *remarks])))
    result.sentences = Sentences.of(text, notes, remarks, details).text()
    result.is_coarse = False
    result.seen_summary = ""  # the simulation is of another one
    result.solved_for = reading.solved_for

    return text


def write_helps(scene: bpy.types.Scene, helps: Remedies | None) -> None:
    """Keep the remedies that were found for the light a result lacks, None where none were sought.

    They are told as long as the result is that of the scene.
    """
    if helps is None or not (helps.helps or helps.is_whole):
        return
    _add_numbers(scene, {"helps": [asdict(help) for help in helps.helps]})


def write_legibility(scene: bpy.types.Scene, legibility: float, helps: tuple[Help, ...]) -> None:
    """Keep how legible the picture is, 0..1, and the remedies that were found."""
    _add_numbers(scene, legibility_numbers(legibility, helps))


def legibility_numbers(legibility: float, helps: tuple[Help, ...]) -> dict[str, Any]:
    """The same as numbers of a result."""
    return {"legibility": legibility, "legible_by": [asdict(help) for help in helps]}


def write_viewers(scene: bpy.types.Scene, found: dict[str, Any]) -> None:
    """Keep what several viewers see of a result, by name; nothing where there is one."""
    if found:
        _add_numbers(scene, found)


def _add_numbers(scene: bpy.types.Scene, found: dict[str, Any]) -> None:
    """Keep beside the numbers of a result those that were found after it."""
    result = scene.kiriko.result
    details = StoredNumbers.read(result.details).by_name
    result.details = StoredNumbers({**details, **found}).text()
