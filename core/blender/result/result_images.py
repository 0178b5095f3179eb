"""The images of a result, for display, storage and removal."""

import bpy

from ...solve.solved_for import OF_NO_SCENE
from ..data.image import is_out_of_date, read_again
from ..data.rigs import all_settings

IMAGES = ("source", "seen", "preview", "conflict")


def images_of(result: bpy.types.PropertyGroup) -> list[bpy.types.Image]:
    """The images of a result, in the order of the list."""
    found = [getattr(result, name) for name in IMAGES]
    return [image for image in found if image is not None]


def is_missing_numbers(result: bpy.types.PropertyGroup) -> bool:
    """Whether a result's source image is final while its figures are still to come."""
    return result.source is not None and not result.is_coarse and not result.summary


def read_images_again() -> None:
    """Reload the images of all results from their packed files, after undo.

    An undo step made while Live had unpacked pixels has the figures of those pixels: its result
    belongs to no scene.
    """
    for ours in all_settings():
        result = ours.result
        if result.source is not None and is_out_of_date(result.source):
            result.solved_for = OF_NO_SCENE.as_text()
        for image in images_of(result):
            read_again(image)
