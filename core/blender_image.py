"""Makes Image datablocks of pixels, and saves them within the file."""

import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import bpy
import numpy as np
from numpy.typing import ArrayLike, NDArray

from .image_io import encode

LINEAR = ("Linear Rec.709", "Linear BT.709", "Linear Rec.709 (sRGB)", "Linear")  # its names through the versions


@contextmanager
def or_none(image: bpy.types.Image) -> Iterator[None]:
    """Remove a new image again if what is within, which makes it whole, goes wrong."""
    try:
        yield
    except BaseException:
        bpy.data.images.remove(image)
        raise


def image_from_pixels(name: str, pixels: ArrayLike) -> bpy.types.Image:
    """New float image datablock.

    Parameters
    ----------
    name : wanted name; Blender adds a number where it is taken
    pixels : (h, w, 3 or 4) float, linear Rec.709, row 0 at the top
    """
    pixels = np.asarray(pixels, np.float32)
    height, width, channels = pixels.shape
    image = bpy.data.images.new(name, width, height, alpha=channels == 4, float_buffer=True)
    with or_none(image):
        spaces = {item.identifier for item in image.colorspace_settings.bl_rna.properties["name"].enum_items}
        linear = next((space for space in LINEAR if space in spaces), None)
        if linear is not None:  # else a colour configuration of the user's own: a new float image is scene linear there
            image.colorspace_settings.name = linear
        set_pixels(image, pixels)
    return image


def set_pixels(image: bpy.types.Image, pixels: NDArray[np.float32]) -> None:
    """Give a float image of the same size other pixels (h, w, 3 or 4), linear, row 0 at the top; it stays unsaved."""
    height, width, channels = pixels.shape
    rgba = np.ones((height, width, 4), np.float32)
    rgba[..., :channels] = pixels[::-1]
    image.pixels.foreach_set(rgba.ravel())
    image.update()


def pixels_from_image(image: bpy.types.Image) -> np.ndarray:
    """Pixels (h, w, 4) float32 as Blender holds them, row 0 at the top."""
    width, height = image.size
    rgba = np.empty(width * height * 4, np.float32)
    image.pixels.foreach_get(rgba)
    return rgba.reshape(height, width, 4)[::-1].copy()


def encoded_image(name: str, pixels: ArrayLike) -> bpy.types.Image:
    """New packed 8-bit sRGB image of linear pixels (h, w, 3), row 0 at the top: small in the file, for pictures."""
    encoded = encode(pixels)[::-1]
    height, width, _ = encoded.shape
    rgba = np.concatenate([encoded, np.ones((height, width, 1))], axis=2).astype(np.float32)
    image = bpy.data.images.new(name, width, height, alpha=False)
    with or_none(image):
        image.pixels.foreach_set(rgba.ravel())
        image.update()
        image.pack()
    return image


def pack(image: bpy.types.Image, name: str) -> None:
    """Save a float image within the file as `name`.exr, every number exact.

    Blender's own packing of a new image does not compress: 16 bytes a pixel, in the file and in each undo step. But it
    needs no file: it is what is left where there is no room for one.
    """
    try:
        data = _compressed(image)
    except (OSError, RuntimeError):  # the second is how Blender says the same
        image.pack()
    else:
        image.pack(data=data, data_len=len(data))
        image.source = "FILE"  # from now on the packed file is what the image is read from
    image.filepath_raw = f"//{name}.exr"


def _compressed(image: bpy.types.Image) -> bytes:
    """An OpenEXR file of an image."""
    scene = bpy.data.scenes.new("Kiriko Packing")  # save_render takes the format from a scene
    try:
        form = scene.render.image_settings
        form.file_format = "OPEN_EXR"
        form.color_mode, form.color_depth, form.exr_codec = "RGBA" if image.depth == 128 else "RGB", "32", "ZIP"
        with tempfile.TemporaryDirectory(prefix="kiriko-") as folder:
            path = Path(folder) / "packed.exr"
            image.save_render(str(path), scene=scene)
            return path.read_bytes()
    finally:
        bpy.data.scenes.remove(scene)
