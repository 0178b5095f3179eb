"""Writes a solution to Blender: image, display material and figures, all or nothing."""

from dataclasses import asdict, replace
from typing import Any, NamedTuple

import bpy
import numpy as np

from ...base.errors import one_line
from ...base.messages import Message
from ...base.words import NO_PLATE, summary
from ...bench.measured_remedies import Help, Remedies
from ...rig.joined_display import Section, sections_of
from ...rig.rig import Rig
from ...solve.solution import Solution, with_projected
from ..data.image import (
    holds,
    image_from_pixels,
    is_in_working_space,
    is_packed_from,
    note_packed,
    or_none,
    pack,
    pixels_from_image,
    set_pixels,
)
from ..data.rectangle import flat_size
from ..data.rigs import all_settings, name_for
from ..data.stored_records import Sentences, StoredNumbers, fields_of, text_of
from ..read.scene import Reading
from .on_display import put_on_displays
from .result_images import images_of
from .result_numbers import numbers_of

SOURCE = "Kiriko Source"
SECTIONS = "kiriko_sections"  # on an image: which parts of it become files
QUILT = "kiriko_quilt"  # on an image of views: the numbers of `Quilt`


class Quilt(NamedTuple):
    """Columns and rows of an image's tiles, rows of views, and width over height of the display."""

    across: float
    down: float
    rows: float
    aspect: float

    @property
    def tiling(self) -> tuple[int, int]:
        """Columns and rows of the tiles."""
        return int(self.across), int(self.down)


def replace_image(old: bpy.types.Image | None, name: str, pixels: np.ndarray) -> bpy.types.Image:
    """A packed float image with these pixels (linear, row 0 at the top) that replaces an old one
    under its name, unless another result has it, too.
    """
    return _take_place(_packed(name, pixels), old, name)


def unpacked_image(old: bpy.types.Image | None, name: str, pixels: np.ndarray) -> bpy.types.Image:
    """The same without packing, for images in quick succession."""
    return _take_place(image_from_pixels(f"{name} (new)", pixels), old, name)


def let_go(result: bpy.types.PropertyGroup, image: bpy.types.Image) -> None:
    """Remove an image of a result unless more than windows uses it."""
    if result.shown == image:
        result.shown = result.source
    shown = bpy.types.Screen | bpy.types.WorkSpace | bpy.types.WindowManager
    users = bpy.data.user_map(subset=[image])[image]
    if not image.use_fake_user and all(isinstance(user, shown) for user in users):
        bpy.data.images.remove(image)


def _packed(name: str, pixels: np.ndarray) -> bpy.types.Image:
    """A packed float image with these pixels, under a temporary name."""
    image = image_from_pixels(f"{name} (new)", pixels)
    with or_none(image):
        pack(image, name)
    return image


def _take_place(image: bpy.types.Image, old: bpy.types.Image | None, name: str) -> bpy.types.Image:
    """Replace an old image under its name and remove it. An image of several results, as in a full
    copy of a scene, stays.
    """
    if old is not None and not _is_shared(old):
        old.user_remap(image)
        bpy.data.images.remove(old)
    image.name = name
    return image


def _is_shared(image: bpy.types.Image) -> bool:
    """Whether several results, of other scenes or rigs, have an image."""
    return sum(image in images_of(ours.result) for ours in all_settings()) > 1


def sections_in(image: bpy.types.Image) -> list[Section]:
    """The sections of a result's image that become files; a single one has no name."""
    found = fields_of(image.get(SECTIONS, "")).get("sections", [])
    return [Section(*one) for one in found] or [Section("", 0, *image.size)]


def quilt_in(image: bpy.types.Image) -> Quilt | None:
    """The tiles of a result's image; None if its display has no views."""
    found = image.get(QUILT)
    return None if found is None else Quilt(*found)


def quilt_of(rig: Rig) -> Quilt | None:
    """The tiles of a rig's source image; None without a display with views, the only one then."""
    display = next((one for one in rig.displays if one.views is not None), None)
    if display is None:
        return None
    width, height = flat_size(display.mesh) or display.size
    return Quilt(*display.views.tiling(display.size), display.views.rows, width / height)


def _note_sections(image: bpy.types.Image, rig: Rig) -> None:
    """Record the sections of several displays, screens and projectors in their image, or the tiles
    of views.
    """
    quilt = quilt_of(rig)
    if quilt is not None:
        image[QUILT] = quilt
    elif QUILT in image:
        del image[QUILT]
    if len(rig.outputs) > 1:
        image[SECTIONS] = text_of({"sections": rig.files})
    elif SECTIONS in image:
        del image[SECTIONS]


def update_source(scene: bpy.types.Scene, pixels: np.ndarray) -> bpy.types.Image:
    """Show pixels (h, w, 3; linear, row 0 at the top) as the scene's source image, without packing
    it.

    For pictures in quick succession: an image of the same size stays the same datablock, so no
    material is rebuilt. Its packed file is out of date until `pack_source`.
    """
    image = scene.kiriko.result.source
    if has_size_of(image, pixels):
        set_pixels(image, pixels)
    else:
        name = name_for(scene, SOURCE)
        scene.kiriko.result.source = image = unpacked_image(image, name, pixels)

    image.update_tag()  # for viewport renderers, which keep a copy
    _show_source(scene)
    return image


def _show_on_displays(scene: bpy.types.Scene, reading: Reading) -> list[str]:
    """Show the source image as it is on the displays and in the result; returns remarks."""
    image = scene.kiriko.result.source
    _note_sections(image, reading.rig)
    _show_source(scene)
    return put_on_displays(reading, image)


def _show_source(scene: bpy.types.Scene) -> None:
    """Show the source image in the result, and drop the older simulation."""
    scene.kiriko.result.seen_summary = ""
    scene.kiriko.result.shown = scene.kiriko.result.source


def has_size_of(image: bpy.types.Image | None, pixels: np.ndarray) -> bool:
    """Whether an image belongs to one result and fits these pixels."""
    fits = image is not None and image.is_float and tuple(image.size) == pixels.shape[1::-1]
    return fits and is_in_working_space(image) and not _is_shared(image)


def pack_source(scene: bpy.types.Scene) -> None:
    """Pack the source image after `update_source`."""
    image = scene.kiriko.result.source
    if image is not None:
        pack(image, image.name)
        # reloaded from the packed file on next use, it counts as saved
        image.buffers_free()


def write_solution(scene: bpy.types.Scene, reading: Reading, solution: Solution) -> str:
    """Write a solution to the scene's result, image and display, and return it in one sentence.

    Parameters
    ----------
    reading : the scene by `scene.read`: materials, notes, display size
    solution : core.solve.solution.Solution
    """
    numbers = numbers_of(scene, reading, solution)
    image, name = scene.kiriko.result.source, name_for(scene, SOURCE)
    pixels = solution.image
    is_there = image is not None and image.name == name and not _is_shared(image)
    if is_there and is_packed_from(image, pixels):
        image.buffers_free()  # read from the packed file, whatever was painted since
        remarks = _show_on_displays(scene, reading)
    else:
        image = _packed(name, pixels)
        note_packed(image, pixels)
        remarks = _put_in_place(scene, reading, image)
    return _write_numbers(scene, reading, solution, numbers, remarks)


def update_solution(scene: bpy.types.Scene, reading: Reading, solution: Solution) -> str:
    """The same, fast, for one of many solutions: see `update_source`.

    A correct display material and unchanged pixels stay.
    """
    numbers = numbers_of(scene, reading, solution)
    image = scene.kiriko.result.source
    pixels = solution.image
    if has_size_of(image, pixels):
        remarks = _show_on_displays(scene, reading)
        if not holds(image, pixels):
            update_source(scene, pixels)
    else:
        name = f"{name_for(scene, SOURCE)} (new)"
        remarks = _put_in_place(scene, reading, image_from_pixels(name, pixels))

    return _write_numbers(scene, reading, solution, numbers, remarks)


def update_coarse(scene: bpy.types.Scene, reading: Reading, pixels: np.ndarray) -> Reading:
    """Show pixels as `update_source` does, as a rough source image, also on the display, while the
    final one is computed.

    Returns the reading for the final result, with notes on replaced materials.
    """
    pixels = with_projected(reading.rig, pixels)
    before = scene.kiriko.result.source
    if reading.rig.projectors and has_size_of(before, pixels):  # they show the old one until then
        first = sections_of(reading.rig.outputs)[len(reading.rig.lit)].top
        pixels[first:] = pixels_from_image(before)[first:, :, :3]
    image = update_source(scene, pixels)
    _note_sections(image, reading.rig)
    scene.kiriko.result.is_coarse = True
    return _with_notes(reading, put_on_displays(reading, image))


def update_final(scene: bpy.types.Scene, reading: Reading, pixels: np.ndarray) -> Reading:
    """The same with the final source image; the old figures are dropped, the new ones follow."""
    reading = update_coarse(scene, reading, pixels)
    _take_numbers(scene, reading, is_coarse=False)
    return reading


def leave_coarse(scene: bpy.types.Scene, reading: Reading) -> None:
    """Keep a rough source image from `update_coarse`, and drop the figures of the previous one."""
    if scene.kiriko.result.is_coarse:
        _take_numbers(scene, reading, is_coarse=True)


def _with_notes(reading: Reading, notes: list[str]) -> Reading:
    """A reading with further notes, each once."""
    return replace(reading, notes=tuple(dict.fromkeys((*reading.notes, *notes))))


def write_coarse(scene: bpy.types.Scene, reading: Reading, pixels: np.ndarray) -> Reading:
    """Show pixels (h, w, 3; linear, row 0 at the top) as a rough source image, a complete result
    without figures.

    Returns the reading for the final result, with notes on replaced materials.
    """
    pixels = with_projected(reading.rig, pixels)
    remarks = _put_in_place(scene, reading, _packed(name_for(scene, SOURCE), pixels))
    reading = _with_notes(reading, remarks)
    _take_numbers(scene, reading, is_coarse=True)
    return reading


def _take_numbers(scene: bpy.types.Scene, reading: Reading, is_coarse: bool) -> None:
    """Drop the figures of an earlier source image."""
    result = scene.kiriko.result
    result.is_coarse, result.coverage = is_coarse, 0.0
    result.summary = result.details = result.seen_summary = ""
    result.notes = "\n".join(map(one_line, reading.notes))
    result.sentences = Sentences.of(reading.notes).text()
    result.solved_for = reading.solved_for


def _put_in_place(scene: bpy.types.Scene, reading: Reading, image: bpy.types.Image) -> list[str]:
    """Replace the scene's source image, also on the display, by a new one; remove the new one if
    this fails.
    """
    old, name = scene.kiriko.result.source, name_for(scene, SOURCE)
    _note_sections(image, reading.rig)

    try:
        remarks = put_on_displays(reading, image, name)
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
    """Write the panel's figures of a solution, and return it in one sentence."""
    result = scene.kiriko.result
    details, notes = numbers
    result.coverage = details["picture_coverage"]
    result.details = StoredNumbers(details).text()
    met = {role.name for role, _ in reading.rig.parts() if role.kind is not None}
    display = NO_PLATE if met == {"GLASS", "DISPLAY"} else Message("The display")
    text = summary(details["picture_coverage"], solution.misses, display)
    if len(solution.channels) > 1:
        text = Message("'{viewer}': {summary}", viewer=solution.first.viewer.name, summary=text)
    result.summary = text
    result.notes = "\n".join(map(one_line, dict.fromkeys([*notes, *remarks])))
    result.sentences = Sentences.of(text, notes, remarks, details).text()
    result.is_coarse = False
    result.seen_summary = ""  # it shows an older image
    result.solved_for = reading.solved_for

    return text


def write_helps(scene: bpy.types.Scene, helps: Remedies | None) -> None:
    """Store the remedies for a result's lost light; None if none were sought.

    They are reported as long as the result is up to date.
    """
    if helps is None or not (helps.helps or helps.is_whole):
        return
    _add_numbers(scene, {"helps": [asdict(help) for help in helps.helps]})


def write_legibility(scene: bpy.types.Scene, legibility: float, helps: tuple[Help, ...]) -> None:
    """Store the picture's legibility, 0..1, and its remedies."""
    _add_numbers(scene, legibility_numbers(legibility, helps))


def legibility_numbers(legibility: float, helps: tuple[Help, ...]) -> dict[str, Any]:
    """The legibility and its remedies as figures of a result."""
    return {"legibility": legibility, "legible_by": [asdict(help) for help in helps]}


def write_viewers(scene: bpy.types.Scene, found: dict[str, Any]) -> None:
    """Store the views of several viewers by name; nothing for a single viewer."""
    if found:
        _add_numbers(scene, found)


def _add_numbers(scene: bpy.types.Scene, found: dict[str, Any]) -> None:
    """Add later figures to a result."""
    result = scene.kiriko.result
    details = StoredNumbers.read(result.details).by_name
    result.details = StoredNumbers({**details, **found}).text()
