"""The images of a result: one list of them, for all who show, keep or remove them."""

import bpy

IMAGES = ("source", "seen", "preview", "conflict")


def images_of(result: bpy.types.PropertyGroup) -> list[bpy.types.Image]:
    """The images that a result has, in the order of the list."""
    found = [getattr(result, name) for name in IMAGES]
    return [image for image in found if image is not None]
