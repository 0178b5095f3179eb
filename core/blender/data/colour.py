"""Colours of Blender's images to and from linear Rec.709, by Blender's own conversions.

Float images are in Blender's working space, which is not always Rec.709; 8-bit ones are encoded in
their colour space. A custom colour configuration may rename or hide spaces, so no name is used.
"""

import bpy
import numpy as np
from mathutils import Color
from numpy.typing import NDArray

from ...base.arrays import Floats
from ...files import png
from ...files.encoding import linear_from_srgb

ROUNDED = 1e-5  # error of Blender 4.2's matrix from Rec.709 to itself
# allowed error of linear light: less than half a step of sRGB's 8 bits, 1.5e-4 in the dark
ALIKE = 1e-4
AT_ONCE = 1 << 20  # pixels converted in one pass
BYTES = np.arange(256)
# by the names of a space and the working space; cached, since Blender re-evaluates everything after
# a conversion
_tables: dict[tuple[str, bytes | None], NDArray[np.float32] | None] = {}


TABLES = tuple(
    np.asarray(curve, np.float32) for curve in (linear_from_srgb(BYTES / 255), BYTES / 255)
)


def rec709_from_working() -> Floats | None:
    """The matrix (3, 3) from linear colours of the working space to Rec.709; None if they are the
    same.
    """
    columns = [Color(axis).from_scene_linear_to_rec709_linear() for axis in np.eye(3)]
    matrix = np.array(columns, float).T
    return None if np.allclose(matrix, np.eye(3), rtol=0, atol=ROUNDED) else matrix


def to_rec709(pixels: NDArray[np.float32]) -> NDArray[np.float32]:
    """Pixels (h, w, 3 or 4) from the working space to linear Rec.709, converted in place."""
    matrix = rec709_from_working()
    if matrix is not None:
        pixels[..., :3] = pixels[..., :3] @ matrix.T.astype(np.float32)
    return pixels


def from_rec709(pixels: NDArray[np.float32]) -> NDArray[np.float32]:
    """Linear Rec.709 pixels (h, w, 3 or 4) in the working space: the same array for Rec.709."""
    matrix = rec709_from_working()
    if matrix is None:
        return pixels
    pixels = pixels.copy()
    pixels[..., :3] = pixels[..., :3] @ np.linalg.inv(matrix).T.astype(np.float32)
    return pixels


def table_of(image: bpy.types.Image) -> NDArray[np.float32] | None:
    """Table (256,) from an 8-bit image's values to linear Rec.709 light, the same for each channel;
    None unless they are linear or encoded as sRGB.
    """
    matrix = rec709_from_working()
    of_space = image.colorspace_settings.name, None if matrix is None else matrix.tobytes()
    if of_space not in _tables:
        _tables[of_space] = _found_table(image)
    return _tables[of_space]


def _found_table(image: bpy.types.Image) -> NDArray[np.float32] | None:
    ramps = np.zeros((4, 256, 3), np.uint8)
    ramps[0] = BYTES[:, None]
    for channel in range(3):
        ramps[channel + 1, :, channel] = BYTES
    found = converted(image, ramps)
    return next((t for t in TABLES if np.abs(found - t[ramps]).max() < ALIKE), None)


def converted(image: bpy.types.Image, numbers: NDArray[np.uint8]) -> NDArray[np.float32]:
    """The linear Rec.709 light of values (h, w, 3) in an image's colour space.

    Blender converts on loading as float, so the values are loaded from a PNG file of 16 bits.
    """
    data = png.encoded(numbers.astype(np.uint16) * 257, level=0)
    copy = image.copy()  # has the colour space, even an unnamed one
    try:
        copy.source = "FILE"
        copy.pack(data=data, data_len=len(data))
        found = np.empty(len(copy.pixels), np.float32)
        copy.pixels.foreach_get(found)
    finally:
        bpy.data.images.remove(copy)
    return to_rec709(found.reshape(*numbers.shape[:2], -1)[::-1, :, :3])


def decode(image: bpy.types.Image, pixels: NDArray[np.float32]) -> None:
    """Replace an 8-bit image's values 0..1 (h, w, 4) by their linear Rec.709 light."""
    step = max(1, AT_ONCE // pixels.shape[1])
    for first in range(0, len(pixels), step):
        rows = pixels[first : first + step, :, :3]
        rows[:] = converted(image, np.rint(rows * 255.0).astype(np.uint8))
