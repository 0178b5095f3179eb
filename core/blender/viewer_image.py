"""Reads the picture in the viewers' own pixels: one image for all of them, or one for each."""

from collections.abc import Sequence

import bpy
import numpy as np
from numpy.typing import NDArray

from ..base.messages import Message
from ..rig.parts import OwnImage
from ..rig.rig import Picture, PicturePlace, Viewer
from .elements import about, tone_of
from .moving import ended, number_at
from .shapes import Kept
from .viewer import Seat


def read_in_own_pixels(
    scene: bpy.types.Scene, seats: Sequence[Seat], viewers: Sequence[Viewer], kept: Kept
) -> tuple[list[Picture], list[str]]:
    """The picture, none where no image is chosen, with notes on images of another size or shape.

    Where one viewer has an image of its own all must have one, which the rig's check tells.

    viewers : of these seats
    """
    own = [
        (seat.image, viewer)
        for seat, viewer in zip(seats, viewers, strict=True)
        if seat.image is not None
    ]
    if own:
        return _read_each(scene, own, kept)

    image = scene.kiriko.picture_image
    if image is None:
        return [], []

    pixels, notes = _read(scene, image, Message("the scene's picture"), kept)
    place = PicturePlace(image.name, *pixels.shape[1::-1])
    for viewer in viewers[:1]:
        off = abs(place.width * viewer.height - place.height * viewer.width)
        if off > max(viewer.width, viewer.height):
            notes.append(
                Message(
                    "The picture image '{image}' has {width} x {height} pixels, the viewer"
                    " {viewer_width} x {viewer_height}: it is stretched to fit.",
                    image=image.name,
                    width=place.width,
                    height=place.height,
                    viewer_width=viewer.width,
                    viewer_height=viewer.height,
                )
            )
    return [place.showing(pixels)], notes


def _read_each(
    scene: bpy.types.Scene, own: list[tuple[bpy.types.Image, Viewer]], kept: Kept
) -> tuple[list[Picture], list[str]]:
    """An image for each viewer."""
    found: list[OwnImage] = []
    notes: list[str] = []
    for image, viewer in own:
        owner = Message("the viewer '{viewer}'", viewer=viewer.name)
        pixels, remarks = _read(scene, image, owner, kept)
        found.append(OwnImage(viewer.name, pixels))
        notes += remarks
        if pixels.shape[1::-1] != (viewer.width, viewer.height):
            notes.append(
                Message(
                    "The image '{image}' has {width} x {height} pixels, its viewer '{viewer}'"
                    " {viewer_width} x {viewer_height}: it is stretched to fit.",
                    image=image.name,
                    width=pixels.shape[1],
                    height=pixels.shape[0],
                    viewer=viewer.name,
                    viewer_width=viewer.width,
                    viewer_height=viewer.height,
                )
            )
    return [Picture(own[0][0].name, found[0].image, own=tuple(found))], notes


def _read(
    scene: bpy.types.Scene, image: bpy.types.Image, owner: str, kept: Kept
) -> tuple[NDArray[np.float32], list[str]]:
    """The pixels of an image at the scene's frame, and notes on it."""
    frame = scene.frame_current
    tone = tone_of(scene.kiriko.picture)
    pixels = kept.pixels(image, owner, tone, number_at(image, None, frame))
    return pixels, about(image) + ended(image, None, frame) + kept.notes_on(image)
