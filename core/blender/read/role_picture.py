"""The picture's plane in Blender."""

from .elements import read_picture
from .part_roles import FoundPart, InBlender
from .scene_parts import WorldPart
from .shapes import ShapeCache


def read(part: WorldPart, kept: ShapeCache) -> FoundPart:
    """The plane with the pixels of its image."""
    picture, notes = read_picture(part, kept)
    return FoundPart(picture, notes, [])


# a guide for the artist: in a preview the light itself is there
IN_BLENDER = InBlender(read, None)
