"""Reads and writes image files; the only file that imports OpenImageIO."""

import importlib
import importlib.util
from collections.abc import Container
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..base.errors import ImageError
from ..base.messages import Message, as_message, quoted
from . import png
from .disk import check_new, together
from .encoding import REC709, Curve, Encoding, quantised
from .encoding import encode as encode  # imported here by scripts

PROFILE_NAME = "ICCProfile:profile_description"


@dataclass(frozen=True)
class Format:
    """A kind of image file: its suffix, number type, and linear or sRGB-encoded values."""

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
PLAIN = ("PNG8", "PNG16")  # can be written without OpenImageIO
SUFFIX_FORMS = {"PNG8", "TIFF16", "EXR_FLOAT"}  # formats chosen by suffix alone
SUFFIXES = {".png", ".tif", ".tiff", ".exr"}


def named_for(path: Path | str, form: str, images: Container[str] = ()) -> Path:
    """The path with a format's suffix, replacing any suffix of an image.

    images : suffixes of other kinds of images, lower case
    """
    path = Path(path)
    suffix = FORMATS[form].suffix
    if path.suffix.lower().startswith(suffix):  # .tiff counts as .tif
        return path
    is_image = path.suffix.lower() in SUFFIXES or path.suffix.lower() in images
    return path.with_suffix(suffix) if is_image else path.with_name(path.name + suffix)


def format_for(path: Path | str, form: str) -> str:
    """The format for a path's suffix; `form` if it fits or the suffix is unknown."""
    suffix = Path(path).suffix.lower().replace(".tiff", ".tif")
    if suffix == FORMATS[form].suffix:
        return form
    return next(
        (name for name, kind in FORMATS.items() if kind.suffix == suffix and name in SUFFIX_FORMS),
        form,
    )


REMEDY = Message(
    "install it (pip: OpenImageIO; Debian: python3-openimageio) or use Blender from blender.org"
)


def openimageio() -> Any:
    """The OpenImageIO module; ImageError if this Python does not have it."""
    try:
        return importlib.import_module("OpenImageIO")  # imported late: only file operations need it
    except ImportError:
        raise ImageError(
            "This Python has no OpenImageIO to read and write images: {remedy}.",
            remedy=REMEDY,
        ) from None


def has_openimageio() -> bool:
    """Whether OpenImageIO is installed."""
    return importlib.util.find_spec("OpenImageIO") is not None


def why_not(form: str) -> str:
    """Why a format cannot be written, with the remedy and without a full stop; '' if it can."""
    if form in PLAIN or has_openimageio():
        return ""
    return Message(
        "This Python has no OpenImageIO to write {suffix}: choose .png, or {remedy}",
        suffix=FORMATS[form].suffix,
        remedy=REMEDY,
    )


def _quantised(pixels: np.ndarray, form: Format, gamma: Curve) -> np.ndarray:
    if form.is_linear:
        return np.ascontiguousarray(pixels, np.float32)
    return quantised(pixels, form.number, gamma)


def _colour_space(form: Format, gamma: Curve) -> tuple[str, str]:
    """OpenImageIO's name of a file's colour space, and its words in the description."""
    if form.is_linear:
        return "lin_rec709", "linear Rec.709"
    if isinstance(gamma, Encoding):
        return "", f"{gamma.name}, white {gamma.white:g} cd/m2"
    return ("sRGB", "sRGB") if gamma is None else (f"g{gamma:g}_rec709", f"gamma {gamma:g}")


def _spec(
    oiio: Any,
    form: Format,
    shape: tuple[int, int, int],
    size: tuple[float, float] | None,
    title: str,
    gamma: Curve,
) -> Any:
    height, width, channels = shape
    spec = oiio.ImageSpec(width, height, channels, form.number)
    name, about = _colour_space(form, gamma)
    if name:
        spec.attribute("oiio:ColorSpace", name)
    spec.attribute("Software", "Kiriko")
    spec.attribute("png:compressionLevel", 1)  # saves 0.12 of 0.52 s at 1920 x 1080; files grow 4 %
    spec.attribute("png:filter", 64)
    about = [title, about]
    if form.suffix == ".exr":
        spec.attribute("chromaticities", "float[8]", REC709)
        spec.attribute("compression", "zip")

    if size is not None:
        # always inches: OpenImageIO converts pixels per cm to pixels per inch incorrectly for EXR
        across, down = (0.0254 * n / side for n, side in zip((width, height), size, strict=True))
        spec.attribute("XResolution", across)
        spec.attribute("YResolution", down)
        spec.attribute("ResolutionUnit", "in")
        spec.attribute("PixelAspectRatio", down / across)

        for name, side in zip(("kiriko:width_mm", "kiriko:height_mm"), size, strict=True):
            # PNG and TIFF drop custom names, so the text has them as well
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
    gamma: Curve = None,
    overwrite: bool = False,
) -> Path:
    """Write an image file, completely or not at all. Without OpenImageIO a PNG has no metadata.

    Parameters
    ----------
    path : the file; its suffix is set by the format
    pixels : (h, w, 3 or 4) or (h, w) float, linear Rec.709, row 0 at the top; encoded for
        non-linear formats
    form : "PNG8" or "PNG16"; with OpenImageIO also "TIFF16", "EXR_HALF" or "EXR_FLOAT"
    size : width and height, m, of the area covered by the image, for the metadata
    title : first words of the description in the metadata
    gamma : encodes non-linear formats; None: sRGB; an Encoding is tagged in PNG files only
    overwrite : replace an existing file

    Returns
    -------
    Path
        The file written.

    Raises
    ------
    ImageError
        The file exists, or cannot be written.
    """
    if form not in FORMATS:
        raise ImageError(
            "{name} is '{value}': set it to one of {choices}.",
            name=as_message("Format"),
            value=form,
            choices=quoted(FORMATS),
        )
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
        else:
            put(part, _spec(oiio, kind, pixels.shape, size, title, gamma), pixels)
        if isinstance(gamma, Encoding) and kind.suffix == ".png":
            png.tag(part, b"cICP", bytes([*gamma.codes, 0, 1]))  # RGB, of full range

    return path


def put(path: Path, spec: Any, pixels: np.ndarray) -> None:
    """Write pixels (h, w, c) to a new file with OpenImageIO; ImageError if the file is
    incomplete.
    """
    oiio = openimageio()
    spec.attribute("DateTime", "")  # else today's: equal images must give equal files
    out = oiio.ImageOutput.create(str(path))
    is_written = out is not None and out.open(str(path), spec)
    is_written = is_written and out.write_image(pixels) and out.close()
    if not is_written:
        why = (oiio if out is None else out).geterror().strip() or Message("no reason given")
        out = None  # closes it: some systems cannot remove an open file
        raise ImageError(
            "The file '{path}' cannot be written ({why}): check the disk.", path=path, why=why
        )

    if not _is_whole(path):  # OpenImageIO does not report a disk that fills up at a PNG's end
        raise ImageError(
            "The file '{path}' is incomplete after writing: check the disk.", path=path
        )


def _is_whole(path: Path) -> bool:
    """Whether an image file can be read to its end."""
    try:
        return png.is_whole(path) if path.suffix == ".png" else bool(read(path, is_plain=True))
    except ImageError:
        return False


def read(path: Path | str, is_plain: bool = False) -> tuple[np.ndarray, dict[str, Any]]:
    """Numbers of an image file (h, w, c) float32, integers as 0..1, row 0 at the top; and its
    metadata.

    is_plain : read in the file's own type, which is faster, and require all numbers

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
    return pixels, _metadata(spec)


def about(path: Path | str) -> dict[str, Any]:
    """The metadata of an image file; raises as `read` does."""
    source = _opened(path)
    try:
        return _metadata(source.spec())
    finally:
        source.close()


def size(path: Path | str) -> tuple[int, int]:
    """Width and height of an image file in pixels; raises as `read` does."""
    source = _opened(path)
    try:
        spec = source.spec()
        return spec.width, spec.height
    finally:
        source.close()


def _metadata(spec: Any) -> dict[str, Any]:
    # OpenImageIO 3.0 crashes when reading a profile's empty signature
    listed = [one for one in spec.extra_attribs if not one.name.startswith("ICCProfile:")]
    metadata = {one.name: one.value for one in listed}
    if "ICCProfile" in metadata:
        metadata[PROFILE_NAME] = spec.getattribute(PROFILE_NAME)
    # Blender writes text or 0 into PNGs, which means no rotation
    if metadata.get("Orientation") not in range(1, 9):
        metadata.pop("Orientation", None)
    return metadata


def _opened(path: Path | str) -> Any:
    oiio = openimageio()
    source = oiio.ImageInput.open(str(path))
    if source is None:
        raise unreadable(path, oiio.geterror())
    return source


def unreadable(path: Path | str, why: str) -> ImageError:
    """Error for an image file that OpenImageIO cannot read."""
    return ImageError(
        "The image '{path}' cannot be read ({why}): choose another file.",
        path=path,
        why=" ".join(why.split()),
    )
