"""Creates Image datablocks from pixels, and packs them into the file."""

import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from secrets import token_hex
from weakref import ref

import bpy
import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...base.fingerprint import fingerprint
from ...files.encoding import encode, quantised
from ...files.png import encoded
from .colour import from_rec709, rec709_from_working, to_rec709

THUMBNAIL = 256  # px, Blender's largest size
UNPACKED = ""  # its packed file, if any, has older pixels
PACKED_MARK = "kiriko_packed"  # on an image: identifies its packed file
WORKING_MARK = "kiriko_working"  # on an image: the matrix to Rec.709 of the space it was made in
# by session uid of the image: the packed file of the pixels in memory; a packed file, and the
# array it was made from
_read: dict[int, str] = {}
_packed: dict[int, tuple[tuple[object, ...], "ref[NDArray[np.float32]]"]] = {}


@contextmanager
def or_none(image: bpy.types.Image) -> Iterator[None]:
    """Remove a new image if the enclosed code fails."""
    try:
        yield
    except BaseException:
        bpy.data.images.remove(image)
        raise


def image_from_pixels(name: str, pixels: ArrayLike) -> bpy.types.Image:
    """New float image datablock.

    Parameters
    ----------
    name : wanted name; Blender adds a number if it is in use
    pixels : (h, w, 3 or 4) float, linear Rec.709, row 0 at the top
    """
    pixels = np.asarray(pixels, np.float32)
    height, width, channels = pixels.shape
    image = bpy.data.images.new(name, width, height, alpha=channels == 4, float_buffer=True)
    with or_none(image):
        image[WORKING_MARK] = _working_mark()
        set_pixels(image, pixels)

    return image


def _working_mark() -> list[float]:
    matrix = rec709_from_working()
    return [] if matrix is None else matrix.ravel().tolist()


def is_in_working_space(image: bpy.types.Image) -> bool:
    """Whether an image was made in the file's present working space."""
    return list(image.get(WORKING_MARK, ())) == _working_mark()


def set_pixels(image: bpy.types.Image, pixels: NDArray[np.float32]) -> None:
    """Replace the pixels of a float image by others (h, w, 3 or 4) of the same size, linear
    Rec.709, row 0 at the top. It stays unsaved.
    """
    numbers = from_rec709(pixels)
    height, width, channels = numbers.shape
    rgba = np.ones((height, width, 4), np.float32)
    for channel in range(channels):  # numpy is slow for rows of a few numbers
        rgba[..., channel] = numbers[::-1, :, channel]
    image.pixels.foreach_set(rgba.ravel())
    image.update()
    _set_thumbnail(image, pixels)
    _read.pop(image.session_uid, None)
    image[PACKED_MARK] = UNPACKED  # an undo step has this mark, but not the pixels


def _set_thumbnail(image: bpy.types.Image, pixels: NDArray[np.float32]) -> None:
    """Make an image's thumbnail from means of its pixels: Blender's own samples every nth."""
    height, width = pixels.shape[:2]
    step = -(-max(height, width) // THUMBNAIL)
    means = _means(_means(pixels[..., :3], step).swapaxes(0, 1), step).swapaxes(0, 1)
    rgba = np.ones((*means.shape[:2], 4), np.float32)
    rgba[..., :3] = encode(means)
    thumbnail = image.preview_ensure()
    thumbnail.image_size = means.shape[1::-1]
    thumbnail.image_pixels_float.foreach_set(rgba[::-1].ravel())


def _means(values: NDArray[np.float32], step: int) -> NDArray[np.float32]:
    """Means of each `step` rows, and of the remaining ones: 5 times as fast as `reduceat`."""
    means = values[::step].copy()
    for first in range(1, step):
        more = values[first::step]
        means[: len(more)] += more
    means[:-1] /= step
    means[-1] /= len(values) - step * (len(means) - 1)
    return means


def stored_numbers(image: bpy.types.Image) -> NDArray[np.float32]:
    """Numbers (h, w, 4) of a float image as Blender has them, row 0 at the top."""
    width, height = image.size
    rgba = np.empty(width * height * 4, np.float32)
    image.pixels.foreach_get(rgba)
    return rgba.reshape(height, width, 4)[::-1].copy()


def pixels_from_image(image: bpy.types.Image) -> NDArray[np.float32]:
    """Pixels (h, w, 4) of a float image, linear Rec.709, row 0 at the top."""
    return to_rec709(stored_numbers(image))


def holds(image: bpy.types.Image, pixels: NDArray[np.float32]) -> bool:
    """Whether a float image has these pixels (h, w, 3), linear Rec.709."""
    return np.array_equal(stored_numbers(image)[..., :3], from_rec709(pixels))


def encoded_image(name: str, pixels: NDArray[np.float32]) -> bpy.types.Image:
    """New packed 8-bit sRGB image of linear pixels (h, w, 3), row 0 at the top: small in the file,
    for pictures.
    """
    return packed_image(name, encoded(quantised(pixels, "uint8")))


def packed_image(name: str, png: bytes) -> bpy.types.Image:
    """New image of a PNG file in memory. Blender reads its pixels and size on demand."""
    image = bpy.data.images.new(name, 1, 1, alpha=False)
    with or_none(image):
        image.pack(data=png, data_len=len(png))
        image.source = "FILE"

    return image


def pack(image: bpy.types.Image, name: str) -> None:
    """Save a float image within the file as `name`.exr, every number exact.

    Blender's own packing of a new image does not compress: 16 bytes a pixel, in the file and in
    each undo step. It needs no temporary file, so it is the fallback if there is no space for one.
    """
    try:
        data = _compressed(image)
    except (OSError, RuntimeError):  # Blender's name of the same error
        image.pack()
    else:
        image.pack(data=data, data_len=len(data))
        image.source = "FILE"  # from now on the image is read from the packed file
    image.filepath_raw = f"//{name}.exr"
    image[PACKED_MARK] = _read[image.session_uid] = token_hex(8)


def read_again(image: bpy.types.Image) -> bool:
    """Have a packed image reload from its file on next use, unless its pixels are already that
    file's; returns whether it reloads.

    Undo restores the packed file, but not the pixels read from it before.
    """
    if image.packed_file is None or image.is_dirty:
        return False
    packed = image.get(PACKED_MARK, "")
    if packed and _read.get(image.session_uid) == packed:
        return False
    image.buffers_free()
    _read[image.session_uid] = packed
    return True


def note_packed(image: bpy.types.Image, pixels: NDArray[np.float32]) -> None:
    """Remember the array that an image was packed from."""
    _packed[image.session_uid] = _state_of(image), ref(pixels)


def is_packed_from(image: bpy.types.Image, pixels: NDArray[np.float32]) -> bool:
    """Whether an image was packed from this very array, with nothing done to it since."""
    state, array = _packed.get(image.session_uid, (None, lambda: None))
    return array() is pixels and not image.is_dirty and _state_of(image) == state


def _state_of(image: bpy.types.Image) -> tuple[object, ...]:
    """Its packed file, and how it is read."""
    file = np.frombuffer(image.packed_file.data if image.packed_file else b"", np.uint8)
    space = image.colorspace_settings
    how = image.source, image.filepath_raw, image.alpha_mode, space.name, space.is_data
    return fingerprint(file), *how, is_in_working_space(image)


def is_out_of_date(image: bpy.types.Image) -> bool:
    """Whether an image's packed file is missing, or older than its pixels."""
    return image.get(PACKED_MARK) == UNPACKED


def _compressed(image: bpy.types.Image) -> bytes:
    """An OpenEXR file of an image."""
    scene = bpy.data.scenes.new("Kiriko Packing")  # save_render takes the format from a scene
    try:
        form = scene.render.image_settings
        form.file_format = "OPEN_EXR"
        form.color_mode = "RGBA" if image.depth == 128 else "RGB"
        form.color_depth = "32"
        form.exr_codec = "ZIP"

        with tempfile.TemporaryDirectory(prefix="kiriko-") as folder:
            path = Path(folder) / "packed.exr"
            image.save_render(str(path), scene=scene)
            return path.read_bytes()
    finally:
        bpy.data.scenes.remove(scene)


def size_of(path: Path) -> tuple[int, int]:
    """Width and height of an image file, 0 if missing or broken, read by Blender: not every
    Blender's Python has OpenImageIO.
    """
    with loaded(path) as image:
        return (0, 0) if image is None else tuple(image.size)


@contextmanager
def loaded(path: Path) -> Iterator[bpy.types.Image | None]:
    """A file as a temporary image; None if Blender cannot load it."""
    try:
        image = bpy.data.images.load(str(path), check_existing=False)
    except RuntimeError:
        yield None
        return
    try:
        yield image
    finally:
        bpy.data.images.remove(image)
