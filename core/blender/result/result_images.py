"""The images of a result: one list of them, for all who show, keep
or remove them; and has the source image its numbers?
"""

import bpy

from ...solve.solved_for import OF_NO_SCENE
from ..data.image import is_out_of_date, read_anew
from ..data.rigs import all_settings

IMAGES = ("source", "seen", "preview", "conflict")


def images_of(result: bpy.types.PropertyGroup) -> list[bpy.types.Image]:
    """The images that a result has, in the order of the list."""
    found = [getattr(result, name) for name in IMAGES]
    return [image for image in found if image is not None]


def lacks_numbers(result: bpy.types.PropertyGroup) -> bool:
    """Is a result's source image final, and are its numbers still to come?"""
    return result.source is not None and not result.is_coarse and not result.summary


def read_images_anew() -> None:
    """Have the images of all results be those that are packed, after undo.

    A step made while Live had newer pixels than it had packed has the numbers of those: they are of
    no scene any more.
    """
    for ours in all_settings():
        result = ours.result
        if result.source is not None and is_out_of_date(result.source):
            result.solved_for = OF_NO_SCENE.as_text()
        for image in images_of(result):
            read_anew(image)
