"""Reads the pixels of an Image datablock as linear Rec.709 light, premultiplied."""

import bpy
import numpy as np
from numpy.typing import NDArray

from ...base.errors import ImageError
from ...base.free_memory import check_free
from ...base.messages import Message
from ...native import image_passes, loading
from ..data import colour
from ..data.image_file import check_header, check_whole
from ..data.moving import check_there

# types of image that Blender shows without giving out pixels
UNREADABLE = {"RENDER_RESULT", "COMPOSITING"}
OF_PIXEL = 16  # bytes for reading a pixel: four float32
DECODED_AT_ONCE = 1 << 18  # pixels decoded in one pass


def check_readable(image: bpy.types.Image, owner: str) -> None:
    """Raise ImageError if an image has no pixels to read. Loads the file if need be."""
    if image.type in UNREADABLE:
        raise ImageError(
            "The image '{image}' of {owner} exists only in the Image Editor. Save it there (Image >"
            " Save As) and choose the file.",
            image=image.name,
            owner=owner,
        )

    check_header(image, owner)
    if min(image.size) < 1:  # reading the size loads the file
        if image.type == "MULTILAYER":
            raise ImageError(
                "The image '{image}' of {owner} has several layers or views. Save one of them"
                " (Image > Save As) and choose the file.",
                image=image.name,
                owner=owner,
            )
        if not image.filepath:
            raise ImageError(
                "The image '{image}' of {owner} is empty and has no file. Choose another.",
                image=image.name,
                owner=owner,
            )
        raise ImageError(
            "The image '{image}' of {owner} cannot be read: {file} is missing or broken. Restore"
            " the file, or choose another.",
            image=image.name,
            owner=owner,
            file=bpy.path.abspath(image.filepath, library=image.library),
        )


def check_at(image: bpy.types.Image, number: int | None, owner: str) -> None:
    """Raise ImageError if a frame of an image cannot be read; None for a still image. Moving images
    are not copied.
    """
    if number is None:
        check_readable(image, owner)
    else:
        check_there(image, number, owner)


def stored_pixels(image: bpy.types.Image, owner: str) -> NDArray[np.float32]:
    """Pixels (h, w, channels) as stored by Blender, row 0 at the top. Loads the file if need be.

    Raises ImageError without pixels, RigError if they need more than the free memory.
    """
    check_readable(image, owner)
    check_whole(image, owner)
    width, height = image.size
    check_free(
        float(OF_PIXEL) * width * height,
        Message("Reading the image '{image}' of {owner}", image=image.name, owner=owner),
        Message("choose a smaller one ({width} x {height} pixels)", width=width, height=height),
    )
    buffer = np.empty(len(image.pixels), np.float32)
    image.pixels.foreach_get(buffer)

    return buffer.reshape(height, width, -1)[::-1]


def four_channels(pixels: NDArray[np.float32]) -> NDArray[np.float32]:
    """RGBA (h, w, 4) of pixels with 1 (grey), 2 (grey, alpha), 3 (RGB) or 4 channels; with 4 the
    same array.
    """
    height, width, channels = pixels.shape
    if channels == 4:
        return pixels
    rgba = np.ones((height, width, 4), np.float32)
    rgba[..., :3] = pixels[..., :3] if channels == 3 else pixels[..., :1]
    if channels == 2:
        rgba[..., 3] = pixels[..., 1]
    return rgba


def read_pixels(image: bpy.types.Image, owner: str) -> NDArray[np.float32]:
    """Pixels of an image for the painter.

    Blender stores float images in its working space and premultiplied, byte images encoded in their
    colour space and straight. An image whose alpha is not coverage (None, Channel Packed,
    Non-Color) is opaque. The colours are those Cycles shows over black with the texture's alpha
    linked; without this link it premultiplies *encoded* colours.

    Parameters
    ----------
    image : the datablock
    owner : the picture's owner, for error messages

    Returns
    -------
    (h, w, 4) float32, linear Rec.709, premultiplied by alpha, row 0 at the top

    Raises
    ------
    ImageError : no pixels (missing or broken file, a render result), or non-finite numbers
    RigError : not enough memory
    """
    return decoded(image, stored_pixels(image, owner), owner)


def decoded(image: bpy.types.Image, stored: NDArray[np.float32], owner: str) -> NDArray[np.float32]:
    """The same from stored pixels (h, w, channels), converted in place."""
    pixels = four_channels(stored)
    has_coverage = image.alpha_mode in {"STRAIGHT", "PREMUL"}
    has_coverage &= not image.colorspace_settings.is_data
    table = None if image.is_float else colour.table_of(image)
    if table is None and not image.is_float:
        colour.decode(image, pixels)
    # in place: there may be gigabytes of them
    decode = image_passes.decode if loading.library() is not None else _decode
    is_straight = has_coverage and not image.is_float
    if not decode(pixels, table, has_coverage, is_straight):
        raise ImageError(
            "The image '{image}' of {owner} has infinite or invalid pixels. Repair it.",
            image=image.name,
            owner=owner,
        )
    return colour.to_rec709(pixels) if image.is_float else pixels


def _decode(
    pixels: NDArray[np.float32],
    table: NDArray[np.float32] | None,
    has_coverage: bool,
    is_straight: bool,
) -> bool:
    """The same as `image_passes.decode`."""
    step = max(1, DECODED_AT_ONCE // pixels.shape[1])
    for first in range(0, len(pixels), step):
        rows = pixels[first : first + step]
        if not np.isfinite(rows).all():
            return False
        if not has_coverage:
            rows[..., 3] = 1.0
        if table is not None:
            rows[..., :3] = table[np.rint(rows[..., :3] * 255.0).astype(np.uint8)]
        if is_straight:
            rows[..., :3] *= rows[..., 3:]
    return True
