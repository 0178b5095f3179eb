"""Reads and writes image files; the one file that imports OpenImageIO."""

import importlib
import importlib.util
from collections.abc import Container
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..base.errors import ImageError
from ..base.messages import Message, joined
from . import png
from .disk import check_new, together
from .encoding import encode as encode  # scripts ask for it here
from .encoding import quantised

PROFILE_NAME = "ICCProfile:profile_description"
# chromaticities: red, green, blue, white
REC709 = (0.64, 0.33, 0.30, 0.60, 0.15, 0.06, 0.3127, 0.3290)


@dataclass(frozen=True)
class Format:
    """A kind of image file: its suffix, type of number, and
    whether its numbers are linear light or sRGB-encoded.
    """

    suffix: str
    number: str
    is_linear: bool


FORMATS = {
    "PNG8": Format(".png", "uint8", False),
    "PNG16": Format(".png", "uint16", False),
    "TIFF16": Format(".tif", "uint16", False),
    "EXR_HALF": Format(".exr", "half", True),
    "EXR_FLOAT": Format(".exr", "float", True),
}
PLAIN = ("PNG8", "PNG16")  # written without OpenImageIO, too
SUFFIX_FORMS = {"PNG8", "TIFF16", "EXR_FLOAT"}  # the format that a suffix alone means
SUFFIXES = {".png", ".tif", ".tiff", ".exr"}


def named_for(path: Path | str, form: str, images: Container[str] = ()) -> Path:
    """The path with the suffix of a format, in place of another
    format's if it has one, or of another image's.

    images : suffixes of images of other kinds, in lower case
    """
    path = Path(path)
    suffix = FORMATS[form].suffix
    if path.suffix.lower().startswith(suffix):  # .tiff is .tif too
        return path
    is_image = path.suffix.lower() in SUFFIXES or path.suffix.lower() in images
    return path.with_suffix(suffix) if is_image else path.with_name(path.name + suffix)


def format_for(path: Path | str, form: str) -> str:
    """The format that a path's suffix asks for: `form` where that fits or there is no
    such suffix.
    """
    suffix = Path(path).suffix.lower().replace(".tiff", ".tif")
    if suffix == FORMATS[form].suffix:
        return form
    return next(
        (name for name, kind in FORMATS.items() if kind.suffix == suffix and name in SUFFIX_FORMS),
        form,
    )


REMEDY = Message("install it (in Debian python3-openimageio) or take Blender from blender.org")


def openimageio() -> Any:
    """The module, or ImageError where this Python has none."""
    try:
        return importlib.import_module("OpenImageIO")  # late: only who writes files needs it
    except ImportError:
        raise ImageError(
            "This Blender's Python has no OpenImageIO, which reads and writes the files: {remedy}.",
            remedy=REMEDY,
        ) from None


def has_openimageio() -> bool:
    """Has this Python OpenImageIO?"""
    return importlib.util.find_spec("OpenImageIO") is not None


def why_not(form: str) -> str:
    """Why files of a format cannot be written, with the remedy: a sentence without its full stop;
    '' where they can.
    """
    if form in PLAIN or has_openimageio():
        return ""
    others = {FORMATS[name].suffix for name in PLAIN}
    return Message(
        "This Blender's Python has no OpenImageIO, which writes {suffix}: {instead}{remedy}",
        suffix=FORMATS[form].suffix,
        instead=joined(Message("choose {suffix}, ", suffix=suffix) for suffix in sorted(others)),
        remedy=REMEDY,
    )


def _quantised(pixels: np.ndarray, form: Format, gamma: float | None) -> np.ndarray:
    if form.is_linear:
        return np.ascontiguousarray(pixels, np.float32)
    return quantised(pixels, form.number, gamma)


def _colour_space(form: Format, gamma: float | None) -> tuple[str, str]:
    """Of a file's numbers: OpenImageIO's name, and the words for its description."""
    if form.is_linear:
        return "lin_rec709", "linear Rec.709"
    return ("sRGB", "sRGB") if gamma is None else (f"g{gamma:g}_rec709", f"gamma {gamma:g}")


def _spec(
    oiio: Any,
    form: Format,
    shape: tuple[int, int, int],
    size: tuple[float, float] | None,
    title: str,
    gamma: float | None,
) -> Any:
    height, width, channels = shape
    spec = oiio.ImageSpec(width, height, channels, form.number)
    name, about = _colour_space(form, gamma)
    spec.attribute("oiio:ColorSpace", name)
    spec.attribute("Software", "Kiriko")
    spec.attribute("png:compressionLevel", 1)  # 1920 x 1080: 0.12 s of 0.52, files 4 % larger
    spec.attribute("png:filter", 64)
    about = [title, about]
    if form.suffix == ".exr":
        spec.attribute("chromaticities", "float[8]", REC709)
        spec.attribute("compression", "zip")

    if size is not None:
        # inches everywhere: OpenImageIO turns pixels per cm into
        # pixels per inch the wrong way round for EXR
        across, down = (0.0254 * n / side for n, side in zip((width, height), size, strict=True))
        spec.attribute("XResolution", across)
        spec.attribute("YResolution", down)
        spec.attribute("ResolutionUnit", "in")
        spec.attribute("PixelAspectRatio", down / across)

        for name, side in zip(("kiriko:width_mm", "kiriko:height_mm"), size, strict=True):
            # PNG and TIFF keep names of their own only, hence the text as well
            spec.attribute(name, 1000.0 * side)
            about.append(f"{name}={1000.0 * side:.6g}")

    spec.attribute("ImageDescription", "; ".join(about))
    return spec


def write(  # noqa: PLR0913 - all but three have a default, and scripts name them
    path: Path | str,
    pixels: ArrayLike,
    form: str,
    *,
    size: tuple[float, float] | None = None,
    title: str = "Kiriko source image",
    gamma: float | None = None,
    overwrite: bool = False,
) -> Path:
    """Write an image file, whole or not at all. Without OpenImageIO a PNG has no metadata.

    Parameters
    ----------
    path : the file; its suffix is set by the format
    pixels : (h, w, 3 or 4) or (h, w) float, linear Rec.709, row 0
        at the top; encoded for formats not linear
    form : a key of FORMATS
    size : width and height in m of the area that the image covers, for the metadata
    title : first words of the description in the metadata
    gamma : by which numbers of formats not linear are encoded; None: sRGB
    overwrite : replace an existing file

    Returns
    -------
    The path written.

    Raises
    ------
    ImageError
        The file exists, or cannot be written.
    """
    kind = FORMATS[form]
    path = named_for(path, form)
    check_new(path, overwrite)

    is_plain = kind.suffix == ".png" and not has_openimageio()
    oiio = None if is_plain else openimageio()
    pixels = np.asarray(pixels)
    pixels = _quantised(pixels[..., None] if pixels.ndim == 2 else pixels, kind, gamma)

    with together(path.parent) as new:
        part = new / path.name
        if is_plain:
            png.write(part, pixels)
            return path

        put(part, _spec(oiio, kind, pixels.shape, size, title, gamma), pixels)

    return path


def put(path: Path, spec: Any, pixels: np.ndarray) -> None:
    """Write pixels (h, w, c) to a new file by OpenImageIO's specification; ImageError where the
    file is not whole then.
    """
    oiio = openimageio()
    spec.attribute("DateTime", "")  # else that of today: the same image is to be the same file
    out = oiio.ImageOutput.create(str(path))
    is_written = out is not None and out.open(str(path), spec)
    is_written = is_written and out.write_image(pixels) and out.close()
    if not is_written:
        why = (oiio if out is None else out).geterror().strip() or Message("no reason given")
        out = None  # closes it: not every system removes an open file
        raise ImageError(
            "The file '{path}' cannot be written ({why}): check the disk.", path=path, why=why
        )

    if not _is_whole(path):  # of a disk that fills up at a PNG's end OpenImageIO says nothing
        raise ImageError("The file '{path}' is not whole after writing: check the disk.", path=path)


def _is_whole(path: Path) -> bool:
    """Can an image file be read to its end?"""
    try:
        return png.is_whole(path) if path.suffix == ".png" else bool(read(path, is_plain=True))
    except ImageError:
        return False


def read(path: Path | str, is_plain: bool = False) -> tuple[np.ndarray, dict[str, Any]]:
    """Numbers of an image file as they stand (h, w, c) float32,
    integers as 0..1, row 0 at the top; and its metadata.

    is_plain : the numbers in the file's own type, which takes less time, and all of them

    Raises
    ------
    ImageError
        The file is missing or broken.
    """
    source = _opened(path)
    try:
        spec = source.spec()
        pixels = source.read_image(format=spec.format if is_plain else "float")
        why = " ".join(source.geterror().split())
        if pixels is None or (is_plain and why):
            raise ImageError(
                "The image '{path}' is broken ({why}): choose another file.", path=path, why=why
            )
    finally:
        source.close()

    pixels = np.asarray(pixels, None if is_plain else np.float32)
    return pixels, _words(spec)


def about(path: Path | str) -> dict[str, Any]:
    """The metadata of an image file; raises as `read` does."""
    source = _opened(path)
    try:
        return _words(source.spec())
    finally:
        source.close()


def size(path: Path | str) -> tuple[int, int]:
    """Pixels of an image file, across and down; raises as `read` does."""
    source = _opened(path)
    try:
        spec = source.spec()
        return spec.width, spec.height
    finally:
        source.close()


def _words(spec: Any) -> dict[str, Any]:
    # OpenImageIO 3.0 ends with a signal where it is asked for a profile's empty signature
    listed = [one for one in spec.extra_attribs if not one.name.startswith("ICCProfile:")]
    words = {one.name: one.value for one in listed}
    if "ICCProfile" in words:
        words[PROFILE_NAME] = spec.getattribute(PROFILE_NAME)
    # what Blender writes of it as text into a PNG, or 0, turns nothing
    if words.get("Orientation") not in range(1, 9):
        words.pop("Orientation", None)
    return words


def _opened(path: Path | str) -> Any:
    oiio = openimageio()
    source = oiio.ImageInput.open(str(path))
    if source is None:
        raise unreadable(path, oiio.geterror())
    return source


def unreadable(path: Path | str, why: str) -> ImageError:
    """The error that an image file cannot be read, for a reason of OpenImageIO's."""
    return ImageError(
        "The image '{path}' cannot be read ({why}): choose another file.",
        path=path,
        why=" ".join(why.split()),
    )
