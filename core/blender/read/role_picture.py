"""The picture's plane in Blender."""

from .elements import read_picture
from .part_roles import Found, InBlender
from .scene_parts import Part
from .shapes import Kept


def read(part: Part, kept: Kept) -> Found:
    """The plane with the pixels of its image."""
    picture, notes = read_picture(part, kept)
    return Found(picture, notes, [])


# a guide for the artist: in a preview the light itself is there
IN_BLENDER = InBlender(read, None)
