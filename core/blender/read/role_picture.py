"""Blender's side of the picture's plane."""

from .elements import read_picture
from .part_roles import FoundPart, InBlender
from .scene_parts import WorldPart
from .shapes import ShapeCache


def read(part: WorldPart, cache: ShapeCache) -> FoundPart:
    """The plane with the pixels of its image."""
    picture, notes = read_picture(part, cache)
    return FoundPart(picture, notes, [])


# not in previews: the plane is a guide for the artist, and a preview shows the light itself
IN_BLENDER = InBlender(read, None)
