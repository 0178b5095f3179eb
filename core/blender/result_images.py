"""The images of a result: one list of them, for all who show, keep
or remove them; and has the source image its numbers?
"""

import bpy

IMAGES = ("source", "seen", "preview", "conflict")


def images_of(result: bpy.types.PropertyGroup) -> list[bpy.types.Image]:
    """The images that a result has, in the order of the list."""
    found = [getattr(result, name) for name in IMAGES]
    return [image for image in found if image is not None]


def lacks_numbers(result: bpy.types.PropertyGroup) -> bool:
    """Is a result's source image final, and are its numbers still to come?"""
    return result.source is not None and not result.is_coarse and not result.summary
