"""Reads the pixels of an Image datablock as linear, premultiplied numbers."""

import bpy
import numpy as np
from numpy.typing import NDArray

from .errors import ImageError

LINEAR = {"Linear Rec.709", "scene_linear"}  # byte images in these hold linear numbers already


def linear_from_srgb(encoded: NDArray[np.float64]) -> NDArray[np.float64]:
    """Linear light of sRGB-encoded numbers, both 0..1. Source: IEC 61966-2-1."""
    return np.where(encoded <= 0.04045, encoded / 12.92, ((np.maximum(encoded, 0.0) + 0.055) / 1.055) ** 2.4)


def stored_pixels(image: bpy.types.Image, owner: str) -> NDArray[np.float32]:
    """Pixels (h, w, channels) as Blender keeps them, row 0 at the top. Loads the file if need be."""
    if image.type in {"RENDER_RESULT", "COMPOSITING"}:
        raise ImageError(
            f"The picture of {owner} is '{image.name}', whose pixels Blender does not hand out: "
            "save it to a file and choose that file instead."
        )
    width, height = image.size  # asking for the size loads the file
    if width < 1 or height < 1:
        place = f"the file {bpy.path.abspath(image.filepath, library=image.library)}" if image.filepath else "no file"
        raise ImageError(
            f"The image '{image.name}' of {owner} cannot be read from {place}: "
            "the file is missing or broken; choose another or find it again."
        )
    buffer = np.empty(len(image.pixels), np.float32)
    image.pixels.foreach_get(buffer)
    return buffer.reshape(height, width, -1)[::-1]


def four_channels(pixels: NDArray[np.float32]) -> NDArray[np.float32]:
    """RGBA (h, w, 4) of pixels with 1 (grey), 2 (grey, alpha), 3 (RGB) or 4 channels."""
    channels = pixels.shape[2]
    colour = pixels[..., :3] if channels >= 3 else np.repeat(pixels[..., :1], 3, axis=2)
    alpha = pixels[..., -1:] if channels in (2, 4) else np.ones_like(pixels[..., :1])
    return np.concatenate([colour, alpha], axis=2)


def read_pixels(image: bpy.types.Image, owner: str) -> NDArray[np.float32]:
    """Pixels of an image for the painter.

    Blender keeps float images linear and premultiplied, byte images as their colour space encodes them and straight.
    An image whose alpha is no coverage (None, Channel Packed, Non-Color) is opaque. The colours are those that Cycles
    shows over black with the texture's alpha linked; without that link it premultiplies *encoded* colours.

    Parameters
    ----------
    image : the datablock
    owner : whose picture it is, for the error message

    Returns
    -------
    (h, w, 4) float32, linear, premultiplied by alpha, row 0 at the top

    Raises
    ------
    ImageError : no pixels (missing or broken file, a render result), numbers that are not finite, or a byte image in
        a colour space other than sRGB, Linear Rec.709 and Non-Color
    """
    pixels = four_channels(stored_pixels(image, owner))
    if not np.isfinite(pixels).all():
        raise ImageError(f"The image '{image.name}' of {owner} has pixels that are not finite numbers: repair it.")
    space = image.colorspace_settings
    has_coverage = image.alpha_mode in {"STRAIGHT", "PREMUL"} and not space.is_data
    if not has_coverage:
        pixels[..., 3] = 1.0
    if not image.is_float:
        if space.name == "sRGB":
            table = linear_from_srgb(np.arange(256) / 255.0).astype(np.float32)
            pixels[..., :3] = table[np.rint(pixels[..., :3] * 255.0).astype(np.uint8)]
        elif not space.is_data and space.name not in LINEAR:
            raise ImageError(
                f"The image '{image.name}' of {owner} is in the colour space {space.name}, which Kiriko does not know "
                "for 8-bit images: set it to sRGB, Linear Rec.709 or Non-Color."
            )
        if has_coverage:
            pixels[..., :3] *= pixels[..., 3:]
    return pixels
